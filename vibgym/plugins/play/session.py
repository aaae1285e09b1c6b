"""Session of one visitor: a world, its undo stack and its recording. Independent of the network.

Messages of the page are JSON objects: ``do`` is the name of a method of :class:`Session` with :func:`message`, ``n`` the number
of the message, and all others are arguments of the method, validated by its annotations.
"""

from __future__ import annotations

import base64
import binascii
import json
import re
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import ConfigDict, Field, ValidationError, validate_call

from vibgym import Part, checks
from vibgym.datasets import ROOT
from vibgym.plugins.play.choices import Settings, settings_of
from vibgym.plugins.play.picture import frame_of, scene_of
from vibgym.plugins.play.recording import Recorder
from vibgym.plugins.play.starts import code_of, world_from
from vibgym.plugins.play.world import World
from vibgym.scene.parts import skipped_text

MAX_UNDONE = 60
"""Depth of the undo stack."""

MAX_BYTES = 4 * 1024 * 1024
"""Largest size of a message; a drawing is the largest."""

MAX_ELEMENTS = 4096
"""Most elements painted by a message."""

QUIET = ("carry", "aim", "paint")
"""Messages of a stroke: while time passes, the next step shows their effect."""

Answer = dict[str, Any]
Finite = Annotated[float, Field(ge=-1e3, le=1e3)]
Pose = tuple[Finite, Finite, Finite]
Share = Annotated[float, Field(ge=-1.0, le=1.0)]
Name = Annotated[str, Field(max_length=200)]

MESSAGES: dict[str, Callable[..., list[Answer] | None]] = {}
"""Handlers of messages by name; they return answers in addition to the present frame."""


def message(method: Callable[..., list[Answer] | None]) -> Callable[..., list[Answer] | None]:
    """Register a method of :class:`Session` as the handler of the messages of its name."""
    checked = MESSAGES[method.__name__] = validate_call(config=ConfigDict(allow_inf_nan=False))(method)
    return checked


