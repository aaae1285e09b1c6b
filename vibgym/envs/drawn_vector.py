"""Batches of environments whose shapes are drawn: Gymnasium's batch of single ones, with the interface of the native batch."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv

from vibgym import checks
from vibgym.envs.features import Numbers
from vibgym.envs.options import step_limit
from vibgym.envs.shared import Described
from vibgym.envs.single import VibgymEnv
from vibgym.envs.vector import VibgymVectorEnv, autoreset_mode_from, seeds_from
from vibgym.scene.parts import Part
from vibgym.snapshots import check_keys, copied, put_back, restored


class DrawnVectorEnv(Described, SyncVectorEnv):
    """Batch of single environments, each of which draws its shapes; bit-identical to them.

    Args:
        task, options: of :class:`vibgym.envs.VibgymEnv`.
        num_envs: number of environments.
        max_episode_steps, autoreset_mode: as for :class:`vibgym.envs.VibgymVectorEnv`.

    Raises:
        ValueError: an invalid setting.
    """

    def __init__(
        self,
        task: str,
        num_envs: int = 1,
        *,
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        **options: Any,
    ) -> None:
        count = checks.count("num_envs", num_envs)
        mode, single = autoreset_mode_from(autoreset_mode), partial(_single, task, max_episode_steps, options)
        super().__init__([single] * count, autoreset_mode=mode)
        self.max_episode_steps = self.singles[0].max_episode_steps

    @property
    def singles(self) -> list[VibgymEnv]:
        """The environments."""
        return list(self.envs)  # type: ignore[arg-type]

    @property
    def parts(self) -> tuple[Part, ...]:
        """The parts of the first environment; others have other shapes."""
        return self.singles[0].parts

    @property
    def observation_layout(self) -> tuple[Numbers, ...]:
        """See :attr:`vibgym.envs.VibgymEnv.observation_layout`."""
        return self.singles[0].observation_layout

    @property
    def parts_layout(self) -> tuple[Numbers, ...]:
        """See :attr:`vibgym.envs.VibgymEnv.parts_layout`."""
        return self.singles[0].parts_layout

    @property
    def action_shape(self) -> tuple[int, ...]:
        """Shape of an action of one environment."""
        return self.singles[0].action_shape

    def observed(self, kind: str) -> Any:
        """Return a batch of another observation of the same instant, see :meth:`vibgym.envs.VibgymEnv.observed`."""
        seen = [env.observed(kind) for env in self.singles]
        if isinstance(seen[0], dict):
            return {name: np.stack([each[name] for each in seen]) for name in seen[0]}
        return np.stack(seen)

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin episodes, see :meth:`vibgym.envs.VibgymVectorEnv.reset`; ``options`` apply to every environment.

        Raises:
            ValueError: an invalid seed, option or start; nothing has changed.
        """
        seeds, before = seeds_from(seed, self.num_envs), self.get_state() if options else None
        try:
            return super().reset(seed=seeds, options=None if options is None else dict(options))
        except ValueError:
            if before is not None:
                self.set_state(before)
            raise

    def step(self, actions: Any) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Advance all environments by one step.

        Raises:
            ValueError: an invalid action; nothing has changed.
        """
        return super().step(self.singles[0].core.action.check(actions, self.num_envs))

    def get_state(self) -> dict[str, Any]:
        """Return a snapshot that continues bit for bit."""
        return {"envs": [env.get_state() for env in self.singles], **copied(self._flags())}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore a snapshot of an environment with the same settings and number of worlds.

        Raises:
            ValueError: a snapshot of another environment; nothing has changed.
        """
        check_keys("state", state, ("envs", *self._flags()))
        flags = restored("state", self._flags(), {name: state[name] for name in self._flags()})
        if not checks.listed(state["envs"]) or len(state["envs"]) != self.num_envs:
            raise checks.refuse("state['envs']", state["envs"], f"a list of {self.num_envs} snapshots")
        before = [env.get_state() for env in self.singles]
        try:
            self._set_states(state["envs"])
        except ValueError:
            self._set_states(before)
            raise
        put_back(self._flags(), flags)

    def _flags(self) -> dict[str, np.ndarray]:
        return {
            "terminated": self._terminations, "truncated": self._truncations, "finished": self._autoreset_envs,
        }  # fmt: skip

    def _set_states(self, states: Any) -> None:
        for single, own in zip(self.singles, states, strict=True):
            single.set_state(own)


def _single(task: str, max_episode_steps: int | None, options: dict[str, Any]) -> VibgymEnv:
    env = VibgymEnv(task, **copy.deepcopy(options))
    env.max_episode_steps = step_limit(max_episode_steps, env.periods_per_step, options.get("max_episode_periods"))
    return env


def make_vector(task: str, num_envs: int = 1, **options: Any) -> VectorEnv:
    """Return a batch of an environment with drawn shapes, or the native one if shapes are fixed."""
    drawn = options.get("split") is not None and options.get("shapes") is None
    return (DrawnVectorEnv if drawn else VibgymVectorEnv)(task, num_envs, **options)
