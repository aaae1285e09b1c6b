"""The trained agents that are shipped: which there are, by their files' own records, and which one serves a scene."""

from __future__ import annotations

import functools
import json
from pathlib import Path
from typing import Any, NamedTuple

from vibgym import Surface, checks
from vibgym.actuators import DataSheet, actuators_from
from vibgym.policies.task_info import TaskInfo
from vibgym.policies.trained.trained import ANY, RESIDUAL, described

SHIPPED = Path(__file__).parent / "shipped"

HARDWARE = ("ideal", "prototype")
"""Hardware models: ideal elements, and elements with dead zone, limit, latency, quantization or lag."""


class Agent(NamedTuple):
    """A shipped agent, as the record of its file has it."""

    path: Path
    tasks: tuple[str, ...]  # that it serves, first the one that it was trained for
    hardware: str  # among HARDWARE, that it was trained on
    action: str
    variant: str  # what tells it from the usual agent of its task and hardware, such as "cloned"; "" for that one
    surface: Any  # as :func:`.trained.described` has it, or ANY
    parts: Any  # number of them, or ANY
    kind: str  # of the policy: "trained" or "residual"

    def __str__(self) -> str:
        parts = "any number of parts" if self.parts == ANY else f"{self.parts} part{'s' * (self.parts != 1)}"
        surface = "any surface" if self.surface == ANY else "{rows} x {columns} elements".format(**self.surface)
        variant = f", variant {self.variant!r}" if self.variant else ""
        return f"{', '.join(self.tasks)} ({self.hardware}, action {self.action!r}, {parts}, {surface}{variant})"

    def differs(self, info: TaskInfo) -> bool:
        """Whether surface or number of parts are not those that it was trained with."""
        return self.surface not in (ANY, described(info.surface)) or self.parts not in (ANY, len(info.parts))


def hardware_of(sheet: DataSheet, surface: Surface) -> str:
    """Which of :data:`HARDWARE` a data sheet describes."""
    assert surface.max_amplitude is not None
    return HARDWARE[sheet != DataSheet(surface.max_amplitude)]


@functools.cache
def shipped_agents() -> tuple[Agent, ...]:
    """All of them, by their files' names."""
    return tuple(map(_agent, sorted(SHIPPED.glob("*.json"))))


def _agent(path: Path) -> Agent:
    record = json.loads(path.read_text(encoding="utf-8"))
    trained_in = record["training"]["settings"]["environment"]
    surface = Surface()
    machine = actuators_from(trained_in.get("actuators", "ideal"), surface, 1, 1)
    hardware, kind = hardware_of(machine.data_sheet, surface), RESIDUAL if record.get(RESIDUAL) else "trained"
    words = [word for word in path.stem.split("-") if word not in (record["tasks"][0].lower(), hardware)]
    return Agent(
        path,
        tuple(record["tasks"]),
        hardware,
        record["action"],
        "-".join(words),
        record["surface"],
        record["parts"],
        kind,
    )


def shipped_agent(
    info: TaskInfo, *, hardware: str | None = None, action: str | None = None, variant: str | None = None
) -> Agent:
    """The shipped agent for a task, the usual one before its variants.

    Args:
        info: task and scene.
        hardware: among :data:`HARDWARE`; None: what the data sheet of the scene's actuators says.
        action: that it shall speak; None: any.
        variant: another one than the usual, such as ``"cloned"``.

    Raises:
        ValueError: there is none; says which there are, and for what.
    """
    if hardware is None:
        hardware = hardware_of(info.hardware, info.surface)
    checks.choice("policy.hardware", hardware, HARDWARE)
    mine = [agent for agent in shipped_agents() if info.name in agent.tasks]
    fitting = [
        agent for agent in mine
        if agent.hardware == hardware and action in (None, agent.action) and variant in (None, agent.variant)
        and not agent.differs(info)
    ]  # fmt: skip
    if not fitting:
        named = "".join(f", {name} {value!r}" for name, value in (("action", action), ("variant", variant)) if value)
        surface = f"{info.surface.rows} x {info.surface.columns} elements"
        scene = f"{info.name} ({hardware}, parts: {len(info.parts)}, {surface}{named})"
        have = "; ".join(map(str, mine or shipped_agents()))
        raise checks.conflict(f"policy 'learned' has no agent for {scene}; shipped: {have}")
    return min(fitting, key=lambda agent: (agent.variant, agent.tasks.index(info.name)))
