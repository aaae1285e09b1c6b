"""TorchRL environment over the native batch: worlds x parts, the parts as agents of the group ``"parts"``.

TorchRL is the extra ``learners``. :attr:`BatchEnv.group_map` is that of TorchRL's multi-agent environments.
"""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from tensordict import TensorDict, TensorDictBase
from torchrl.data import Binary, Bounded, Composite, Unbounded
from torchrl.envs import EnvBase

from vibgym import checks
from vibgym.adapters.credit import credits_parts
from vibgym.envs.vector import VibgymVectorEnv, batch_of, seeds_from

GROUP = "parts"


class BatchEnv(EnvBase):
    """Native vector environment as a batched multi-agent environment.

        env = BatchEnv("vibgym/Swap-v0", num_envs=256, action="velocity", parts=["steel_block", "aluminium_block"] * 3)

    Keys of a step, with the shape (num_envs, parts, ...) in the group ``"parts"``:

    - ``("parts", "observation")``: the part's row of the observation by parts; ``env.parts_layout`` describes its numbers.
    - ``("parts", "mask")``: whether the part is in the episode.
    - ``("parts", "action")``: the part's share of the action.
    - ``("next", "parts", "reward")``: ``info["parts"]["reward"]``, or the world's reward if a wrapper changes rewards.
    - ``("next", "parts", "cost")``: the part's share of the costs, with ``costs``.
    - ``("next", "parts", "at_goal")``: whether the part is at its goal, or in its zone.
    - ``"done"``, ``"terminated"``, ``"truncated"``, ``("next", "success")``: of the world, (num_envs, 1).

    ``set_seed(s)`` gives world k the seed ``s + k`` at its next reset. All worlds advance together: a rollout with
    ``break_when_all_done`` raises ``gymnasium.error.ResetNeeded`` once a world has ended before the others.

    Args:
        env: id of a registered environment, or a vector environment of vibgym, possibly wrapped, with
            ``autoreset_mode="Disabled"`` and ``observation="parts"``.
        num_envs: number of worlds; requires an id.
        device: of the tensors; the simulation runs on the processor.
        **settings: of ``gym.make_vec``, with an id. ``action`` has values per part, ``"velocity"`` by default.

    Attributes:
        env: the vector environment.  group_map: group -> names of its agents.

    Raises:
        ValueError: an action without values per part, another observation or mode, a task without driven parts, or settings
            without an id.
    """

    def __init__(self, env: Any, *, num_envs: int | None = None, device: Any = "cpu", **settings: Any) -> None:
        if isinstance(env, str):
            if "observation" in settings or "autoreset_mode" in settings:
                raise checks.conflict("observation and autoreset_mode cannot be set: agents observe by parts")
            settings = {"action": "velocity", **settings, "observation": "parts", "autoreset_mode": "Disabled"}
            env = batch_of(env, num_envs=checks.count("num_envs", 1 if num_envs is None else num_envs), **settings)
        elif num_envs is not None or settings:
            raise checks.conflict(f"settings {sorted(settings)} require the id of an environment, not an environment")
        inner = env.unwrapped
        if not isinstance(inner, VibgymVectorEnv):
            raise checks.refuse("env", inner, "a VibgymVectorEnv")
        mode = env.metadata.get("autoreset_mode")
        if mode is not AutoresetMode.DISABLED:
            raise checks.refuse("env.autoreset_mode", mode, "AutoresetMode.DISABLED")
        space = env.single_observation_space
        if not isinstance(space, gym.spaces.Dict) or set(space.spaces) != {"parts", "mask"}:
            raise checks.refuse("env.observation", space, "that of observation='parts'")
        core = inner.core
        if not core.action.by_part:
            raise checks.refuse("action", core.options.action, "an action with values per part, such as 'velocity'")
        self._driven = np.flatnonzero(core.task.driven)
        if not len(self._driven):
            raise checks.conflict(f"task {core.task.name!r} has no parts that actions drive: no agents")
        if core.task.slots != len(core.parts):
            raise checks.conflict("slots cannot be set: every part is an agent")
        super().__init__(device=device, batch_size=torch.Size([env.num_envs]))
        columns = space["parts"].shape
        assert columns is not None
        self.env, self.parts_layout = env, inner.parts_layout
        self._credits, self._costs = credits_parts(env), core.costs is not None
        self._parts, self._numbers = len(core.parts), core.action.size // len(core.parts)
        self.group_map = {GROUP: [f"part_{k}" for k in self._driven]}
        self._set_seed(None)
        self._make_specs(columns[1])

    def _make_specs(self, columns: int) -> None:
        shape, device, truth = self.batch_size, self.device, torch.bool
        lead = torch.Size([*shape, len(self._driven)])
        one, of_world = torch.Size([*lead, 1]), torch.Size([*shape, 1])
        own: dict[str, Any] = {
            "observation": Bounded(-1.0, 1.0, torch.Size([*lead, columns]), device, torch.float32),
            "mask": Binary(1, one, device, truth),
            "at_goal": Binary(1, one, device, truth),
        }
        if self._costs:
            own["cost"] = Unbounded(one, device, torch.float32)
        action = Bounded(-1.0, 1.0, torch.Size([*lead, self._numbers]), device, torch.float32)
        seen = {GROUP: Composite(own, shape=lead, device=device), "success": Binary(1, of_world, device, truth)}
        flags = {name: Binary(1, of_world, device, truth) for name in ("done", "terminated", "truncated")}
        self.observation_spec = Composite(seen, shape=shape, device=device)
        self.action_spec = self._of_group("action", action, lead)
        self.reward_spec = self._of_group("reward", Unbounded(one, device, torch.float32), lead)
        self.done_spec = Composite(flags, shape=shape, device=device)

    def _of_group(self, name: str, spec: Any, lead: torch.Size) -> Composite:
        """Return a spec of the group as one of the environment."""
        own = Composite({name: spec}, shape=lead, device=self.device)
        return Composite({GROUP: own}, shape=self.batch_size, device=self.device)

    def _set_seed(self, seed: int | None) -> None:
        self._seeds = seeds_from(seed, self.batch_size[0])

    def _reset(self, tensordict: TensorDictBase | None = None, **kwargs: Any) -> TensorDictBase:
        mask = np.ones(self.batch_size[0], dtype=bool)
        if tensordict is not None and "_reset" in tensordict.keys():
            mask = tensordict["_reset"].reshape(-1).cpu().numpy()
        seeds = [seed if begins else None for seed, begins in zip(self._seeds, mask)]
        seen, info = self.env.reset(seed=seeds, options=None if mask.all() else {"reset_mask": mask})
        self._seeds = [None if begins else seed for seed, begins in zip(self._seeds, mask)]
        result = self._observed(seen, info, np.zeros((self.batch_size[0], self._parts), dtype=np.float32))
        worlds = torch.zeros((*self.batch_size, 1), dtype=torch.bool, device=self.device)
        return result.update({name: worlds.clone() for name in ("done", "terminated", "truncated", "success")})

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        chosen: Any = tensordict[GROUP, "action"]
        driven = chosen.detach().cpu().numpy()
        action = np.zeros((len(driven), self._parts, self._numbers), dtype=np.float32)
        action[:, self._driven] = driven
        seen, reward, terminated, truncated, info = self.env.step(action.reshape(len(driven), -1))
        own = info["parts"]["reward"] if self._credits else np.repeat(reward[:, None], self._parts, axis=1)
        result = self._observed(seen, info, info["parts"]["cost"] if self._costs else None)
        result[GROUP, "reward"] = self._agents(own)
        flags = {"terminated": terminated, "truncated": truncated, "done": terminated | truncated}
        for name, values in (*flags.items(), ("success", info["is_success"])):
            result[name] = torch.as_tensor(values, device=self.device)[:, None]
        return result

    def _observed(self, seen: dict[str, np.ndarray], info: dict[str, Any], cost: Any) -> TensorDict:
        """Return the keys of the group of an instant."""
        rows = torch.as_tensor(seen["parts"][:, self._driven], device=self.device)
        mask = torch.as_tensor(seen["mask"][:, self._driven] > 0, device=self.device)
        own: dict[str, Any] = {"observation": rows, "mask": mask[..., None]}
        own["at_goal"] = torch.as_tensor(info["parts"]["done"][:, self._driven], device=self.device)[..., None]
        if self._costs:
            own["cost"] = self._agents(cost)
        lead = (*self.batch_size, len(self._driven))
        return TensorDict({GROUP: TensorDict(own, lead, device=self.device)}, self.batch_size, device=self.device)

    def _agents(self, values: np.ndarray) -> torch.Tensor:
        """Return values (worlds, parts) of the agents, float32 (worlds, agents, 1)."""
        chosen = np.ascontiguousarray(values[:, self._driven], dtype=np.float32)
        return torch.as_tensor(chosen, device=self.device)[..., None]

    def close(self, *, raise_if_closed: bool = True) -> None:
        """Close the vector environment."""
        if not self.is_closed:
            self.env.close()
        super().close(raise_if_closed=raise_if_closed)
