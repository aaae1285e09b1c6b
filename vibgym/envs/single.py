"""The single environment: one world of the core behind the Gymnasium interface."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np

from vibgym import checks
from vibgym.envs.core import Core
from vibgym.tasks import TASKS

RENDER_MODES = ("rgb_array", "human")
_FIRST = np.zeros(1, dtype=np.int64)


class VibgymEnv(gym.Env):
    """One part on the vibrating surface, and a task. One step is one oscillation period (40 ms).

    ## Action space
    A float32 box in [-1, 1]; values outside are clipped, NaN, infinity and wrong shapes raise ``ValueError``.

    | ``action=`` | shape | meaning |
    |---|---|---|
    | ``"element"`` | (rows, columns, 2) | amplitude [0, max_amplitude] and phase [-pi, pi] of every element |
    | ``"phasor"`` | (rows, columns, 2) | amplitude x (cos, sin) phase of every element, in the unit disc |
    | ``"patch"`` | (1, k, k, 2) | phasors of the k x k elements around the part (k = 4 for the shipped blocks) |
    | ``"field"`` | (1, 6) | strengths of uniform x, y, squeeze x, y, radial and tangential field around the part |

    ## Observation space
    ``"state"`` (default): float32 (18,) in [-1, 1].

    | index | meaning | unit of 1 |
    |---|---|---|
    | 0, 1 | centre within its element, x and y; -1 and 1 are the element's edges | half an element |
    | 2, 3 | cos and sin of (symmetry x heading); 1, 0 for a disc | 1 |
    | 4, 5 | centre on the surface, x and y; -1 and 1 are the borders | half the width, half the height |
    | 6, 7 | goal minus centre, x and y | longer side of the surface |
    | 8, 9 | tanh of the same in 50 mm | 1 |
    | 10, 11 | tanh of the same in 5 mm | 1 |
    | 12 | goal minus heading, 0 where it does not count | full turn |
    | 13, 14 | tanh of the same in 0.5 and 0.05 rad | 1 |
    | 15, 16 | mean velocity over the last period, x and y | table speed a_h w (at least 1 mm/s) |
    | 17 | mean angular velocity over the last period | 10 rad/s |

    ``"goal"``: dictionary of ``observation`` (as above), ``achieved_goal`` and ``desired_goal``: x, y in m and, where the
    heading counts, the heading in rad; the reward is then :meth:`compute_reward`. ``"image"``: uint8
    (6 rows, 6 columns, 3), see :class:`vibgym.envs.observations.ImageObservation`.

    ## Rewards
    The sum of ``info["reward_terms"]``, each bounded:

    | term | meaning | bound |
    |---|---|---|
    | distance | progress towards the goal position, per 100 mm | 1 |
    | approach | progress of tanh(distance / 10 mm) | 1 |
    | turn | progress of the heading, per rad | 1 |
    | alignment | progress of tanh(heading error / 0.15 rad) | 1 |
    | inside | within tolerance | 0.1 |
    | time | every step | -0.02 |
    | success | on success | 5 |
    | fallen | on falling off the surface | -5 |

    ## Episode end
    Success (within tolerance for 10 steps in a row), a fallen part or a diverged simulation terminate it; the step limit
    truncates it. ``info`` holds ``is_success``, ``position_error`` (m), ``heading_error`` (rad, magnitude, where the
    heading counts), ``reward_terms``, ``fallen`` and ``diverged``.

    Args:
        task: ``"Transport"``, ``"Align"`` or ``"Rotate"``.
        surface: ``"prototype"`` or a mapping of :class:`vibgym.Surface`'s fields (keys may carry ``_mm``).
        parts: a list with the name of a shipped part (``"aluminium_block"``, ``"steel_block"``) or a mapping with
            ``shape`` and its fields.
        model: ``"planar"``, ``"averaged"`` or ``"auto"`` (its default tolerance), as for :class:`vibgym.Simulator`.
        action, observation: see above.
        actuators, sensor: ``"ideal"``.
        randomize: None.
        periods_per_step: oscillation periods per step.
        render_mode: None, ``"rgb_array"`` or ``"human"``.

    Raises:
        ValueError: a setting that is not among those.
    """

    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": 25}

    def __init__(self, task: str, *, render_mode: str | None = None, **settings: Any) -> None:
        if render_mode is not None:
            checks.choice("render_mode", render_mode, RENDER_MODES)
        self.core = Core(TASKS[checks.choice("task", task, tuple(TASKS))], 1, **settings)
        self.render_mode = render_mode
        self.action_space = self.core.action.space
        self.observation_space = self.core.observation.space
        self.metadata = {
            "render_modes": list(RENDER_MODES),
            "render_fps": round(1.0 / (self.core.surface.period * self.core.periods)) or 1,
        }
        self._viewer: Any = None
        if render_mode is not None:
            from vibgym.envs.viewer import Viewer  # pygame is an extra

            self._viewer = Viewer(self.core, f"vibgym {task}")

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode. ``options`` are not used."""
        super().reset(seed=None if seed is None else checks.count("seed", seed, least=0))
        self.core.reset(_FIRST, [self.np_random])
        if self._viewer is not None:
            self._viewer.begin(0)
            self._draw()
        return self._observation(), self._info()

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Advance by one step."""
        core = self.core
        if not core.began:
            raise gym.error.ResetNeeded("call reset() before step()")
        checked = core.action.check(action, None)
        if self._viewer is not None:
            checked = checked.copy()  # the picture is of this step, whatever the caller does to the array
        core.step(checked)
        if self._viewer is not None:
            self._viewer.follow(0)
            self._draw()
        return self._observation(), float(core.score.reward[0]), bool(core.score.ended[0]), False, self._info()

    @property
    def compute_reward(self) -> Any:
        """Reward of reaching one goal when another was asked for, single or batched (GoalEnv).

        See :meth:`vibgym.tasks.PoseTask.compute_reward`. Only with ``observation="goal"``: learners take an environment
        that has it for a GoalEnv.
        """
        if not self.core.goal_reward:
            raise AttributeError("compute_reward: only with observation='goal'")
        return self._goal_reward

    def _goal_reward(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: Any) -> Any:
        reward = self.core.task.compute_reward(achieved_goal, desired_goal, info)
        return float(reward) if reward.ndim == 0 else reward

    def render(self) -> np.ndarray | None:
        """The picture for ``"rgb_array"``; ``"human"`` draws by itself."""
        if self.render_mode == "rgb_array":
            return self._viewer.frame(0)
        return None

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._viewer is not None:
            self._viewer.close()

    def _draw(self) -> None:
        if self.render_mode == "human":
            self._viewer.show(0)

    def _observation(self) -> Any:
        seen = self.core.observe()
        if isinstance(seen, dict):
            return {key: value[0] for key, value in seen.items()}
        return seen[0]

    def _info(self) -> dict[str, Any]:
        core = self.core
        result, state = core.score, core.simulator.state
        info: dict[str, Any] = {
            "is_success": bool(result.success[0]),
            "position_error": float(result.distance[0]),
        }
        if core.task.has_heading:
            info["heading_error"] = abs(float(result.error[0, 2]))
        info["reward_terms"] = dict(zip(core.term_names, core.terms[0].tolist(), strict=True))
        info["fallen"] = bool(state.fallen[0, 0])
        info["diverged"] = bool(state.diverged[0])
        return info
