"""The native vector environment: all worlds are advanced in one kernel call."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import load_env_creator
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from vibgym import checks
from vibgym.envs.core import Core
from vibgym.envs.options import Options, StartOverride, parse_reset_options, step_limit, with_options
from vibgym.envs.shared import SharedInterface, frames_per_second
from vibgym.snapshots import check_keys, copied, generator_from, generator_state, restore, restored
from vibgym.tasks import TASKS


class VibgymVectorEnv(SharedInterface, VectorEnv):
    """Vector environment of ``num_envs`` worlds of one task; bit-identical to as many single environments.

    Args:
        task, options: as for :class:`vibgym.envs.VibgymEnv`.
        num_envs: number of worlds.
        max_episode_steps: step limit, which truncates, as in ``gym.make``; None: ``max_episode_periods``; -1: no limit.
        autoreset_mode: NEXT_STEP (default), SAME_STEP (``final_obs`` and ``final_info`` in the info) or DISABLED (reset
            with ``options={"reset_mask": mask}``), as an ``AutoresetMode`` or its value.
        render_mode: None or ``"rgb_array"``.

    Raises:
        ValueError: an invalid setting.
    """

    metadata: dict[str, Any] = {
        "render_modes": ["rgb_array"],
        "render_fps": 25,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    @with_options
    def __init__(
        self,
        task: str,
        num_envs: int = 1,
        *,
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        own = ("num_envs", "max_episode_steps", "autoreset_mode", "render_mode")
        known = Options.of(task, options, own)
        self.num_envs = checks.count("num_envs", num_envs)
        if render_mode is not None:
            checks.choice("render_mode", render_mode, ("rgb_array",))
        self.autoreset_mode = autoreset_mode_from(autoreset_mode)
        self.core = Core(known, self.num_envs)
        self.max_episode_steps = step_limit(max_episode_steps, self.core.periods, known.max_episode_periods)
        self.render_mode = render_mode
        self.metadata = {
            **self.metadata,
            "render_fps": frames_per_second(self.core),
            "autoreset_mode": self.autoreset_mode,
        }
        self.single_action_space = self.core.action.space
        self.single_observation_space = self.core.observation.space
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self._generators: list[np.random.Generator | None] = [None] * self.num_envs
        self._steps = np.zeros(self.num_envs, dtype=np.int64)
        self._finished = np.zeros(self.num_envs, dtype=bool)
        self._viewer: Any = None
        if render_mode is not None:
            from vibgym.envs.viewer import Viewer  # pygame is an extra

            self._viewer = Viewer(self, f"vibgym {task}", self.num_envs)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin episodes in all worlds, or in those of ``options["reset_mask"]``.

        Args:
            seed: world k gets ``seed + k``, or entry k of a sequence; None continues the world's generator.
            options: ``"reset_mask"``, bool (num_envs,); ``"pose"``, ``"goal"`` and ``"parts"`` as for a single environment,
                broadcastable to (num_envs, parts, 3) and (num_envs, parts); ``"paths"``, the same in all of these worlds.

        Raises:
            ValueError: an invalid seed, option or start; nothing has changed.
        """
        core = self.core
        override = parse_reset_options(options, core.task, core.worlds, core.longest, ("reset_mask",))
        mask = self._reset_mask(options)
        fresh = list(self._generators)
        for world, own_seed in enumerate(seeds_from(seed, self.num_envs)):
            if mask[world] and (own_seed is not None or fresh[world] is None):
                fresh[world] = seeding.np_random(own_seed)[0]
        if override is not None:  # an invalid start must not change anything
            worlds = np.flatnonzero(mask)
            core.check_start(worlds, [fresh[world] for world in worlds], override)  # type: ignore[misc]
        self._generators = fresh
        if isinstance(seed, int | np.integer):
            self._np_random, self._np_random_seed = seeding.np_random(int(seed))
        self.closed = False
        self._begin(mask, override)
        core.refresh_all()
        pipeline = core.pipeline
        return pipeline.observations, pipeline.info.read(pipeline.report, None if mask.all() else mask)

    def step(self, actions: Any) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Advance all worlds by one step; finished ones are reset according to ``autoreset_mode``."""
        core = self.core
        self._check_open(self.closed)
        original, actions = actions, core.action.shaped(actions, self.num_envs)
        if self._viewer is not None:
            actions = actions.copy()  # images show this step even if the caller changes the array
        waiting = self._finished.copy()
        if self.autoreset_mode is AutoresetMode.DISABLED and waiting.any():
            raise gym.error.ResetNeeded(
                f"worlds {np.flatnonzero(waiting).tolist()} have ended: reset them with options={{'reset_mask': mask}}"
            )
        pipeline = core.pipeline
        pipeline.run(actions, original)
        self._steps += 1
        if self._viewer is not None:
            for world in range(self.num_envs):
                self._viewer.follow(world)
        if waiting.any():  # NEXT_STEP: the step after the end is the reset
            self._begin_anew(waiting)
        terminated, reward = pipeline.report.flag[0].copy(), pipeline.report.number[0].copy()
        truncated = np.zeros(self.num_envs, dtype=bool)
        if self.max_episode_steps is not None:
            truncated = self._steps >= self.max_episode_steps
        finished = terminated | truncated
        final: dict[str, Any] = {}
        if self.autoreset_mode is AutoresetMode.SAME_STEP and finished.any():
            final = {
                "final_obs": self._objects(pipeline.observations, finished),
                "_final_obs": finished.copy(),
                "final_info": pipeline.info.read(pipeline.report, finished),
                "_final_info": finished.copy(),
            }
            self._begin_anew(finished)
            finished = np.zeros(self.num_envs, dtype=bool)
        self._finished[:] = finished
        return pipeline.observations, reward, terminated, truncated, {**final, **pipeline.info.read(pipeline.report)}

    def render(self) -> tuple[np.ndarray, ...] | None:
        """Return one image per world for ``"rgb_array"``."""
        if self._viewer is None:
            gym.logger.warn("render(): the environment was made without render_mode; allowed: 'rgb_array'")
            return None
        return tuple(self._viewer.frame(world) for world in range(self.num_envs))

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Return a method's result, or an attribute, once per world: sequences with one entry per world are split.

        Raises:
            ValueError: no public method or attribute of this name.
        """
        value = self._attribute(name)
        if callable(value):
            value = value(*args, **kwargs)
        if isinstance(value, tuple | list | np.ndarray) and len(value) == self.num_envs and self.num_envs > 1:
            return tuple(value)
        return (value,) * self.num_envs

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Return an attribute, once per world."""
        value = self._attribute(name)
        return (value,) * self.num_envs

    def set_attr(self, name: str, values: Any) -> None:
        """Set an attribute of the environment, which all worlds share: values of a list or tuple must be equal.

        Raises:
            ValueError: no public attribute of this name, or values that differ.
        """
        if callable(self._attribute(name)) or isinstance(getattr(type(self), name, None), property):
            raise checks.refuse("name", name, "an attribute that can be set, not a method or property")
        if isinstance(values, list | tuple):
            differ = (value is not values[0] and not np.array_equal(value, values[0]) for value in values)
            if len(values) != self.num_envs or any(differ):
                raise checks.refuse("values", values, f"{self.num_envs} equal values: all worlds share one environment")
            values = values[0]
        setattr(self, name, values)

    def _attribute(self, name: Any) -> Any:
        if not isinstance(name, str) or name.startswith("_") or not hasattr(self, name):
            raise checks.refuse("name", name, f"the name of a public attribute or method of {type(self).__name__}")
        return getattr(self, name)

    def get_state(self) -> dict[str, Any]:
        """Return a snapshot that continues bit for bit, generators included; trails of images are not part of it."""
        own = [None if generator is None else generator_state(generator) for generator in self._generators]
        return {**self.core.get_state(), "generators": own, **copied(self._counters())}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore a snapshot of an environment with the same settings and number of worlds.

        Raises:
            ValueError: a snapshot of another environment or with invalid values; nothing has changed.
        """
        counters = tuple(self._counters())
        check_keys("state", state, (*self.core.state_keys, "generators", *counters))
        values = restored("state", self._counters(), {name: state[name] for name in counters})
        generators = state["generators"]
        if not isinstance(generators, list | tuple) or len(generators) != self.num_envs:
            raise checks.refuse("state['generators']", generators, f"a list of {self.num_envs}")
        own = [
            None if saved is None else generator_from(f"state['generators'][{world}]", saved)
            for world, saved in enumerate(generators)
        ]
        self.core.set_state({name: state[name] for name in self.core.state_keys})
        restore(self._counters(), values)
        self._generators, self.closed = own, False
        if self._viewer is not None:
            for world in range(self.num_envs):
                self._viewer.begin(world)

    def _counters(self) -> dict[str, np.ndarray]:
        return {"steps": self._steps, "finished": self._finished}

    def close_extras(self, **kwargs: Any) -> None:
        """Release the viewer."""
        if self._viewer is not None:
            self._viewer.close()

    def _begin(self, mask: np.ndarray, override: StartOverride | None = None) -> np.ndarray:
        """Begin episodes in the worlds of ``mask``; return their indices."""
        worlds = np.flatnonzero(mask)
        own = [self._generators[world] for world in worlds.tolist()]
        self.core.reset(worlds, own, override)  # type: ignore[arg-type]
        self._steps[worlds] = 0
        self._finished[mask] = False
        if self._viewer is not None:
            for world in worlds:
                self._viewer.begin(world)
        return worlds

    def _begin_anew(self, mask: np.ndarray) -> None:
        """Begin episodes in the worlds of ``mask``; update observations and info."""
        self.core.pipeline.refresh(self._begin(mask))

    def _reset_mask(self, options: dict[str, Any] | None) -> np.ndarray:
        if not options or "reset_mask" not in options:
            return np.ones(self.num_envs, dtype=bool)
        value, allowed = options["reset_mask"], f"bool array ({self.num_envs},) with at least one True"
        try:
            mask = np.asarray(value)
        except (TypeError, ValueError, RecursionError):  # rows of different lengths
            raise checks.refuse("options['reset_mask']", value, allowed) from None
        if mask.shape != (self.num_envs,) or mask.dtype != bool or not mask.any():
            raise checks.refuse("options['reset_mask']", value, allowed)
        if not self.core.began and not mask.all():
            raise checks.refuse("options['reset_mask']", mask, "all True at the first reset")
        return mask

    def _objects(self, observations: Any, mask: np.ndarray) -> np.ndarray:
        """Return copies of the observations of the worlds in ``mask``, None elsewhere, in Gymnasium's form of ``final_obs``."""
        result = np.full(self.num_envs, None, dtype=object)
        for world in np.flatnonzero(mask):
            if isinstance(observations, dict):
                result[world] = {key: value[world].copy() for key, value in observations.items()}
            else:
                result[world] = observations[world].copy()
        return result


