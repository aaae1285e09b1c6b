"""What is tuned, and how: the key ``tuning`` beside a training's hyperparameters."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import optuna
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution, IntDistribution
from pydantic import Field

from agents.training.train_settings import JudgingSettings, TrainSettings
from agents.training.training_file import load_settings, load_tuning
from vibgym import checks
from vibgym.config import Settings, parse

FIRST_SEED = 700_000
"""Of the episodes on which trials are judged: neither trainings nor reports nor tables see these."""


class TuningSettings(Settings):
    """A study of hyperparameters.

    Trial k is proposed from the results of the trials up to ``k - abreast``, whenever they were had and wherever: so the study
    is the same with one process, with many, on a cluster, and after any number of kills.
    """

    space: dict[str, Any] = Field(min_length=1)
    """Name of a setting, such as ``ppo.learning_rate`` -> a list of values, or a mapping with ``low``, ``high`` and ``log``."""

    trials: int = Field(40, ge=1, le=100_000)
    steps: int | None = Field(None, ge=1)  # of a trial's training; None: as many as the agent's
    seeds: list[int] = Field(
        [900_000], min_length=1, max_length=100
    )  # of a trial's trainings, whose values are averaged
    startup: int = Field(10, ge=0, le=100_000)  # trials that are drawn at random
    abreast: int = Field(2, ge=1, le=10_000)  # trials that may be under way at a time
    seed: int = Field(0, ge=0, lt=2**32)  # of what is proposed
    prune: bool = True  # stop trials that are worse than half of the others at the same number of steps
    judging: dict[str, Any] = {}  # of trials, on top of the agent's


class Tuning:
    """Settings of a study, checked.

    Args:
        path: of a training file.
        agent: which one of a file of many.

    Attributes:
        settings: of the study.
        agent, path: as given.
        base: settings of the agent itself.
        space: distribution of every setting that is tuned.

    Raises:
        ValueError: names file and field.
    """

    def __init__(self, path: Path, agent: str | None = None) -> None:
        self.path, self.agent = path, agent
        data, where = load_tuning(path, agent)
        if not isinstance(data, dict):
            raise checks.refuse(where, data, "a mapping with 'space': what is to be tuned")
        self.settings = parse(TuningSettings, data, where)
        self.base = load_settings(path, agent)
        self.space = {name: distribution(spec, f"{where}: space.{name}") for name, spec in self.settings.space.items()}
        self.of_trial({name: _one_of(each) for name, each in self.space.items()}, self.settings.seeds[0])

    def of_trial(self, values: dict[str, Any], seed: int) -> TrainSettings:
        """Settings of a trial's training, with these values of what is tuned.

        Raises:
            ValueError: values, or names, that a training refuses.
        """
        return load_settings(self.path, self.agent, seed, self.changes(values))

    def changes(self, values: dict[str, Any]) -> dict[str, Any]:
        """What a trial changes in the agent's settings."""
        judging = {} if self.base.judging is None else self.base.judging.model_dump()
        judging = JudgingSettings.model_validate({**judging, "first_seed": FIRST_SEED, **self.settings.judging})
        steps = {} if self.settings.steps is None else {"steps": self.settings.steps}
        return {"judging": judging.model_dump(), **steps, **values}

    def as_written(self) -> dict[str, Any]:
        """All that the study's results depend on, as values for JSON."""
        base = self.base.model_dump(mode="json")
        return {"tuning": self.settings.model_dump(mode="json", exclude={"trials"}), "agent": base}


def distribution(spec: Any, where: str) -> BaseDistribution:
    """What values a setting may take.

    Raises:
        ValueError: neither a list of values nor a range.
    """
    if isinstance(spec, list) and spec and all(isinstance(each, bool | int | float | str | None) for each in spec):
        return CategoricalDistribution(spec)
    allowed = "a list of values, or a mapping with 'low', 'high' and, if wanted, 'log: true'"
    if not isinstance(spec, dict) or not {"low", "high"} <= set(spec) <= {"low", "high", "log"}:
        raise checks.refuse(where, spec, allowed)
    low, high, log = spec["low"], spec["high"], spec.get("log", False)
    whole = all(isinstance(each, int) and not isinstance(each, bool) for each in (low, high))
    try:
        return IntDistribution(low, high, log) if whole else FloatDistribution(float(low), float(high), log)
    except (TypeError, ValueError) as error:
        raise checks.refuse(where, spec, f"{allowed} ({error})") from None


def _one_of(each: BaseDistribution) -> Any:
    """A value that is allowed."""
    if isinstance(each, CategoricalDistribution):
        return each.choices[0]
    assert isinstance(each, IntDistribution | FloatDistribution)
    return each.low


optuna.logging.set_verbosity(optuna.logging.WARNING)
