"""The single environment: one world with the Gymnasium interface."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils import seeding

from vibgym import checks
from vibgym.envs.core import Core
from vibgym.envs.info import COUNTS, FLAGS, NUMBERS, InfoData
from vibgym.envs.options import Options, parse_reset_options, step_limit, with_options
from vibgym.envs.shared import SharedInterface, frames_per_second
from vibgym.registration import Periods
from vibgym.snapshots import check_keys, generator_from, generator_state

RENDER_MODES = ("rgb_array", "human")
_FIRST = np.zeros(1, dtype=np.int64)


class VibgymEnv(SharedInterface, gym.Env):
    """Parts on a segmented vibrating surface, and a task. One step is one oscillation period (40 ms).

    ## Description
    Elements of the surface move up and down while the whole surface vibrates horizontally; where both are in phase, parts
    are pushed. Each registered environment has a documentation page with its scene, observations, reward terms and baselines
    (``docs/environments``). Tasks are documented by their classes in :mod:`vibgym.tasks`.

    ## Action space
    ``Box(-1, 1, (n,), float32)``, with n the product of the shape below; ``step`` takes an array of either shape. Values
    outside are clipped; NaN, infinity and other shapes raise ``ValueError``.

    | ``action=`` | shape | meaning |
    |---|---|---|
    | ``"element"`` (default) | (rows, columns, 2) | amplitude [0, max_amplitude] and phase [-pi, pi] of every element |
    | ``"phasor"`` | (rows, columns, 2) | amplitude x (cos, sin) phase of every element, in the unit disc |
    | ``"patch"`` | (parts, k, k, 2) | phasors of the k x k elements around each part (k = 4 for the shipped blocks) |
    | ``"field"`` | (parts, 6) | strengths of uniform x, y, squeeze x, y, radial and tangential field around each part |
    | ``"wrench"`` | (parts, 3) | acceleration of each part, x, y and angular, see :class:`vibgym.envs.Wrench` |
    | ``"velocity"`` | (parts, 3) | velocity of each part at the end of the step, see :class:`vibgym.envs.Velocity` |
    | ``"target"`` | (parts, 3) | pose of each part to go to, relative to the measured one, see :class:`vibgym.envs.Target` |

    For learning, start with ``"velocity"``, or ``"target"`` for one part; ``docs/learning.md`` compares the actions.
    ``"element"`` has 512 numbers on the prototype.

    ## Observation space
    | ``observation=`` | space | content |
    |---|---|---|
    | ``"state"`` (default) | Box(-1, 1, float32) | a block of numbers per slot, part p in block p; 0 for absent parts |
    | ``"parts"`` | Dict | ``parts`` (slots, numbers), each row relative to its part, and ``mask`` (slots,) |
    | ``"parts_and_state"`` | Dict | both |
    | ``"goal"`` | Dict | ``observation`` (the state), ``achieved_goal``, ``desired_goal`` (m, m, rad): GoalEnv |
    | ``"image"`` | Box(0, 255, uint8) | (6 rows, 6 columns, 3), see :class:`vibgym.envs.observations.ImageObservation` |
    | ``"camera"`` | Box(0, 255, uint8) | (lines, columns), requires ``sensor="camera"`` |

    :attr:`observation_layout` and :attr:`parts_layout` list name, meaning, unit, scale and range of every number of
    ``"state"`` and ``"parts"``.

    ## Rewards
    The sum of ``info["reward_terms"]``, each bounded by its weight; ``task_settings={"weights": ...}`` changes the weights.
    With ``observation="goal"`` the reward is :meth:`compute_reward`.

    ## Starting state
    Drawn by the task from the seed; ``reset(options=...)`` sets poses, goals, paths or the parts that are present.

    ## Episode end
    Termination: success (all parts done for 10 periods, or ``hold``, and two steps in a row), a fallen part, or divergence.
    Truncation: the limit.

    ## Information
    ``is_success``, ``position_error`` (m), ``heading_error`` (rad), ``clearance`` (m, smallest distance between parts,
    negative for overlap), ``touching`` (pairs closer than 0.1 mm), ``parts_done``, ``fallen``, ``diverged`` (where they
    apply), ``reward_terms``, and:

    - ``parts``: arrays (parts,): ``done``, ``fallen``, ``present``, ``reward``, ``reward_terms``; with disturbances
      ``disturbed`` (rad), with ``model="tilting"`` ``toppled``.
    - ``drawn``: values drawn by ``randomize``.
    - ``measured``: ``age`` (periods) and ``sigma`` (m, m, rad) of the measurement, unless the sensor is ideal.
    - ``commanded``: with actions that command motions, ``unserved`` (parts,), an index of
      :data:`vibgym.envs.motions.REASONS`; with ``"target"`` also ``moved`` (parts, 2), m, see :class:`vibgym.envs.Target`.
    - ``costs`` (by name) and ``cost`` (their weighted sum), with ``costs=``; ``parts`` then has the part's share.

    Args:
        task: ``"Align"``, ...: its name.
        render_mode: None, ``"rgb_array"`` or ``"human"``.
        **options: ``surface``, ``parts``, ``model``, ``action``, ``observation``, ``actuators``, ``sensor``, ...: the fields of
            :class:`vibgym.envs.Options`.

    Raises:
        ValueError: an invalid setting.
    """

    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": 25}

    core_class: ClassVar[type[Core]] = Core
    """Class of the batched core; :mod:`vibgym.hardware` has others."""

    @with_options
    def __init__(self, task: str, *, render_mode: str | None = None, **options: Any) -> None:
        known = Options.of(task, options, ("render_mode",))
        if render_mode is not None:
            checks.choice("render_mode", render_mode, RENDER_MODES)
        self._options = known
        self.core = self.core_class(known, 1, WorldInfo)
        self.render_mode = render_mode
        self.action_space = self.core.action.space
        self.observation_space = self.core.observation.space
        self.metadata = {"render_modes": list(RENDER_MODES), "render_fps": frames_per_second(self.core)}
        self.max_episode_steps = step_limit(None, self.core.periods, known.max_episode_periods)
        self._steps = 0
        self._closed, self._paused = False, True  # paused: before the first reset, closed, or just restored
        self._viewer: Any = None
        if render_mode is not None:
            from vibgym.envs.viewer import Viewer  # pygame is an extra

            self._viewer = Viewer(self, f"vibgym {task}")

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: of this and the following episodes; None continues the generator.
            options: values that replace drawn ones: ``"pose"``, broadcastable to (parts, 3): x, y (m), heading (rad);
                ``"goal"``, likewise, for tasks with goal poses; ``"paths"``, a list with a mapping per part, for Follow;
                ``"parts"``, indices of the present parts, or booleans.

        Raises:
            ValueError: an invalid seed, option or start; nothing has changed.
        """
        if seed is not None:
            seed = checks.count("seed", seed, least=0)
        generator = self.np_random if seed is None else seeding.np_random(seed)[0]
        core = self.core
        override = parse_reset_options(options, core.task, core.worlds, core.longest)
        if override is not None:  # an invalid start must not change anything
            core.check_start(_FIRST, [generator], override)
        super().reset(seed=seed)
        core.reset(_FIRST, [self.np_random], override)
        self._steps, self._closed = 0, False
        if self._paused:
            self._set_time_limits()
        self._paused = False
        if self._viewer is not None:
            self._viewer.begin(0)
            self._draw()
        self.core.refresh_all()
        pipeline = self.core.pipeline
        return self._own(pipeline.observations), pipeline.info.read()[2]

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Advance by one step."""
        core = self.core
        if self._paused:
            self._check_open(self._closed)
            self._set_time_limits()
            self._paused = False
        pipeline = core.pipeline
        pipeline.run(core.action.shaped(action, None), action)
        self._steps += 1
        if self._viewer is not None:
            self._viewer.follow(0)
            self._draw()
        truncated = self.max_episode_steps is not None and self._steps >= self.max_episode_steps
        batch = pipeline.observations
        observation = batch[0] if isinstance(batch, np.ndarray) else self._own(batch)
        reward, ended, info = pipeline.info.read()
        return observation, reward, ended, truncated, info

    @property
    def steps(self) -> int:
        """Steps of the present episode."""
        return self._steps

    def get_state(self) -> dict[str, Any]:
        """Return a snapshot that continues bit for bit, generator included; trails of images are not part of it."""
        return {**self.core.get_state(), "generator": generator_state(self.np_random), "steps": self._steps}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore a snapshot of an environment with the same settings.

        Raises:
            ValueError: a snapshot of another environment or with invalid values; nothing has changed.
        """
        core = self.core
        check_keys("state", state, (*core.state_keys, "generator", "steps"))
        steps = checks.count("state['steps']", state["steps"], least=0)
        generator = generator_from("state['generator']", state["generator"])
        core.set_state({name: state[name] for name in core.state_keys})
        self.np_random, self._steps, self._closed, self._paused = generator, steps, False, True
        if self._viewer is not None:
            self._viewer.begin(0)

    def render(self) -> np.ndarray | None:
        """Return the image for ``"rgb_array"``; ``"human"`` draws at every step."""
        if not self.core.began:
            raise gym.error.ResetNeeded("call reset() before render()")
        if self.render_mode is None:
            gym.logger.warn("render(): the environment was made without render_mode; allowed: 'rgb_array', 'human'")
        if self.render_mode == "rgb_array":
            return self._viewer.frame(0)
        return None

    def close(self) -> None:
        """Close the window. Stepping requires a reset afterwards."""
        self._closed = self._paused = True
        if self._viewer is not None:
            self._viewer.close()

    def _describe_limit(self, spec: EnvSpec) -> None:
        registered = gym.registry.get(spec.id)
        if registered is not None and registered.max_episode_steps is not None and spec.max_episode_steps is None:
            self.max_episode_steps = None  # made by gym.make, which adds a TimeLimit unless max_episode_steps is -1
        super()._describe_limit(spec)

    def _set_time_limits(self) -> None:
        """Set the limits of the TimeLimit wrappers that call this environment, and the steps that they have counted.

        Snapshots do not contain them, and Gymnasium gives an environment no reference to its wrappers.
        """
        frame = sys._getframe(1)
        while frame is not None:
            wrapper = frame.f_locals.get("self")
            if isinstance(wrapper, gym.wrappers.TimeLimit) and wrapper.unwrapped is self:
                wrapper._elapsed_steps = self._steps
                if isinstance(limit := wrapper._max_episode_steps, Periods):
                    wrapper._max_episode_steps = step_limit(limit, self.core.periods, self._options.max_episode_periods)  # type: ignore[assignment]
            frame = frame.f_back

    def _draw(self) -> None:
        if self.render_mode == "human":
            self._viewer.show(0)

    def _own(self, seen: Any) -> Any:
        if isinstance(seen, dict):
            return {key: value[0] for key, value in seen.items()}
        return seen[0]