def autoreset_mode_from(value: Any) -> AutoresetMode:
    """Return an autoreset mode, given as such or by its value."""
    if not isinstance(value, AutoresetMode):
        checks.choice("autoreset_mode", value, tuple(mode.value for mode in AutoresetMode))
    return AutoresetMode(value)


def seeds_from(seed: Any, worlds: int) -> list[int | None]:
    """Return the seed of each world: ``seed + k`` of world k, or the entries of a sequence; None continues a generator."""
    if seed is None:
        return [None] * worlds
    if isinstance(seed, int | np.integer) and not isinstance(seed, bool):
        first = checks.count("seed", seed, least=0)
        return [first + k for k in range(worlds)]
    if isinstance(seed, Sequence) and not isinstance(seed, str) and len(seed) == worlds:
        return [None if own is None else checks.count(f"seed[{k}]", own, least=0) for k, own in enumerate(seed)]
    raise checks.refuse("seed", seed, f"None, a whole number >= 0, or a sequence of {worlds}")


def registered_id(name: Any, field: str) -> str:
    """Return the id of an environment that Gymnasium has registered, from its id or short name.

    Args:
        name: ``"vibgym/Sort-v0"``, ``"Sort"``, or the id of another environment.
        field: name of the setting, for errors.
    """
    for known in (name, f"vibgym/{name}-v0"):
        if isinstance(name, str) and known in gym.registry:
            return known
    own = [spec.id for spec in gym.registry.values() if spec.namespace == "vibgym"]
    raise checks.unknown(field, name, (*own, "or the id of another registered environment"))