class Session:
    """Executor of messages, in order and each once.

    Args:
        settings: of the first world.
        output: directory for recordings.
        start: code of a shared start; None: a new episode.

    Attributes:
        acknowledged: number of the last message that was executed or refused.
        running: whether time passes.  speed: times real time.
        kept: written files, by their names in URLs.

    Raises:
        ValueError: invalid settings or an invalid start.
    """

    def __init__(self, settings: Settings, output: Path, start: str | None = None) -> None:
        self.output, self.world = output, World(settings) if start is None else world_from(start)
        self.acknowledged, self.running, self.speed = 0, True, 1.0
        self.kept = dict[str, Path]()
        self._past: deque[dict[str, Any]] = deque(maxlen=MAX_UNDONE)
        self._recorder: Recorder | None = None
        self._frames, self._jumps, self._scene_due = 0, 0, True
        self._lock = threading.Lock()  # steps and messages come from different threads

    @property
    def step_time(self) -> float:
        """s between displayed steps."""
        return self.world.env.step_time / self.speed

    def step(self) -> list[Answer]:
        """Step the world and return the answers; none while paused."""
        with self._lock:
            return self._step() if self.running else []

    def _step(self) -> list[Answer]:
        if self._recorder is not None:
            self._recorder.before(self.world)
        try:
            self.world.step()
        except ValueError as error:
            self.running = False
            return [_refusal(str(error)), self._frame()]
        if self._recorder is not None:
            self._recorder.after(self.world)
        if self.world.info.get("diverged", False):
            self.running = False
            return [_refusal("the simulation diverged: undo, or begin anew"), self._frame()]
        return [self._frame()]

    def shown(self) -> list[Answer]:
        """Return scene and frame, for a page that has just connected."""
        with self._lock:
            self._scene_due = True
            return self._current()

    def do(self, text: str | bytes) -> list[Answer]:
        """Execute a message; for an invalid one return an error, without any change."""
        with self._lock:
            try:
                number, name, arguments = parsed(text)
            except ValueError as error:
                return [_refusal(str(error))]
            if number <= self.acknowledged:
                return []  # sent twice: the connection was lost before the answer
            self.acknowledged = number
            try:
                answers = MESSAGES[name](self, **arguments) or []
            except ValidationError as error:
                answers = [_refusal(_complaint(error))]
            except (ValueError, ModuleNotFoundError, OSError) as error:
                answers = [_refusal(str(error))]
            return answers if name in QUIET and self.running else [*answers, *self._current()]

    def _current(self) -> list[Answer]:
        scene = [{"kind": "scene", **scene_of(self.world)}] if self._scene_due else []
        self._scene_due = False
        return [*scene, self._frame()]

    def _frame(self) -> Answer:
        self._frames += 1
        recording = None if self._recorder is None else {"steps": self._recorder.steps, "full": self._recorder.full}
        return {
            "kind": "frame",
            "k": self._frames,
            "jump": self._jumps,
            "ack": self.acknowledged,
            "running": self.running,
            "speed": self.speed,
            "back": len(self._past),
            "recording": recording,
            **frame_of(self.world),
        }

    def _note(self) -> None:
        """Store the state for undo, before an intervention; an episode of a data set ends here."""
        self._past.append({"world": self.world, "state": self.world.get_state()})
        if self._recorder is not None:
            self._recorder.cut()

    def _tried(self, change: Callable[[], Any]) -> None:
        """Apply a change; if it is refused, nothing is added to the undo stack."""
        self._note()
        try:
            change()
        except ValueError:
            self._past.pop()
            raise

    @message
    def open(self, id: Name | None = None, start: Annotated[str, Field(max_length=40_000)] | None = None) -> None:
        """Open another environment, or a shared start."""
        world = World(settings_of(id or self.world.settings.id)) if start is None else world_from(start)
        self._note()
        self._go_to(world)

    @message
    def drop(
        self,
        name: Name,
        content: Annotated[str, Field(max_length=MAX_BYTES)],
        units: Annotated[str, Field(max_length=10)] | None = None,
    ) -> list[Answer]:
        """Open the present environment with the part of a drawing: name and content of the file, in base 64."""
        settings = self.world.settings
        friction = self.world.env.parts[0].friction
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / Path(name.replace("\\", "/")).name
            try:
                path.write_bytes(base64.b64decode(content, validate=True))
            except (binascii.Error, OSError, ValueError):
                raise checks.refuse("content", content[:20], "a file with a name, in base 64") from None
            try:
                part = Part.from_file(path, friction=friction, units=units, surface=self.world.core.surface)
            except checks.Refused as error:
                raise checks.conflict(str(error).replace(str(path), path.name)) from None
        world = World(settings_of(**{**vars(settings), "part": part.to_dict(), "policy": ""}))
        self._note()
        self._go_to(world)
        return [{"kind": "note", "text": f"{path.name}: skipped {skipped_text(part.skipped)}"}] if part.skipped else []

    def _go_to(self, world: World) -> None:
        self.world = world
        self._jumped()

    def _jumped(self) -> None:
        """Mark a discontinuity: the next frame does not follow from the last one."""
        self._jumps += 1
        self._scene_due = True

    @message
    def reset(self, seed: Annotated[int, Field(ge=0, le=2**31)] | None = None) -> None:
        """Begin another episode; without a seed, with the next one."""
        self._tried(lambda: self.world.begin(self.world.seed + 1 if seed is None else seed))
        self._jumped()

    @message
    def pace(self, running: bool | None = None, speed: Annotated[float, Field(ge=0.02, le=4.0)] | None = None) -> None:
        """Run or pause; ``speed`` is a multiple of real time."""
        self.running = self.running if running is None else running
        self.speed = self.speed if speed is None else speed

    @message
    def steps(self, count: Annotated[int, Field(ge=1, le=250)] = 1) -> list[Answer]:
        """Pause, and execute single steps."""
        self.running = False
        self._note()
        answers: list[Answer] = []
        for _ in range(count):
            answers = self._step()
        return answers[:-1]

    @message
    def undo(self) -> None:
        """Undo the last intervention."""
        if not self._past:
            raise checks.conflict("undo: there is nothing to undo")
        past = self._past.pop()
        past["world"].set_state(past["state"])
        if self._recorder is not None:
            self._recorder.cut()
        self._go_to(past["world"])

    @message
    def lift(self, part: int) -> None:
        """Lift a part."""
        part = self.world.part(part)
        self._tried(lambda: self.world.lift(part))

    @message
    def carry(self, part: int, pose: Pose) -> None:
        """Move a lifted part."""
        self.world.carry(self.world.part(part), np.array(pose))

    @message
    def place(self, part: int, pose: Pose | None = None) -> None:
        """Put a lifted part down."""
        part = self.world.part(part)
        if pose is not None:
            self.world.carry(part, np.array(pose))
        self.world.place(part)

    @message
    def aim(self, part: int, pose: Pose, begin: bool = True) -> None:
        """Set a goal; ``begin``: the first message of a stroke, which is undone as a whole."""
        part, goal = self.world.part(part), np.array(pose)
        if begin:
            self._tried(lambda: self.world.aim(part, goal))
        else:
            self.world.aim(part, goal)

    @message
    def paint(
        self,
        elements: Annotated[list[tuple[int, int]], Field(max_length=MAX_ELEMENTS)],
        phasor: tuple[Share, Share] | None,
        begin: bool = True,
    ) -> None:
        """Paint elements [row, column] with a phasor (C, S), fractions of full scale; None removes paint."""
        rows, columns = self.world.paint.shape[:2]
        cells = np.array(elements, dtype=int).reshape(-1, 2)
        if ((cells < 0) | (cells >= [rows, columns])).any():
            allowed = f"rows 0 to {rows - 1}, columns 0 to {columns - 1}"
            raise checks.refuse("elements", "an element off the table", allowed)
        if begin:
            self._note()
        colour = np.array([np.nan, np.nan] if phasor is None else phasor)
        self.world.draw(cells, colour / max(1.0, float(np.hypot(*colour))))

    @message
    def wipe(self) -> None:
        """Remove all paint."""
        self._note()
        self.world.paint[...] = np.nan

    @message
    def switch(
        self,
        policy: Name | None = None,
        hardware: Name | None = None,
        model: Name | None = None,
        rate: Finite | None = None,
        tilt: Finite | None = None,
    ) -> None:
        """Change policy, hardware, model or disturbance (1/s, rad)."""
        settable = {"policy": policy, "hardware": hardware, "model": model, "rate": rate, "tilt": tilt}
        chosen = {name: value for name, value in settable.items() if value is not None}
        settings = settings_of(**{**vars(self.world.settings), **chosen})
        self._tried(lambda: self.world.switch(settings))
        self._scene_due = True

    @message
    def record(self, what: Literal["begin", "gif", "minari", "drop"]) -> list[Answer]:
        """Begin a recording, or end it and write a GIF or a data set."""
        recorder = self._recorder
        if what == "begin":
            self._recorder = Recorder(self.world)
            return []
        if recorder is None:
            raise checks.conflict("record: there is no recording")
        self._recorder = None
        if what == "drop":
            return []
        stem = re.sub(r"\W+", "-", self.world.settings.id.rpartition("/")[2].lower())
        name = f"{stem}-{time.strftime('%Y%m%d-%H%M%S')}-{len(self.kept)}"
        try:
            if what == "gif":
                path = self.output / f"{name}.gif"
                recorder.gif(path, self.world.env.step_time)
                self.kept[path.name] = path
                return [{"kind": "kept", "text": f"written: {path}", "link": f"kept/{path.name}"}]
            path = recorder.minari(self.output, f"play/{name}-v0")
        except Exception:
            self._recorder = recorder  # keep the recording
            raise
        text = f"written: {path} ({ROOT}={self.output}, data set play/{name}-v0)"
        return [{"kind": "kept", "text": text}]

    @message
    def share(self) -> list[Answer]:
        """Return the start as a code for a URL."""
        return [{"kind": "start", "code": code_of(self.world)}]


def parsed(text: str | bytes) -> tuple[int, str, dict[str, Any]]:
    """Return number, name and arguments of a message.

    Raises:
        ValueError: no JSON object, a bad number or an unknown name.
    """
    try:
        arguments = json.loads(text)
    except (ValueError, RecursionError):
        arguments = None
    if not isinstance(arguments, dict):
        raise checks.refuse("message", text[:60], "a JSON object")
    name = checks.choice("do", arguments.pop("do", None), MESSAGES)
    return checks.count("n", arguments.pop("n", None), most=2**53), name, arguments


def _complaint(error: ValidationError) -> str:
    """Return one line about the first fault in the arguments of a message."""
    first = error.errors(include_url=False)[0]
    got = "" if first["type"].startswith("missing") else f", got {first['input']!r}"
    return str(checks.conflict(f"{'.'.join(map(str, first['loc']))}: {first['msg']}{got}"))


def _refusal(text: str) -> Answer:
    """Return the message that explains why a request was refused."""
    return {"kind": "refused", "text": " ".join(text.split())}
