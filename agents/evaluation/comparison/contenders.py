"""What a comparison is asked to do: who is compared with whom, on what, and what besides."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

from pydantic import Field

from agents.evaluation.comparison.studies import LadderSettings, MatrixSettings
from agents.evaluation.entries import MOST_NAME, PolicyEntry, policy_entry
from agents.evaluation.run_settings import RunSettings
from vibgym import checks

GROUPS = ("learned", "hybrid", "classical")
"""What a policy is. A hybrid is a learned residual on a classical one."""

OWN_KEYS = ("group", "training_seeds", "curve")
"""Of a policy's mapping, beside those that every evaluation knows."""

SEED = "{seed}"
TASK = "{task}"


@dataclass(frozen=True)
class Contender:
    """One policy of a comparison, with all the runs of its training.

    Attributes:
        entry: as an evaluation knows it; its texts may hold ``{seed}``.
        group: one of :data:`GROUPS`.
        training_seeds: of the runs; empty where there is one policy alone.
        curve: path of a run's learning curve, in which ``{task}`` and ``{seed}`` are replaced; None: there is none.
    """

    entry: PolicyEntry
    group: str
    training_seeds: tuple[int, ...]
    curve: str | None

    @property
    def name(self) -> str:
        """On the page."""
        return self.entry.name

    @property
    def seeds(self) -> tuple[int | None, ...]:
        """Training seeds; None alone where there is one policy."""
        return self.training_seeds or (None,)

    def run_name(self, seed: int | None) -> str:
        """Of the policy that one run gave."""
        return self.name if seed is None else f"{self.name}, seed {seed}"

    def content(self, seed: int | None) -> Any:
        """What :func:`vibgym.policies.registry.make_policy` takes for the policy that one run gave."""
        return self.entry.content if seed is None else _filled(self.entry.content, seed)

    def curve_path(self, task: str, seed: int | None) -> Path:
        """Of the learning curve of one run."""
        assert self.curve is not None
        path = self.curve.replace(TASK, task.lower())
        return Path(path if seed is None else path.replace(SEED, str(seed)))

    def runs(self) -> list[PolicyEntry]:
        """An entry for the policy of every run."""
        return [replace(self.entry, name=self.run_name(seed), content=self.content(seed)) for seed in self.seeds]


def _filled(content: Any, seed: int) -> Any:
    """``content`` with the training seed in all its texts."""
    if isinstance(content, str):
        return content.replace(SEED, str(seed))
    if isinstance(content, Mapping):
        return {key: _filled(value, seed) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_filled(value, seed) for value in content]
    return content


