"""Settings of studies: policies in several cases, parts in play, ladders; and checks that all evaluations share."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from pydantic import Field

from agents.training_settings import Arguments, Plain
from vibgym import checks
from vibgym.envs.vector import environment_id
from vibgym.settings import BaseSettings, read

HARDWARE_KEYS = ("actuators", "sensor", "randomize")
"""Arguments of environments that describe the hardware model."""

CASE_KEYS = (*HARDWARE_KEYS, "model")
"""Arguments that a hardware entry or a case of the study of effects may set."""

ENVIRONMENT_KEYS = (
    "surface", "parts", "model", "actuators", "sensor", "randomize", "start", "zones", "paths", "walls", "costs",
    "periods_per_step", "task_settings",
)  # fmt: skip
"""Arguments that all environments share. Action and observation belong to the policies."""

MOST_NAME = 40
"""Characters of a name in tables."""

MOST_EPISODES = 100_000
Episodes = Annotated[int, Field(ge=1, le=MOST_EPISODES)]
Seed = Annotated[int, Field(ge=0, lt=2**63)]
Names = Annotated[tuple[str, ...], Field(min_length=1)]


class StudyPolicy(BaseSettings):
    """One policy of a study: its name in the table, the evaluation's policy, settings laid over every sensor."""

    name: str
    policy: str
    sensor: Arguments = {}
    trained_on: str = ""


@dataclass(frozen=True)
class Case:
    """One case of a study: arguments of the environments of a task."""

    name: str
    task: str
    arguments: dict[str, Any]


class EffectsSettings(BaseSettings):
    """Study of hardware effects: success of policies on one task in several cases.

    Attributes:
        task: one of the evaluation's tasks.
        policies: names of the evaluation's policies, or mappings as :class:`StudyPolicy` with settings such as
            ``sensor: {estimator: model}``.
        cases: name -> arguments of the environments, see :data:`CASE_KEYS`.
        episodes: at most so many of each policy in each case; by default as many as the task has.
    """

    task: str
    policies: tuple[Plain, ...] = Field(min_length=1, max_length=40)
    cases: Arguments = Field(min_length=1, max_length=100)
    episodes: Episodes | None = None

    keys: ClassVar[tuple[str, ...]] = CASE_KEYS

    def columns(self, where: str, policies: Sequence[str]) -> list[StudyPolicy]:
        """Return the policies of the study, checked against the names of the evaluation's."""
        found: list[StudyPolicy] = []
        for index, entry in enumerate(self.policies):
            field = f"{where}.policies.{index}"
            if not isinstance(entry, Mapping):
                checks.choice(field, entry, policies)
                entry = {"policy": entry}
            each = read(StudyPolicy, {"name": entry.get("policy"), **entry}, field)
            checks.choice(f"{field}.policy", each.policy, policies)
            checks.label(f"{field}.name", each.name, most=MOST_NAME)
            if each.trained_on:
                checks.label(f"{field}.trained_on", each.trained_on)
            found.append(each)
        all_differ(f"{where}.policies", [each.name for each in found])
        return found

    def tested(self, where: str) -> list[Case]:
        """Return the cases, checked."""
        found = []
        for name, content in self.cases.items():
            field = f"{where}.cases.{checks.label(f'{where}.cases (a name)', name, most=MOST_NAME)}"
            arguments = mapping_of(field, content, self.keys)
            task = arguments.pop("task", self.task)
            environment_id(task, f"{field}.task")
            found.append(Case(name, task, arguments))
        return found

    def check(self, where: str, policies: Sequence[str]) -> None:
        """Check all of it; errors begin with ``where``."""
        environment_id(self.task, f"{where}.task")
        self.columns(where, policies)
        self.tested(where)


class MatrixSettings(EffectsSettings):
    """Generalisation matrix: policies, trained on one thing, by cases that they are tested on.

    As :class:`EffectsSettings`; cases may set all of :data:`ENVIRONMENT_KEYS` and ``task``, policies ``trained_on`` (text).
    """

    name: str

    keys: ClassVar[tuple[str, ...]] = (*ENVIRONMENT_KEYS, "task")


class LoadSettings(BaseSettings):
    """Study of throughput: parts a minute against the number of parts in play.

    Attributes:
        task: one of the evaluation's tasks in which parts come and go.
        policies: names of the evaluation's policies.
        parts: numbers of parts.
        episodes: at most so many of each policy with each number; by default as many as the task has.
    """

    task: str
    policies: tuple[str, ...] = Field(min_length=1, max_length=8)
    parts: tuple[Annotated[int, Field(ge=1, le=10_000)], ...] = Field(min_length=1, max_length=40)
    episodes: Episodes | None = None


class LadderSettings(BaseSettings):
    """Ablation: policies with learning curves that differ in one thing, such as the action.

    Attributes:
        name: title.
        task, hardware: one of the comparison's; by default its first hardware.
        policies: names of the comparison's policies, in the order of the rows.
    """

    name: str
    task: str
    hardware: str | None = None
    policies: tuple[Any, ...] = Field(min_length=2, max_length=20)


def some_of(field: str, names: Sequence[Any], known: Sequence[str]) -> Sequence[str]:
    """Return ``names``, checked: all different and among ``known``."""
    for each in names:
        checks.choice(field, each, known)
    all_differ(field, names)
    return names


def all_differ(field: str, values: Sequence[Any]) -> None:
    """Raise ValueError if a value occurs twice."""
    for each, count in Counter(values).items():
        if count > 1:
            raise checks.refuse(field, each, "in the list only once")


def mapping_of(field: str, content: Any, allowed: tuple[str, ...]) -> dict[str, Any]:
    """Return a copy of a mapping whose keys are among ``allowed``, checked."""
    if not isinstance(content, Mapping):
        raise checks.refuse(field, content, f"a mapping with keys among {', '.join(map(repr, allowed))}")
    for key in content:
        checks.choice(field, key, allowed)
    return dict(content)
