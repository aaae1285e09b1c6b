"""The protocol of a suite: tasks, seeds, hardware, statistics, and who takes part."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

from pydantic import Field

from agents.evaluation.entries import HardwareEntry, PolicyEntry, policy_entry
from agents.evaluation.run_settings import RunSettings
from vibgym import checks
from vibgym.config import load_yaml


class SuiteSettings(RunSettings):
    """A suite; what is run is as in :class:`agents.evaluation.run_settings.RunSettings`.

    Every policy is asked for every task, on all hardware: on a task that it does not serve its score is 0. A policy's mapping
    may say ``training_steps``, what it has been trained on, and ``episodes``: at most so many of each task.

    Attributes:
        training_steps: steps of environments, all tasks together, that a policy may have been trained on.
    """

    where: ClassVar[str] = "suite"

    training_steps: int = Field(ge=1)
    output: str = Field(default="runs/suite", min_length=1)

    def entries(self) -> list[PolicyEntry]:
        """The policies, checked."""
        found: list[PolicyEntry] = []
        for index, policy in enumerate(self.policies):
            field = f"suite.policies.{index}"
            entry = policy_entry(self._without_own(policy, field), field, self.tasks, list(self.named_hardware()))
            checks.label(f"{field}.name", entry.name)
            if any(entry.name == other.name for other in found):
                raise checks.refuse(f"{field}.name", entry.name, "a name that no other policy has")
            found.append(entry)
        return found

    def _without_own(self, policy: Any, field: str) -> Any:
        """What every evaluation knows of a policy; its own numbers are checked."""
        if not isinstance(policy, Mapping):
            return policy
        for name, least, most in (("training_steps", 0, self.training_steps), ("episodes", 1, 100_000)):
            if name in policy:
                checks.count(f"{field}.{name}", policy[name], least=least, most=most)
        return {key: value for key, value in policy.items() if key not in ("training_steps", "episodes")}

    def seeds_of(self, task: str, machine: HardwareEntry, policy: int) -> list[int]:
        """Seeds of a task's episodes on some hardware; ``policy``: the number of an entry."""
        given = self.policies[policy]
        own = given.get("episodes") if isinstance(given, Mapping) else None
        return self.seed_list(task, machine.episodes)[:own]

    def entered_by(self, path: Path) -> SuiteSettings:
        """The same protocol for one policy alone: what stands in a file.

        Args:
            path: YAML or JSON, a mapping as ``policies`` has them; or the JSON file of a trained policy.

        Raises:
            ValueError: the file cannot be read, or holds no policy.
        """
        content = load_yaml(path)
        if "kind" not in content:
            if path.suffix != ".json":
                raise checks.refuse(
                    str(path), sorted(content), "a mapping with 'kind', or a trained policy's JSON file"
                )
            content = {"kind": "trained", "path": str(path)}
        entered = self.model_copy(update={"policies": [{"name": path.stem, **content}]})
        with checks.within(path):
            entered.entries()
        return entered


settings_from = SuiteSettings.checked
load_settings = SuiteSettings.load