class ComparisonSettings(RunSettings):
    """A comparison of policies on the same seeds; what is run is as in :class:`agents.evaluation.run_settings.RunSettings`.

    A policy's mapping may also have ``group`` ("learned", "hybrid" or "classical"; by default trained policies are learned,
    corrections hybrid and all others classical), ``training_seeds``, a list of whole numbers that stand for ``{seed}`` in its
    paths, and ``curve``, the path of the learning curves, see :func:`.curves.read_curve`; ``{task}`` stands
    for the task's name in lower case.

    Attributes:
        power: chance with which the smallest detectable difference would have been found.
        generalisation: matrices of policies by cases, see :class:`agents.evaluation.comparison.studies.MatrixSettings`.
        ladders: lists of policies that differ in one thing, see :class:`agents.evaluation.comparison.studies.LadderSettings`.
    """

    where: ClassVar[str] = "comparison"

    power: float = Field(default=0.8, ge=0.5, lt=1.0)
    generalisation: list[MatrixSettings] = []
    ladders: list[LadderSettings] = []
    output: str = Field(default="runs/comparison", min_length=1)

    def contenders(self) -> list[Contender]:
        """The policies, checked."""
        found: list[Contender] = []
        for index, policy in enumerate(self.policies):
            each = contender(policy, f"comparison.policies.{index}", self.tasks, list(self.named_hardware()))
            if any(each.name == other.name for other in found):
                raise checks.refuse(f"comparison.policies.{index}.name", each.name, "a name that no other policy has")
            found.append(each)
        return found

    def entries(self) -> list[PolicyEntry]:
        """One for every run of every policy."""
        found = [entry for each in self.contenders() for entry in each.runs()]
        names = [entry.name for entry in found]
        for name in names:
            if names.count(name) > 1:
                raise checks.refuse("comparison.policies", name, "names that no run of another policy has")
        return found

    def contender_of(self, name: str) -> Contender:
        """By its name."""
        return next(each for each in self.contenders() if each.name == name)

    def check(self) -> None:
        """Matrices and ladders."""
        names = [each.name for each in self.contenders()]
        titles: list[str] = []
        studies = (("generalisation", self.generalisation), ("ladders", self.ladders))
        for field, index, study in ((name, k, each) for name, studies in studies for k, each in enumerate(studies)):
            where = f"comparison.{field}.{index}"
            if study.name in titles:
                raise checks.refuse(f"{where}.name", study.name, "a name that no other matrix or ladder has")
            titles.append(checks.label(f"{where}.name", study.name))
            study.check(where, self.tasks, list(self.named_hardware()), names)
            for name in study.named():
                if isinstance(study, LadderSettings) and self.contender_of(name).curve is None:
                    allowed = "policies with 'curve': a ladder shows what the same budget of steps has led to"
                    raise checks.refuse(f"{where}.policies", name, allowed)

    def written_policies(self) -> dict[str, Any]:
        """With what only a comparison knows of them."""
        return {
            each.name: {
                "policy": each.entry.content,
                **each.entry.limits,
                **{key: value for key in OWN_KEYS if (value := getattr(each, key))},
            }
            for each in self.contenders()
        }


def contender(policy: Any, field: str, tasks: list[str], hardware: list[str]) -> Contender:
    """A policy of the settings.

    Raises:
        ValueError: names the field.
    """
    own: dict[str, Any] = {}
    if isinstance(policy, Mapping):
        own = {key: policy[key] for key in OWN_KEYS if key in policy}
        policy = {key: value for key, value in policy.items() if key not in OWN_KEYS}
    entry = policy_entry(policy, field, tasks, hardware)
    checks.label(f"{field}.name", entry.name, most=MOST_NAME)
    group = checks.choice(f"{field}.group", own.get("group", _usual_group(entry.content)), GROUPS)
    seeds = own.get("training_seeds", ())
    if "training_seeds" in own:
        if group == "classical":
            raise checks.refuse(
                f"{field}.training_seeds", seeds, "nothing where nothing is trained: 'group' is classical"
            )
        if not isinstance(seeds, list | tuple) or not 2 <= len(seeds) <= 100:
            raise checks.refuse(f"{field}.training_seeds", seeds, "a list of 2 to 100 whole numbers")
        for each in seeds:
            checks.count(f"{field}.training_seeds", each, least=0, most=2**63 - 1)
            if seeds.count(each) > 1:
                raise checks.refuse(f"{field}.training_seeds", each, "each seed once")
    curve = own.get("curve")
    if "curve" in own and (not isinstance(curve, str) or not curve):
        raise checks.refuse(f"{field}.curve", curve, "the path of a learning curve's file")
    for what, value in (("policy", entry.content), ("curve", curve)):
        if value is not None and (_filled(value, 0) != value) != bool(seeds):
            allowed = f"paths with {SEED} where there are 'training_seeds', and nowhere else"
            raise checks.refuse(f"{field} ({what})", value, allowed)
    return Contender(entry, group, tuple(seeds), curve)


def _usual_group(content: Any) -> str:
    """A trained policy's file, that of a correction, or anything else."""
    kind = content.get("kind") if isinstance(content, Mapping) else content
    if kind == "residual":
        return "hybrid"
    return "learned" if kind == "trained" or (isinstance(kind, str) and kind.endswith(".json")) else "classical"


settings_from = ComparisonSettings.checked
load_settings = ComparisonSettings.load
