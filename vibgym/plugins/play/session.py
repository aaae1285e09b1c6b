"""Session of one visitor: a world, its undo stack and its recording. Independent of the network."""

from __future__ import annotations

import base64
import binascii
import re
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from vibgym import Part, checks
from vibgym.plugins.play import messages
from vibgym.plugins.play.choices import Settings, settings_of
from vibgym.plugins.play.picture import frame_of, scene_of
from vibgym.plugins.play.recording import Recorder
from vibgym.plugins.play.starts import code_of, world_from
from vibgym.plugins.play.world import World
from vibgym.scene.parts import skipped_text

MOST_UNDONE = 60
"""Depth of the undo stack."""

Answer = dict[str, Any]


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
        self._past: deque[dict[str, Any]] = deque(maxlen=MOST_UNDONE)
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
            return self._look()

    def do(self, text: str | bytes) -> list[Answer]:
        """Execute a message; for an invalid one return an error, without any change."""
        with self._lock:
            try:
                message = messages.parsed(text)
            except ValueError as error:
                return [_refusal(str(error))]
            if message.n <= self.acknowledged:
                return []  # sent twice: the connection was lost before the answer
            self.acknowledged = message.n
            try:
                answers: list[Answer] = getattr(self, f"_{message.do}")(message) or []
            except (ValueError, ModuleNotFoundError, OSError) as error:
                answers = [_refusal(str(error))]
            quiet = isinstance(message, messages.Carry | messages.Aim | messages.Paint) and self.running
            return answers if quiet else [*answers, *self._look()]

    def _look(self) -> list[Answer]:
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

    def _open(self, message: messages.Open) -> None:
        if message.start is not None:
            world = world_from(message.start)
        else:
            world = World(settings_of(message.id or self.world.settings.id))
        self._note()
        self._go_to(world)

    def _drop(self, message: messages.Drop) -> list[Answer]:
        settings = self.world.settings
        friction = self.world.env.parts[0].friction
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / Path(message.name.replace("\\", "/")).name
            try:
                path.write_bytes(base64.b64decode(message.content, validate=True))
            except (binascii.Error, OSError, ValueError):
                raise checks.refuse("content", message.content[:20], "a file with a name, in base 64") from None
            try:
                part = Part.from_file(path, friction=friction, units=message.units, surface=self.world.core.surface)
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

    def _reset(self, message: messages.Reset) -> None:
        seed = self.world.seed + 1 if message.seed is None else message.seed
        self._tried(lambda: self.world.begin(seed))
        self._jumped()

    def _pace(self, message: messages.Pace) -> None:
        if message.running is not None:
            self.running = message.running
        if message.speed is not None:
            self.speed = message.speed

    def _steps(self, message: messages.Steps) -> list[Answer]:
        self.running = False
        self._note()
        answers: list[Answer] = []
        for _ in range(message.count):
            answers = self._step()
        return answers[:-1]

    def _undo(self, message: messages.Request) -> None:
        if not self._past:
            raise checks.conflict("undo: there is nothing to undo")
        past = self._past.pop()
        past["world"].set_state(past["state"])
        if self._recorder is not None:
            self._recorder.cut()
        self._go_to(past["world"])

    def _lift(self, message: messages.Lift) -> None:
        part = self.world.part(message.part)
        self._tried(lambda: self.world.lift(part))

    def _carry(self, message: messages.Carry) -> None:
        self.world.carry(self.world.part(message.part), np.array(message.pose))

    def _put_down(self, message: messages.PutDown) -> None:
        part = self.world.part(message.part)
        if message.pose is not None:
            self.world.carry(part, np.array(message.pose))
        self.world.put_down(part)

    def _aim(self, message: messages.Aim) -> None:
        part, pose = self.world.part(message.part), np.array(message.pose)
        if message.begin:
            self._tried(lambda: self.world.aim(part, pose))
        else:
            self.world.aim(part, pose)

    def _paint(self, message: messages.Paint) -> None:
        rows, columns = self.world.paint.shape[:2]
        elements = np.array(message.elements, dtype=int).reshape(-1, 2)
        if ((elements < 0) | (elements >= [rows, columns])).any():
            raise checks.refuse(
                "elements", "an element off the table", f"rows 0 to {rows - 1}, columns 0 to {columns - 1}"
            )
        if message.begin:
            self._note()
        phasor = np.array([np.nan, np.nan] if message.phasor is None else message.phasor)
        self.world.draw(elements, phasor / max(1.0, float(np.hypot(*phasor))))

    def _wipe(self, message: messages.Request) -> None:
        self._note()
        self.world.paint[...] = np.nan

    def _switch(self, message: messages.Switch) -> None:
        chosen = {name: value for name, value in message.model_dump(exclude={"n", "do"}).items() if value is not None}
        settings = settings_of(**{**vars(self.world.settings), **chosen})
        self._tried(lambda: self.world.switch(settings))
        self._scene_due = True

    def _record(self, message: messages.Record) -> list[Answer]:
        recorder = self._recorder
        if message.what == "begin":
            self._recorder = Recorder(self.world)
            return []
        if recorder is None:
            raise checks.conflict("record: there is no recording")
        self._recorder = None
        if message.what == "drop":
            return []
        stem = re.sub(r"\W+", "-", self.world.settings.id.rpartition("/")[2].lower())
        name = f"{stem}-{time.strftime('%Y%m%d-%H%M%S')}-{len(self.kept)}"
        try:
            if message.what == "gif":
                path = self.output / f"{name}.gif"
                recorder.gif(path, self.world.env.step_time)
                self.kept[path.name] = path
                return [{"kind": "kept", "text": f"written: {path}", "link": f"kept/{path.name}"}]
            path = recorder.minari(self.output, f"play/{name}-v0")
        except Exception:
            self._recorder = recorder  # keep the recording
            raise
        text = f"written: {path} (MINARI_DATASETS_PATH={self.output}, data set play/{name}-v0)"
        return [{"kind": "kept", "text": text}]

    def _share(self, message: messages.Request) -> list[Answer]:
        return [{"kind": "start", "code": code_of(self.world)}]


def _refusal(text: str) -> Answer:
    """Return the message that explains why a request was refused."""
    return {"kind": "refused", "text": " ".join(text.split())}
