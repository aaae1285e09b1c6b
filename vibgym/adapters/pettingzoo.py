"""Each part an agent: environments as PettingZoo's parallel API has them. PettingZoo is the extra ``multiagent``.

Once this module is imported, ``pettingzoo.make("parallel", "vibgym/Sort-v0")`` makes them, too.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Unpack

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from pettingzoo import ParallelEnv, parallel_registry, register

from vibgym import checks
from vibgym.adapters.credit import credits_parts
from vibgym.envs.observations import PartsObservation
from vibgym.envs.options import RESET_OPTIONS, Keywords
from vibgym.envs.single import VibgymEnv
from vibgym.envs.vector import environment_id
from vibgym.registration import ENVIRONMENTS


def parallel_env(
    name: str, *, max_episode_steps: int | None = None, render_mode: str | None = None, **options: Unpack[Keywords]
) -> PartsParallelEnv:
    """Make an environment whose agents are its parts.

    Args:
        name: id of a registered environment, such as ``"vibgym/Sort-v0"``, or ``"Sort"`` for that.
        max_episode_steps: instead of the environment's own limit.
        render_mode, options: as for :class:`vibgym.envs.VibgymEnv`, but ``observation``. ``action`` is one that has a
            share for every part: ``"wrench"`` (default), ``"patch"``, ``"field"``.

    Raises:
        ValueError: there is no such environment, or a bad setting.
    """
    name = environment_id(name, "name")
    if name not in gym.registry:
        raise checks.unknown("name", name, [spec.id for spec in gym.registry.values() if spec.namespace == "vibgym"])
    if "observation" in options:
        raise checks.conflict("observation cannot be set for parallel_env: agents observe by parts")
    keywords = {"action": "wrench", **options, "observation": "parts", "render_mode": render_mode}
    made = gym.make(name, max_episode_steps=max_episode_steps, disable_env_checker=True, **keywords)
    return PartsParallelEnv(made)


class PartsParallelEnv(ParallelEnv):
    """The parts of an environment as agents ``"part_0"``, ``"part_1"``, ..., which act at once.

    An agent sees its part's row of the observation by parts (``env.unwrapped.parts_layout`` explains the numbers), acts by its
    share of the action, and earns its part's reward, ``info["parts"]["reward"]``. Agents whose parts are not there in an
    episode are not in :attr:`agents`, and parts that the task does not drive have none. An episode ends for all at once: when
    the task is done, a part has fallen, the simulation has diverged, or at the limit. Where parts arrive and leave an agent
    waits, with a row of zeros, for the next part that is its own.

    Every agent is paid for its part alone, or the world's reward where a wrapper has changed it, see
    :func:`vibgym.adapters.credit.credits_parts`. ``infos`` tell every agent ``present``, ``done`` and ``fallen`` of its part,
    its ``reward_terms``, and ``is_success`` of the episode.

    Args:
        env: a single environment, with Gymnasium's wrappers or without, made with ``observation="parts"``.

    Attributes:
        env: that.
        possible_agents: one for each part.  agents: those of the episode that goes on; none after its end.
        state_space: of :meth:`state`.

    Raises:
        ValueError: another observation, or an action of which parts have no shares.
    """

    def __init__(self, env: gym.Env) -> None:
        base = env.unwrapped
        if not isinstance(base, VibgymEnv) or not isinstance(base.core.observation, PartsObservation):
            raise checks.refuse("env", env, "an environment of one world made with observation='parts'")
        acting = base.core.action
        if not acting.by_part:
            kind = type(acting).__name__.lower()
            raise checks.conflict(f"action {kind!r} has no values per part, as 'wrench' has")
        self.env, self._base, self._credits_parts = env, base, credits_parts(env)
        self._shape = acting.shape[1:]
        self._share = acting.size // len(base.parts)
        self.possible_agents = [f"part_{part}" for part in np.flatnonzero(base.task.driven)]
        self.agents: list[str] = []
        self.render_mode = base.render_mode
        name = base.task.name if env.spec is None else env.spec.id
        self.metadata = {**base.metadata, "name": name, "is_parallelizable": True}
        # One space an agent: PettingZoo seeds them one by one.
        size = base.core.observation.row_layout.block
        self.observation_spaces = {agent: spaces.Box(-1.0, 1.0, (size,), np.float32) for agent in self.possible_agents}
        self.action_spaces = {
            agent: spaces.Box(-1.0, 1.0, (self._share,), np.float32) for agent in self.possible_agents
        }
        self.state_space = spaces.Box(-1.0, 1.0, (base.task.slots, size), np.float32)
        self._rows = np.zeros((base.task.slots, size), dtype=np.float32)

    def observation_space(self, agent: str) -> spaces.Space:
        """Of an agent; always the same object."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space:
        """Of an agent; always the same object."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, dict[str, Any]]]:
        """Begin an episode.

        Args:
            seed: of this and the following episodes; None goes on with the generator.
            options: of the start, as for :meth:`vibgym.envs.VibgymEnv.reset`. Other keys are for others, as PettingZoo wants
                it, and ignored with a warning.

        Raises:
            ValueError: a bad seed, or a start that cannot be; nothing has changed.
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
        players = self._base.core.scoring.players[0]
        self.agents = [agent for agent in self.possible_agents if players[self._part(agent)]]
        self._rows = seen["parts"]
        return self._observations(), self._infos(info)

    def step(
        self, actions: Mapping[str, Any]
    ) -> tuple[dict[str, np.ndarray], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Let all agents act at once.

        Args:
            actions: of every one of :attr:`agents`, flat or in the shape of its share.

        Returns:
            Observations, rewards, terminations, truncations and infos, each by agent.

        Raises:
            ValueError: an agent's action is missing, of a wrong shape or no finite numbers, or someone else's is there.
            gymnasium.error.ResetNeeded: no episode goes on.
        """
        if not self.agents:
            raise gym.error.ResetNeeded("call reset() before step(): no episode goes on")
        seen, reward, terminated, truncated, info = self.env.step(self._action(actions))
        self._rows = seen["parts"]
        rewards = info["parts"]["reward"] if self._credits_parts else [reward] * len(self._base.parts)
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
        """(slots, numbers of a row) the rows of all parts, for critics that see everything; zeros of absent ones."""
        return self._rows.copy()

    def render(self) -> Any:
        """As the environment's."""
        return self.env.render()

    def close(self) -> None:
        """As the environment's."""
        self.env.close()

    def _part(self, agent: str) -> int:
        return int(agent.removeprefix("part_"))

    def _action(self, actions: Any) -> np.ndarray:
        """The environment's action, (all numbers,): zeros for parts that are not there, which command nothing."""
        if not isinstance(actions, Mapping) or set(actions) != set(self.agents):
            got = sorted(map(str, actions)) if isinstance(actions, Mapping) else actions
            raise checks.refuse("actions", got, f"a mapping with exactly the keys {', '.join(self.agents)}")
        together = np.zeros((len(self._base.parts), self._share), dtype=np.float32)
        for agent, given in actions.items():
            name, allowed = f"actions[{agent!r}]", f"finite numbers of shape {(self._share,)} or {self._shape}"
            values = checks.shaped(name, given, ((self._share,), self._shape), "finite numbers")
            if not np.isfinite(values).all():
                raise checks.refuse(name, given, allowed)
            together[self._part(agent)] = np.clip(values, -1.0, 1.0).ravel()
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
    if f"vibgym/{_name}-v0" not in parallel_registry:  # a module that is loaded again must not warn
        register("parallel", f"vibgym/{_name}-v0", entry_point=parallel_env, kwargs={"name": _name})
