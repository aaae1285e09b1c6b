"""Settings of the comparison's studies: the generalisation matrix and the ladder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pydantic import Field

from agents.evaluation.entries import Column, arguments_among, columns, named, some_of
from agents.evaluation.run_settings import ENVIRONMENT_KEYS
from vibgym import checks
from vibgym.config import Settings
from vibgym.envs.named import environment_id


@dataclass(frozen=True)
class Case:
    """One column of a matrix."""

    name: str
    task: str
    arguments: dict[str, Any]  # of the environments


class MatrixSettings(Settings):
    """Policies, trained on one thing, by cases that they are tested on.

    Attributes:
        name: its title.
        task: of the cases that name none.
        policies: each the name of one of the comparison's policies, or a mapping of ``policy`` (that name), ``name`` (shown in
            the table), ``trained_on`` (a few words) and ``sensor`` (settings that lie over those of every case).
        cases: name -> arguments of the environment that lie over ``environment``, see
            :data:`agents.evaluation.run_settings.ENVIRONMENT_KEYS`, and ``task``.
        episodes: at most so many in each case; by default as many as the task has.
    """

    name: str
    task: str
    policies: list[Any] = Field(min_length=1, max_length=40)
    cases: dict[str, Any] = Field(min_length=1, max_length=40)
    episodes: int | None = Field(default=None, ge=1, le=100_000)

    def lines(self, where: str, policies: Sequence[str]) -> list[Column]:
        """The rows, checked against the names of the comparison's policies."""
        return columns(self.policies, f"{where}.policies", policies, told=True)

    def tested(self, where: str) -> list[Case]:
        """The cases, checked."""
        found = []
        for name, content in self.cases.items():
            field = f"{where}.cases.{named(f'{where}.cases', name)}"
            arguments = arguments_among(field, content, (*ENVIRONMENT_KEYS, "task"))
            task = arguments.pop("task", self.task)
            environment_id(task, f"{field}.task")
            found.append(Case(name, task, arguments))
        return found

    def named(self) -> list[str]:
        """The comparison's policies that it has."""
        return [str(each["policy"] if isinstance(each, Mapping) else each) for each in self.policies]

    def check(self, where: str, tasks: Sequence[str], hardware: Sequence[str], policies: Sequence[str]) -> None:
        """Check all of it.

        Raises:
            ValueError: the first fault; names the field, which begins with ``where``.
        """
        environment_id(self.task, f"{where}.task")
        self.lines(where, policies)
        self.tested(where)


class LadderSettings(Settings):
    """Policies that differ in one thing, such as the action, after the same budget of steps; all have learning curves.

    Attributes:
        name: its title.
        task: one of the comparison's.
        hardware: one of the comparison's; by default the first one.
        policies: names of the comparison's policies, in the order of the rows.
    """

    name: str
    task: str
    hardware: str | None = None
    policies: list[Any] = Field(min_length=2, max_length=20)

    def named(self) -> list[str]:
        """The comparison's policies that it has."""
        return list(self.policies)

    def check(self, where: str, tasks: Sequence[str], hardware: Sequence[str], policies: Sequence[str]) -> None:
        """Check all of it; see :meth:`MatrixSettings.check`."""
        checks.choice(f"{where}.task", self.task, tuple(tasks))
        if self.hardware is not None:
            checks.choice(f"{where}.hardware", self.hardware, tuple(hardware))
        some_of(f"{where}.policies", self.policies, policies, "policies")
