"""Messages of the page: JSON objects with the action in ``do``; invalid ones raise an error of one line."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from vibgym import checks

MOST_BYTES = 4 * 1024 * 1024
"""Largest size of a message; a drawing is the largest."""

MOST_ELEMENTS = 4096
"""Most elements painted by a message."""

Finite = Annotated[float, Field(allow_inf_nan=False, ge=-1e3, le=1e3)]
Pose = tuple[Finite, Finite, Finite]
Share = Annotated[float, Field(allow_inf_nan=False, ge=-1.0, le=1.0)]


class Message(BaseModel):
    """Base class of messages, numbered by ``n`` from 1 on, so that none is applied twice after a reconnect."""

    model_config = ConfigDict(extra="forbid", strict=False, frozen=True)

    n: Annotated[int, Field(ge=1, le=2**53)]
    do: str


class Open(Message):
    """Open another environment, or a shared start."""

    do: Literal["open"]
    id: Annotated[str, Field(max_length=200)] | None = None
    start: Annotated[str, Field(max_length=40_000)] | None = None


class Reset(Message):
    """Begin another episode; without a seed, with the next one."""

    do: Literal["reset"]
    seed: Annotated[int, Field(ge=0, le=2**31)] | None = None


class Pace(Message):
    """Run or pause; ``speed`` is a multiple of real time."""

    do: Literal["pace"]
    running: bool | None = None
    speed: Annotated[float, Field(ge=0.02, le=4.0)] | None = None


class Steps(Message):
    """Pause, and execute single steps."""

    do: Literal["steps"]
    count: Annotated[int, Field(ge=1, le=250)] = 1


class Lift(Message):
    """Lift a part."""

    do: Literal["lift"]
    part: int


class Carry(Message):
    """Move a lifted part."""

    do: Literal["carry"]
    part: int
    pose: Pose


class PutDown(Message):
    """Put a lifted part down."""

    do: Literal["put_down"]
    part: int
    pose: Pose | None = None


class Aim(Message):
    """Set a goal; ``begin``: the first message of a stroke, which is undone as a whole."""

    do: Literal["aim"]
    part: int
    pose: Pose
    begin: bool = True


class Paint(Message):
    """Paint elements [row, column] with a phasor (C, S), fractions of full scale; None removes paint."""

    do: Literal["paint"]
    elements: Annotated[list[tuple[int, int]], Field(max_length=MOST_ELEMENTS)]
    phasor: tuple[Share, Share] | None
    begin: bool = True


class Switch(Message):
    """Change policy, hardware, model or disturbance (1/s, rad)."""

    do: Literal["switch"]
    policy: Annotated[str, Field(max_length=100)] | None = None
    hardware: Annotated[str, Field(max_length=100)] | None = None
    model: Annotated[str, Field(max_length=100)] | None = None
    rate: Finite | None = None
    tilt: Finite | None = None


class Drop(Message):
    """Open the present environment with the part of a drawing: name and content of the file, in base 64."""

    do: Literal["drop"]
    name: Annotated[str, Field(max_length=200)]
    content: Annotated[str, Field(max_length=MOST_BYTES)]
    units: Annotated[str, Field(max_length=10)] | None = None


class Record(Message):
    """Begin a recording, or end it and write a GIF or a data set."""

    do: Literal["record"]
    what: Literal["begin", "gif", "minari", "drop"]


class Request(Message):
    """Undo the last intervention, remove all paint, or return the start as a code for a URL."""

    do: Literal["undo", "wipe", "share"]


AnyMessage = Open | Reset | Pace | Steps | Lift | Carry | PutDown | Aim | Paint | Switch | Drop | Record | Request
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
