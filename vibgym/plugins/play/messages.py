"""Messages of the page: JSON objects with the action in ``do``; invalid ones are refused in one line."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from vibgym import checks

MOST_BYTES = 64 * 1024
"""Largest size of a message: one that paints all elements of a large table is smaller."""

MOST_ELEMENTS = 4096
"""Most elements painted by a message."""

Finite = Annotated[float, Field(allow_inf_nan=False, ge=-1e3, le=1e3)]
Pose = tuple[Finite, Finite, Finite]
Share = Annotated[float, Field(allow_inf_nan=False, ge=-1.0, le=1.0)]


class Message(BaseModel):
    """Base of messages. ``n`` numbers them from 1 on, so that none is applied twice after a reconnect."""

    model_config = ConfigDict(extra="forbid", strict=False, frozen=True)

    n: Annotated[int, Field(ge=1, le=2**53)]
    do: str


class Open(Message):
    """Begin with another environment, or with a start that was shared."""

    do: Literal["open"]
    id: Annotated[str, Field(max_length=200)] | None = None
    start: Annotated[str, Field(max_length=40_000)] | None = None


class Reset(Message):
    """Begin another episode; without a seed the next one."""

    do: Literal["reset"]
    seed: Annotated[int, Field(ge=0, le=2**31)] | None = None


class Pace(Message):
    """Run or stand still; how many times as fast as the machine."""

    do: Literal["pace"]
    running: bool | None = None
    speed: Annotated[float, Field(ge=0.02, le=4.0)] | None = None


class Steps(Message):
    """Stand still, and make single steps."""

    do: Literal["steps"]
    count: Annotated[int, Field(ge=1, le=250)] = 1


class Undo(Message):
    """Take back what was done last."""

    do: Literal["undo"]


class Lift(Message):
    """Take a part into the hand."""

    do: Literal["lift"]
    part: int


class Carry(Message):
    """Move it there."""

    do: Literal["carry"]
    part: int
    pose: Pose


class PutDown(Message):
    """Let go of it."""

    do: Literal["put_down"]
    part: int
    pose: Pose | None = None


class Aim(Message):
    """Ask for another goal; ``begin``: the first of a stroke of such messages, which undo takes back together."""

    do: Literal["aim"]
    part: int
    pose: Pose
    begin: bool = True


class Paint(Message):
    """Paint elements [row, column] with a phasor (C, S), fractions of full scale; None takes paint off."""

    do: Literal["paint"]
    elements: Annotated[list[tuple[int, int]], Field(max_length=MOST_ELEMENTS)]
    phasor: tuple[Share, Share] | None
    begin: bool = True


class Wipe(Message):
    """Take all paint off."""

    do: Literal["wipe"]


class Switch(Message):
    """Go on with another policy, hardware, model or disturbance (1/s, rad)."""

    do: Literal["switch"]
    policy: Annotated[str, Field(max_length=100)] | None = None
    hardware: Annotated[str, Field(max_length=100)] | None = None
    model: Annotated[str, Field(max_length=100)] | None = None
    rate: Finite | None = None
    tilt: Finite | None = None


class Record(Message):
    """Begin to record, or end it and keep a GIF or an episode."""

    do: Literal["record"]
    what: Literal["begin", "gif", "minari", "drop"]


class ShareStart(Message):
    """Ask for the start as a code for a URL."""

    do: Literal["share"]


AnyMessage = (
    Open | Reset | Pace | Steps | Undo | Lift | Carry | PutDown | Aim | Paint | Wipe | Switch | Record | ShareStart
)  # fmt: skip
_ADAPTER: TypeAdapter[Any] = TypeAdapter(Annotated[AnyMessage, Field(discriminator="do")])


def parsed(text: str | bytes) -> Message:
    """Return the message in a text.

    Raises:
        ValueError: no JSON, an unknown message or a value out of range; one line that names it and what is allowed.
    """
    try:
        return _ADAPTER.validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(str(each) for each in first["loc"][1:]) or "message"
        if first["type"].startswith("union_tag"):
            context = first.get("ctx", {})
            tags = context.get("expected_tags", "'open', 'pace', ..., see vibgym.plugins.play.messages")
            raise checks.unknown("do", context.get("tag"), [tags]) from None
        if first["type"] == "json_invalid":
            raise checks.refuse("message", _shown(text), "a JSON object") from None
        got = first.get("input") if place != "message" else _shown(text)
        raise checks.conflict(f"{place}: {first['msg']}, got {got!r}") from None


def _shown(text: str | bytes) -> str:
    return text[:60].decode("utf-8", "replace") if isinstance(text, bytes) else text[:60]