def environment_id(task: Any, field: str = "task") -> str:
    """Return the Gymnasium id of an environment: ``vibgym/Sort-v0`` for ``Sort``; ids are returned unchanged.

    Args:
        task: an id, a short name, or a name in :data:`vibgym.tasks.TASKS` without a registered environment (unchanged).
        field: name of the setting, for errors.

    Raises:
        ValueError: not registered, or not an environment of vibgym.
    """
    if isinstance(task, str) and task in TASKS and f"vibgym/{task}-v0" not in gym.registry:
        return task
    name = registered_id(task, field)
    made = creator(gym.registry[name].vector_entry_point)
    if made is None or (isinstance(made, type) and not issubclass(made, VibgymVectorEnv)):
        raise checks.refuse(
            field, task, "the id of an environment with vector_entry_point='vibgym.envs:VibgymVectorEnv'"
        )
    return name


def batch_of(task: str, **arguments: Any) -> Any:
    """Create a vector environment.

    Args:
        task: see :func:`environment_id`.
        **arguments: of the environment.

    Raises:
        ValueError: an unknown environment or argument, or an invalid value.
    """
    name = environment_id(task)
    if name not in gym.registry:
        return VibgymVectorEnv(name, **arguments)
    spec = gym.registry[name]
    reason = checks.misfit(creator(spec.vector_entry_point), **{"num_envs": 1, **spec.kwargs, **arguments})
    if reason is not None:
        raise checks.refuse("arguments", sorted(arguments), f"those of the environment ({reason})")
    return gym.make_vec(name, **arguments)


def creator(entry: Any) -> Any:
    """Return the class or function of an entry point."""
    return load_env_creator(entry) if isinstance(entry, str) else entry
