"""Shipped agents: the records of their files, and the choice for a scene."""

from __future__ import annotations

import functools
import json
from pathlib import Path
from typing import Any, NamedTuple

from vibgym import Surface, checks
from vibgym.actuators import ACTUATORS, DataSheet
from vibgym.policies.task_info import POLICIES, TaskInfo
from vibgym.policies.trained.trained import ANY, RANGE, RESIDUAL, check_range, serves_surface
from vibgym.settings import BaseSettings

SHIPPED = Path(__file__).parent / "shipped"

HARDWARE = ("ideal", "prototype")
"""Hardware models: ideal elements, and elements with dead zone, limit, latency, quantization or lag."""


class Agent(NamedTuple):
    """A shipped agent, from the record of its file."""

    path: Path
    tasks: tuple[str, ...]  # that it serves, first the one of training
    hardware: str  # among HARDWARE, of training; ANY: it serves both
    action: str
    variant: str  # such as "cloned"; "" for the usual agent of the task and hardware
    surface: Any  # see trained.serves_surface()
    parts: Any  # number of them, or ANY
    kind: str  # of the policy: "trained" or "residual"
    range: Any  # see trained.check_range()

    def __str__(self) -> str:
        parts = "any number of parts" if self.parts == ANY else f"{self.parts} part{'s' * (self.parts != 1)}"
        surface = "any surface"
        if self.surface != ANY:
            size = "{rows} x {columns}".format(**self.surface)
            frequency = self.surface["frequency"]
            low, high = frequency if isinstance(frequency, list) else (frequency, frequency)
            surface = f"{size} elements, {low:g} Hz" if low == high else f"{size} elements, {low:g} to {high:g} Hz"
        variant = f", variant {self.variant!r}" if self.variant else ""
        hardware = "any hardware" if self.hardware == ANY else self.hardware
        return f"{', '.join(self.tasks)} ({hardware}, action {self.action!r}, {parts}, {surface}{variant})"

    def fits(self, info: TaskInfo, hardware: str) -> bool:
        """Return whether it supports surface, number of parts and hardware."""
        return (
            self.hardware in (hardware, ANY)
            and serves_surface(self.surface, info.surface)
            and self.parts in (ANY, len(info.parts))
        )


def hardware_of(sheet: DataSheet, surface: Surface) -> str:
    """Return which of :data:`HARDWARE` a data sheet describes."""
    assert surface.max_amplitude is not None
    return HARDWARE[sheet != DataSheet(surface.max_amplitude)]


class Learned:
    """Maker of the shipped agent for a task and hardware (:func:`shipped_agent`)."""

    class Settings(BaseSettings):
        """Choice of the agent."""

        action: str | None = None
        """Of the agent. None: any."""

        hardware: str | None = None
        """``"ideal"`` or ``"prototype"``. None: by the data sheet of the scene's actuators."""

        variant: str | None = None
        """Such as ``"cloned"``. None: any, the usual agent before its variants."""

    @staticmethod
    def supports(action: str) -> bool:
        """Return whether there may be agents for the environment's ``action=``: any."""
        return True

    def __new__(cls, info: TaskInfo, settings: Settings) -> Any:
        """Load the agent."""
        agent = shipped_agent(info, action=settings.action, hardware=settings.hardware, variant=settings.variant)
        return POLICIES.make("policy", {"kind": agent.kind, "path": str(agent.path)}, info)


@functools.cache
def shipped_agents() -> tuple[Agent, ...]:
    """Return all shipped agents, sorted by file name."""
    return tuple(map(_agent, sorted(SHIPPED.glob("*.json"))))


def _agent(path: Path) -> Agent:
    record = json.loads(path.read_text(encoding="utf-8"))
    tasks, surface = tuple(record["tasks"]), Surface()
    actuators = record["training"]["settings"]["environment"].get("actuators", "ideal")
    trained_on = hardware_of(ACTUATORS.make("actuators", actuators, surface, 1, 1).data_sheet, surface)
    hardware = record.get("hardware", trained_on)
    variant = "-".join(word for word in path.stem.split("-") if word not in (tasks[0].lower(), hardware))
    kind = RESIDUAL if record.get(RESIDUAL) else "trained"
    return Agent(
        path, tasks, hardware, record["action"], variant, record["surface"], record["parts"], kind, record.get(RANGE)
    )


def shipped_agent(
    info: TaskInfo, *, hardware: str | None = None, action: str | None = None, variant: str | None = None
) -> Agent:
    """Return the shipped agent for a task, the usual one before its variants.

    Args:
        info: task and scene.
        hardware: among :data:`HARDWARE`; None: by the data sheet of the scene's actuators.
        action: of the policy; None: any.
        variant: such as ``"cloned"``; None: any.

    Raises:
        ValueError: there is none; the message lists those of the task, or says which part the usual agent does not serve.
    """
    if hardware is None:
        hardware = hardware_of(info.hardware, info.surface)
    checks.choice("policy.hardware", hardware, HARDWARE)
    mine = [agent for agent in shipped_agents() if info.name in agent.tasks]
    fitting = [
        agent for agent in mine
        if action in (None, agent.action) and variant in (None, agent.variant) and agent.fits(info, hardware)
    ]  # fmt: skip
    if not fitting:
        named = "".join(f", {name} {value!r}" for name, value in (("action", action), ("variant", variant)) if value)
        surface = f"{info.surface.rows} x {info.surface.columns} elements, {info.surface.frequency:g} Hz"
        scene = f"{info.name} ({hardware}, parts: {len(info.parts)}, {surface}{named})"
        have = "; ".join(map(str, mine or shipped_agents()))
        raise checks.conflict(f"policy 'learned' has no agent for {scene}; shipped: {have}")
    refusals: list[checks.Refused] = []
    for agent in sorted(
        fitting, key=lambda agent: (agent.variant, agent.tasks.index(info.name), agent.hardware == ANY)
    ):
        try:
            check_range(f"the agent {agent.path.stem}", agent.range, info.parts)
        except checks.Refused as refusal:
            refusals.append(refusal)
        else:
            return agent
    raise refusals[0]
