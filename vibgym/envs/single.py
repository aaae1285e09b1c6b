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
    """Parts on the vibrating surface, and a task. One step is one oscillation period (40 ms).

    Transport, Align and Rotate are tasks for one part, Sort and Singulate for several; what is only theirs is under "Several
    parts" below.

    ## Action space
    A float32 box in [-1, 1]; values outside are clipped, NaN, infinity and wrong shapes raise ``ValueError``.

    | ``action=`` | shape | meaning |
    |---|---|---|
    | ``"element"`` | (rows, columns, 2) | amplitude [0, max_amplitude] and phase [-pi, pi] of every element |
    | ``"phasor"`` | (rows, columns, 2) | amplitude x (cos, sin) phase of every element, in the unit disc |
    | ``"patch"`` | (parts, k, k, 2) | phasors of the k x k elements around each part (k = 4 for the shipped blocks) |
    | ``"field"`` | (parts, 6) | strengths of uniform x, y, squeeze x, y, radial and tangential field around each part |

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

    ## Several parts
    Sort: every part's centre inside the zone of its kind (parts with the same name), and slower than 20 mm/s on average over
    the last period. Singulate: every distance between parts above sqrt(2) x element size. With ``"patch"`` and ``"field"`` an
    element that several parts claim obeys the one whose centre is nearest to its own.

    ``"state"``: float32 (slots x 20,) in [-1, 1]; part p has the numbers from 20 p. Those of an absent part are all 0.

    | index | meaning | unit of 1 |
    |---|---|---|
    | 0 | 1: the part is there | 1 |
    | 1, 2, 3 | 1 for its kind: the first, second or third of the list of parts | 1 |
    | 4, 5 | centre within its element, x and y; -1 and 1 are the element's edges | half an element |
    | 6, 7 | cos and sin of (symmetry x heading); 1, 0 for a disc | 1 |
    | 8, 9 | centre on the surface, x and y; -1 and 1 are the borders | half the width, half the height |
    | 10, 11 | nearest point of its zone minus centre, x and y; 0 inside, and without zones | longer side of the surface |
    | 12, 13 | tanh of the same in 50 mm | 1 |
    | 14, 15 | mean velocity over the last period, x and y | table speed a_h w (at least 1 mm/s) |
    | 16 | mean angular velocity over the last period | 10 rad/s |
    | 17 | tanh of (distance to the nearest other part / (sqrt(2) x element size)); 1 without others | 1 |
    | 18, 19 | unit vector from its centre to that part's, x and y; 0, 0 without others | 1 |

    ``"image"``: see :class:`vibgym.envs.crowd_observations.CrowdImageObservation`. There is no ``"goal"``.

    | reward term | meaning | bound |
    |---|---|---|
    | distance | progress of the parts' mean distance to their zones, per 100 mm | 1 |
    | inside | progress of the share of parts inside their zones | 1 |
    | clearance | Singulate: progress of the mean of min(distance to the nearest part / sqrt(2) x element size, 1) | 1 |
    | time | every step | -0.003 |
    | success | on success | 5 |
    | fallen | on a part's falling off the surface | -5 |

    ``position_error`` (m) is the largest distance of a part's centre to its zone (Sort), or what the smallest distance between
    parts lacks (Singulate). ``info`` also holds ``clearance`` (m, smallest distance between parts; negative: overlap; the
    surface's diagonal without others), ``touching`` (number of pairs closer than 0.1 mm) and ``parts_done``.

    ## Episode end
    Success (within tolerance, or all parts done, for 10 steps in a row), a fallen part or a diverged simulation terminate
    it; the step limit truncates it. ``info`` holds ``is_success``, ``position_error`` (m), ``heading_error`` (rad, magnitude,
    where the heading counts), ``reward_terms``, ``fallen`` and ``diverged``.

    Args:
        task: ``"Transport"``, ``"Align"``, ``"Rotate"``, ``"Sort"`` or ``"Singulate"``.
        surface: ``"prototype"`` or a mapping of :class:`vibgym.Surface`'s fields (keys may carry ``_mm``).
        parts: a list of names of shipped parts (``"aluminium_block"``, ``"steel_block"``) or mappings with ``shape`` and its
            fields; with one of them for Transport, Align and Rotate.
        model: ``"planar"``, ``"averaged"`` or ``"auto"`` (its default tolerance), as for :class:`vibgym.Simulator`.
        action, observation: see above.
        actuators, sensor: ``"ideal"``.
        randomize: None; Sort and Singulate take ``{"parts": [low, high]}``: so many of the parts, chosen at random, are
            there in an episode.
        start: of Sort: ``"scattered"`` (default: at random, at least 2 mm apart) or ``"crowded"`` (one cluster, in touch).
        zones: of Sort: a mapping from kind to [x_low, y_low, x_high, y_high] in m. Default: zones of six columns at the left
            end for the first kind, at the right end for the second, in the middle for the third.
        slots: of Sort and Singulate: parts for which the state observation has room, at least the number of parts.
        walls: of Sort and Singulate: borders with a wall, among ``"left"``, ``"right"``, ``"bottom"``, ``"top"``.
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
        reward = self.core.compute_reward(achieved_goal, desired_goal, info)
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
        info: dict[str, Any] = {name: values[0].item() for name, values in core.facts().items()}
        info["reward_terms"] = dict(zip(core.term_names, core.terms[0].tolist(), strict=True))
        return info
