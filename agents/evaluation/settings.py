"""What an evaluation is asked to do, beyond running policies: films, the study of effects, the cost of a period."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pydantic import Field

from agents.evaluation.entries import Column, columns, effect_arguments
from agents.evaluation.run_settings import RunSettings
from vibgym import checks
from vibgym.config import Settings


class EffectsSettings(Settings):
    """A study of which effect of the hardware breaks which policy: one table of success rates.

    Attributes:
        task: name of one of the evaluation's tasks.
        policies: each the name of one of the evaluation's policies, or a mapping of ``policy`` (that name), ``name`` (shown in
            the table) and ``sensor``: settings that lie over those of every case, such as ``{estimator: model}``.
        cases: name in the table -> arguments of the environment, see :data:`agents.evaluation.entries.WORLD_KEYS`.
        episodes: at most so many of each policy in each case; by default as many as the task has.
    """

    task: str
    policies: list[Any] = Field(min_length=1, max_length=12)
    cases: dict[str, Any] = Field(min_length=1, max_length=100)
    episodes: int | None = Field(default=None, ge=1, le=100_000)

    def columns(self, policies: Sequence[str]) -> list[Column]:
        """The policies of the table, checked against the names of the evaluation's."""
        return columns(self.policies, "evaluation.effects.policies", policies)

    def arguments(self) -> dict[str, dict[str, Any]]:
        """Name of a case -> arguments of the environment, checked."""
        return {name: effect_arguments(name, content) for name, content in self.cases.items()}


class LoadSettings(Settings):
    """A study of parts a minute against the number of parts in play, on the evaluation's own environment.

    Attributes:
        task: one of the evaluation's tasks, in which parts come and go.
        policies: names of the evaluation's policies.
        parts: numbers of parts.
        episodes: at most so many of each policy with each number; by default as many as the task has.
    """

    task: str
    policies: list[str] = Field(min_length=1, max_length=8)
    parts: list[int] = Field(min_length=1, max_length=40)
    episodes: int | None = Field(default=None, ge=1, le=100_000)

    def check(self, tasks: Sequence[str], policies: Sequence[str]) -> None:
        """Refuse names that the evaluation does not have, and what stands twice.

        Raises:
            ValueError: names the field.
        """
        checks.choice("evaluation.under_load.task", self.task, tuple(tasks))
        for index, name in enumerate(self.policies):
            checks.choice(f"evaluation.under_load.policies.{index}", name, tuple(policies))
        for name, values in (("policies", self.policies), ("parts", self.parts)):
            if len(set(values)) != len(values):
                raise checks.refuse(f"evaluation.under_load.{name}", values, "each once")
        for index, count in enumerate(self.parts):
            checks.count(f"evaluation.under_load.parts.{index}", count, most=10_000)


class EvaluationSettings(RunSettings):
    """An evaluation of policies on tasks, see :class:`agents.evaluation.run_settings.RunSettings`, and what its report shows.

    Attributes:
        effects: a study of which effect of the hardware breaks which policy, see :class:`EffectsSettings`.
        under_load: a study of parts a minute against the number of parts, see :class:`LoadSettings`.
        animations: whether the report holds an animation of each policy on each task.
        cost_per_period: whether it also says what one period costs with up to 64 parts, simulation and control apart.
    """

    effects: EffectsSettings | None = None
    under_load: LoadSettings | None = None
    animations: bool = True
    cost_per_period: bool = False

    def as_written(self) -> dict[str, Any]:
        """All of it as values for JSON, policies by their names."""
        written = super().as_written()
        if written["under_load"] is None:
            del written["under_load"]
        if written.pop("effects") is None:
            return written
        policies = written.pop("policies")
        return {**written, "effects": self.effects.model_dump(), "policies": policies}  # type: ignore[union-attr]

    def check(self) -> None:
        """The studies of effects and of load."""
        if self.under_load is not None:
            self.under_load.check(self.tasks, list(self.named_policies()))
        if self.effects is not None:
            checks.choice("evaluation.effects.task", self.effects.task, tuple(self.tasks))
            self.effects.columns(list(self.named_policies()))
            self.effects.arguments()


settings_from = EvaluationSettings.checked
load_settings = EvaluationSettings.load