class WorldInfo:
    """Writer of the ``info`` of a single environment: Python numbers, and copies of arrays."""

    def __init__(self, data: InfoData) -> None:
        episode, names = data.episode, data.names
        columns = zip((episode.number, episode.count, episode.flag), (NUMBERS, COUNTS, FLAGS))
        live = {name: array[:, column] for array, indices in columns for name, column in indices.items()}
        live["diverged"] = data.diverged
        parts = {
            "done": episode.done, "fallen": episode.part_fallen, "present": episode.present,
            "reward": episode.part_reward, **data.part_extra,
            "reward_terms": {name: data.part_terms[..., k] for k, name in enumerate(names)},
        }  # fmt: skip
        info = {
            **{name: live[name] for name in data.fields}, **data.extra,
            "reward_terms": {name: data.terms[:, k] for k, name in enumerate(names)},
            **data.groups, "parts": parts,
        }  # fmt: skip
        self._reward, self._ended = (live[name][:1].item for name in ("reward", "ended"))
        self._groups: list[Group] = []
        _flatten(self._groups, "info", info, 0)

    def read(self) -> tuple[float, bool, dict[str, Any]]:
        """Return reward, whether the episode has ended, and ``info``."""
        made: list[dict[str, Any]] = [{}]
        for name, parent, readers in self._groups:
            values: dict[str, Any] = {}
            for key, read in readers:
                values[key] = read()
            made[parent][name] = values
            made.append(values)
        return self._reward(), self._ended(), made[0]["info"]


class Group(NamedTuple):
    """Numbers and arrays of ``info`` or of a dictionary in it."""

    name: str
    parent: int  # number of the dictionary that contains it; 0: the one that contains ``info``
    readers: list[tuple[str, Callable[[], Any]]]  # by name


def _flatten(groups: list[Group], name: str, live: Mapping[str, Any], parent: int) -> None:
    """Append the groups of nested live arrays (worlds, ...), which read the first world's numbers and copies of its arrays.

    Views are made here, since indexing takes as long as reading.
    """
    arrays = [(key, values) for key, values in live.items() if not isinstance(values, dict)]
    readers = [(key, values[:1].item if values.ndim == 1 else values[0].copy) for key, values in arrays]
    groups.append(Group(name, parent, readers))
    number = len(groups)
    for key, values in live.items():
        if isinstance(values, dict):
            _flatten(groups, key, values, number)
