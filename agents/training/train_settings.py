"""Settings of a training run."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field, SerializeAsAny, model_serializer

from agents.training.hyperparameters import MOST_STEPS, NetworkSettings
from agents.training.imitation import ImitationSettings
from agents.training.outlines import OutlineSettings, scenes
from agents.training.residual_env import ResidualSettings
from vibgym import checks
from vibgym.config import Settings


class JudgingSettings(Settings):
    """How a learning curve is measured: deterministic episodes on the same seeds every time."""

    episodes: int = Field(100, ge=1, le=1_000_000)
    first_seed: int = Field(500_000, ge=0, le=2**31)
    every: int = Field(1_000_000, ge=1, le=MOST_STEPS)  # steps


class ServesSettings(Settings):
    """What else a policy may act on than what it was trained on."""

    tasks: list[str] | None = None  # names; None: the one that it was trained on
    surface: Literal["same", "any"] = "same"
    parts: Literal["same", "any"] = "same"  # their number


class TrainSettings(Settings):
    """One training run: task, environment, algorithm, length; see :func:`agents.training.training_file.settings_from`."""

    task: str  # see vibgym.envs.named.batch_of
    environment: dict[str, Any] = {"action": "patch"}
    worlds: int = Field(512, ge=1, le=100_000)
    steps: int = Field(ge=1, le=MOST_STEPS)
    seed: int = Field(0, ge=0, lt=2**32)  # NumPy's old generator, which Stable-Baselines3 seeds, takes no more
    checkpoint_steps: int = Field(500_000, ge=1, le=MOST_STEPS)
    output: str | None = None  # directory; default: runs/<name of the file>
    scenes: list[dict[str, Any]] = Field([], max_length=10_000)  # arguments on top of environment; worlds are dealt out
    outlines: OutlineSettings | None = None  # scenes that are drawn, in the place of those
    start: str | None = None  # path of a policy to begin with; {seed} in it is replaced by the run's
    imitation: ImitationSettings | None = None
    residual: ResidualSettings | None = None
    judging: JudgingSettings | None = None
    serves: ServesSettings = ServesSettings()
    algorithm: str = "ppo"  # among agents.training.algorithms.ALGORITHMS
    own: SerializeAsAny[Settings]  # the algorithm's, which stand in files under its name

    @property
    def network(self) -> NetworkSettings:
        """Of the parts' network, which PPO and learning from data sets have."""
        assert isinstance(self.own, NetworkSettings)
        return self.own

    def check_alone(self) -> None:
        """Refuse what goes before PPO alone, or beside it.

        Raises:
            ValueError: there is some.
        """
        for name, got in (("residual", self.residual), ("imitation", self.imitation), ("start", self.start)):
            if got is not None:
                raise checks.refuse(name, got, f"none with 'algorithm: {self.algorithm}'")

    @property
    def action(self) -> str:
        """What the policy speaks: the environment's action, or its default."""
        return self.environment.get("action", "element")

    @property
    def all_scenes(self) -> list[dict[str, Any]]:
        """The scenes that a run trains on, given or drawn; one without arguments where there are neither.

        Raises:
            ValueError: outlines that cannot be drawn, or both.
        """
        if self.outlines is None:
            return self.scenes or [{}]
        if self.scenes:
            raise checks.refuse("outlines", self.outlines.model_dump(), "nothing beside scenes")
        return scenes(**self.outlines.model_dump())

    @model_serializer(mode="wrap")
    def _as_in_files(self, plain: Any) -> dict[str, Any]:
        """The algorithm's own settings stand under its name."""
        return {self.algorithm if name == "own" else name: value for name, value in plain(self).items()}
