"""What an evaluation is asked to do: tasks, policies, seeds, and where the results go."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from vibgym import checks
from vibgym.config import Settings, load_yaml, parse

DEFAULT_EPISODES = 100
DEFAULT_FIRST_SEED = 100_000

ENVIRONMENT_KEYS = ("surface", "parts", "model", "actuators", "sensor", "randomize", "periods_per_step")
"""What an evaluation may set of the environment: action and observation belong to each policy."""


class EvaluationSettings(Settings):
    """An evaluation of every policy on every task, all on the same seeds.

    Attributes:
        tasks: names of tasks.
        policies: each a name ("zero"), the path of a trained policy, or a mapping of ``name`` (shown in the report),
            ``kind`` and the policy's own arguments, see :func:`agents.policy.make_policy`. From Python also objects that
            have ``predict``. Relative paths start from the current directory.
        episodes: number of episodes, with the seeds ``first_seed``, ``first_seed + 1``, ...
        first_seed: see above.
        seeds: the seeds themselves, instead of the two above.
        environment: keyword arguments of the environments, see :data:`ENVIRONMENT_KEYS`.
        confidence: level of the intervals.
        resamples: number of bootstrap resamples.
        output: directory for the results, made if needed.
        animations: whether the report holds an animation of each policy on each task.
    """

    tasks: list[Literal["Transport", "Align", "Rotate"]] = Field(min_length=1)
    policies: list[Any] = Field(min_length=1)
    episodes: int | None = Field(default=None, ge=1, le=100_000)
    first_seed: int | None = Field(default=None, ge=0, lt=2**63)
    seeds: list[int] | None = Field(default=None, min_length=1, max_length=100_000)
    environment: dict[str, Any] = {}
    confidence: float = Field(default=0.95, gt=0.0, lt=1.0)
    resamples: int = Field(default=9999, ge=100, le=1_000_000)
    output: str = Field(default="runs/report", min_length=1)
    animations: bool = True

    def seed_list(self) -> list[int]:
        """The seed of every episode."""
        if self.seeds is not None:
            return self.seeds
        first = DEFAULT_FIRST_SEED if self.first_seed is None else self.first_seed
        return list(range(first, first + (self.episodes or DEFAULT_EPISODES)))

    def named_policies(self) -> dict[str, Any]:
        """Name in the report -> what :func:`agents.policy.make_policy` takes."""
        result: dict[str, Any] = {}
        for index, policy in enumerate(self.policies):
            field = f"policies.{index}"
            name, content = _name_of(policy, field)
            if name in result:
                raise checks.refuse(f"{field}.name", name, "a name that no other policy has")
            result[name] = content
        return result


def _name_of(policy: Any, field: str) -> tuple[str, Any]:
    if hasattr(policy, "predict"):
        return str(getattr(policy, "name", type(policy).__name__)), policy
    if isinstance(policy, str):
        return Path(policy).stem if policy.endswith(".json") else policy, policy
    if not isinstance(policy, Mapping):
        raise checks.refuse(field, policy, "a name, the path of a trained policy, or a mapping with 'kind'")
    content = dict(policy)
    name = content.pop("name", content.get("kind"))
    if not isinstance(name, str) or not 0 < len(name) <= 40:
        raise checks.refuse(f"{field}.name", name, "a text of 1 to 40 characters")
    return name, content


def settings_from(data: Any, episodes: int | None = None, output: str | None = None) -> EvaluationSettings:
    """Checked settings from a mapping.

    Args:
        data: the mapping, with the attributes of :class:`EvaluationSettings` as keys.
        episodes: another number of episodes; of explicit seeds, the first ones.
        output: another output directory.

    Raises:
        ValueError: the first fault, in one line.
    """
    settings = parse(EvaluationSettings, data, "evaluation")
    for field in ("episodes", "first_seed"):
        if settings.seeds is not None and getattr(settings, field) is not None:
            raise checks.refuse(f"evaluation.{field}", getattr(settings, field), "nothing beside explicit 'seeds'")
    for field in ("tasks", "seeds"):
        values = getattr(settings, field) or []
        if len(set(values)) != len(values):
            twice = next(value for value in values if values.count(value) > 1)
            raise checks.refuse(f"evaluation.{field}", twice, "each value once")
    for index, seed in enumerate(settings.seeds or []):
        checks.count(f"evaluation.seeds.{index}", seed, least=0, most=2**63 - 1)
    for key in settings.environment:
        checks.choice("evaluation.environment", key, ENVIRONMENT_KEYS)
    settings.named_policies()
    changes: dict[str, Any] = {} if output is None else {"output": output}
    if episodes is not None:
        most = 100_000 if settings.seeds is None else len(settings.seeds)
        checks.count("--episodes", episodes, most=most)
        changes |= {"episodes": episodes} if settings.seeds is None else {"seeds": settings.seeds[:episodes]}
    return settings.model_copy(update=changes)


def load_settings(path: Path, episodes: int | None = None, output: str | None = None) -> EvaluationSettings:
    """Checked settings from a YAML file; see :func:`settings_from`. Errors name the file."""
    data = load_yaml(path)
    try:
        return settings_from(data, episodes, output)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
