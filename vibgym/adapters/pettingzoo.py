"""Environments with PettingZoo's parallel API: each part is an agent. PettingZoo is the extra ``multiagent``.

Importing this module registers the environments with PettingZoo: ``pettingzoo.make("parallel", "vibgym/Sort-v0")``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from pettingzoo import ParallelEnv, parallel_registry, register

from vibgym import checks
from vibgym.adapters.credit import credits_parts
from vibgym.envs.observations import PartsObservation
from vibgym.envs.options import RESET_OPTIONS
from vibgym.envs.single import VibgymEnv
from vibgym.envs.vector import creator, registered_id
from vibgym.registration import ENVIRONMENTS


def parallel_env(
    name: str,
    *,
    max_episode_steps: int | None = None,
    render_mode: str | None = None,
    keep_absent: bool = False,
    **options: Any,
) -> PartsParallelEnv:
    """Create an environment whose agents are its parts.

    Args:
        name: id of a registered environment, such as ``"vibgym/Sort-v0"``, or its short name, ``"Sort"``.
        max_episode_steps: as for ``gym.make``.
        keep_absent: see :class:`PartsParallelEnv`.
        render_mode, options: as for :class:`vibgym.envs.VibgymEnv`, except ``observation``. ``action`` has values per part:
            ``"wrench"`` (default), ``"velocity"``, ``"target"``, ``"patch"``, ``"field"``.

    Raises:
        ValueError: an unknown environment, or an invalid setting.
    """
    name = registered_id(name, "name")
    if "observation" in options:
        raise checks.conflict("observation cannot be set for parallel_env: agents observe by parts")
    keywords = {"action": "wrench", **options, "observation": "parts", "render_mode": render_mode}
    spec = gym.registry[name]
    if (reason := checks.misfit(creator(spec.entry_point), **{**spec.kwargs, **keywords})) is not None:
        raise checks.refuse("name", name, f"an environment of vibgym ({reason})")
    made = gym.make(name, max_episode_steps=max_episode_steps, disable_env_checker=True, **keywords)
    return PartsParallelEnv(made, keep_absent=keep_absent)


class PartsParallelEnv(ParallelEnv):
    """The parts of an environment as agents ``"part_0"``, ``"part_1"``, ..., which act simultaneously.

    - Observation: the part's row of the observation by parts; ``env.unwrapped.parts_layout`` describes its numbers.
    - Action: the part's share of the action.
    - Reward: that of the part, ``info["parts"]["reward"]``, or of the world if a wrapper changes rewards, see
      :func:`vibgym.adapters.credit.credits_parts`.
    - ``infos``: ``present``, ``done``, ``fallen`` and ``reward_terms`` of the part, ``is_success`` of the episode.

    An episode ends for all agents at once. Parts that are absent in an episode have no agent in it, or with ``keep_absent`` one
    with zero observations and rewards, whose actions have no effect. Parts that the task does not drive have none at all. In
    tasks with parts that arrive and leave, the observation of an agent without a part is zero.

    Args:
        env: a single environment made with ``observation="parts"``, possibly wrapped.
        keep_absent: whether parts that are absent in an episode are agents too, for libraries whose agents stay the same.

    Attributes:
        possible_agents: one for each driven part.  agents: those of the running episode; empty after its end.
        state_space: of :meth:`state`.

    Raises:
        ValueError: another observation, or an action without values per part.
    """

    def __init__(self, env: gym.Env, *, keep_absent: bool = False) -> None:
        base = env.unwrapped
        if not isinstance(base, VibgymEnv) or not isinstance(base.core.observation, PartsObservation):
            raise checks.refuse("env", env, "an environment of one world made with observation='parts'")
        acting = base.core.action
        if not acting.by_part:
            kind = type(acting).__name__.lower()
            raise checks.conflict(f"action {kind!r} has no values per part, as 'wrench' has")
        self.env, self._base, self._credits_parts = env, base, credits_parts(env)
        self._keep_absent, self._playing = checks.flag("keep_absent", keep_absent), base.task.driven
        self._shape = acting.shape[1:]
        self._share = acting.size // len(base.parts)
        self.possible_agents = [f"part_{part}" for part in np.flatnonzero(base.task.driven)]
        self.agents: list[str] = []
        self.render_mode = base.render_mode
        name = base.task.name if env.spec is None else env.spec.id
        self.metadata = {**base.metadata, "name": name, "is_parallelizable": True}
        # One space per agent: PettingZoo seeds each of them.
        size = base.core.observation.row_layout.block
        self.observation_spaces = {agent: spaces.Box(-1.0, 1.0, (size,), np.float32) for agent in self.possible_agents}
        self.action_spaces = {
            agent: spaces.Box(-1.0, 1.0, (self._share,), np.float32) for agent in self.possible_agents
        }
        self.state_space = spaces.Box(-1.0, 1.0, (base.task.slots, size), np.float32)
        self._rows = np.zeros((base.task.slots, size), dtype=np.float32)

    def observation_space(self, agent: str) -> spaces.Space:
        """Return the observation space of an agent; always the same object."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space:
        """Return the action space of an agent; always the same object."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, dict[str, Any]]]:
        """Begin an episode.

        Args:
            seed: of this and the following episodes; None continues the generator.
            options: of the start, as for :meth:`vibgym.envs.VibgymEnv.reset`. Other keys are ignored with a warning.

        Raises:
            ValueError: an invalid seed or start; nothing has changed.
        """
        known = None
        if options is not None:
            known = {key: value for key, value in options.items() if key in RESET_OPTIONS}
            foreign = sorted(map(str, options.keys() - known.keys()))
            if foreign:
                gym.logger.warn(
                    f"reset(): options {', '.join(foreign)} are ignored; known are {', '.join(RESET_OPTIONS)}"
                )
        seen, info = self.env.reset(seed=seed, options=known or None)
        self._playing = self._base.core.scoring.players[0].copy()
        self.agents = [agent for agent in self.possible_agents if self._keep_absent or self._playing[self._part(agent)]]
        self._rows = seen["parts"]
        return self._observations(), self._infos(info)

    def step(
        self, actions: Mapping[str, Any]
    ) -> tuple[dict[str, np.ndarray], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Advance by one step.

        Args:
            actions: one for each of :attr:`agents`, flat or in the shape of its share.

        Returns:
            Observations, rewards, terminations, truncations and infos, each by agent.

        Raises:
            ValueError: a missing or additional agent, a wrong shape, or numbers that are not finite.
            gymnasium.error.ResetNeeded: no episode is running.
        """
        if not self.agents:
            raise gym.error.ResetNeeded("call reset() before step(): no episode is running")
        seen, reward, terminated, truncated, info = self.env.step(self._action(actions))
        self._rows = seen["parts"]
        rewards = info["parts"]["reward"] if self._credits_parts else float(reward) * self._playing
        result = (
            self._observations(),
            {agent: float(rewards[self._part(agent)]) for agent in self.agents},
            dict.fromkeys(self.agents, bool(terminated)),
            dict.fromkeys(self.agents, bool(truncated)),
            self._infos(info),
        )
        if terminated or truncated:
            self.agents = []
        return result

    def state(self) -> np.ndarray:
        """Return the rows of all parts, (slots, row size), for centralised critics; zeros for absent ones."""
        return self._rows.copy()

    def render(self) -> Any:
        """Render the environment."""
        return self.env.render()

    def close(self) -> None:
        """Close the environment."""
        self.env.close()

    def _part(self, agent: str) -> int:
        return int(agent.removeprefix("part_"))

    def _action(self, actions: Any) -> np.ndarray:
        """Return the flat action of the environment; zeros for absent parts, which command nothing."""
        if not isinstance(actions, Mapping) or set(actions) != set(self.agents):
            got = sorted(map(str, actions)) if isinstance(actions, Mapping) else actions
            raise checks.refuse("actions", got, f"a mapping with exactly the keys {', '.join(self.agents)}")
        together = np.zeros((len(self._base.parts), self._share), dtype=np.float32)
        for agent, action in actions.items():
            name, allowed = f"actions[{agent!r}]", f"finite numbers of shape {(self._share,)} or {self._shape}"
            values = checks.shaped(name, action, ((self._share,), self._shape), "finite numbers")
            if not np.isfinite(values).all():
                raise checks.refuse(name, action, allowed)
            together[self._part(agent)] = np.clip(values, -1.0, 1.0).ravel()
        together[~self._playing] = 0.0
        return together.ravel()

    def _observations(self) -> dict[str, np.ndarray]:
        return {agent: self._rows[self._part(agent)].copy() for agent in self.agents}

    def _infos(self, info: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
        reported, infos = info["parts"], {}
        for agent in self.agents:
            part = self._part(agent)
            infos[agent] = {
                "present": bool(reported["present"][part]),
                "done": bool(reported["done"][part]),
                "fallen": bool(reported["fallen"][part]),
                "reward_terms": {name: float(values[part]) for name, values in reported["reward_terms"].items()},
                "is_success": info["is_success"],
            }
        return infos


for _name in ENVIRONMENTS:
    if f"vibgym/{_name}-v0" not in parallel_registry:  # no warning if the module is loaded again
        register("parallel", f"vibgym/{_name}-v0", entry_point=parallel_env, kwargs={"name": _name})
