"""The single environment: one world of the core behind the Gymnasium interface."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any, Unpack

import gymnasium as gym
import numpy as np
from gymnasium.utils import seeding

from vibgym import checks
from vibgym.envs import features, generators
from vibgym.envs.core import Core
from vibgym.envs.info import WorldInformation
from vibgym.envs.options import Keywords, Options
from vibgym.envs.shared import SharedInterface, frames_per_second
from vibgym.sensing import TOLD
from vibgym.snapshots import check_keys
from vibgym.tasks import ArrangedTask, Follow, PoseTask

RENDER_MODES = ("rgb_array", "human")
_FIRST = np.zeros(1, dtype=np.int64)


@features.documented(
    pose=features.block_table(PoseTask.FEATURES),
    arranged=features.block_table(ArrangedTask.FEATURES),
    follow=features.block_table(Follow.FEATURES),
    told=features.block_table([name for names in TOLD.values() for name in names]),
    own=features.row_table(features.OWN),
    neighbour=features.row_table(features.NEIGHBOUR),
)
class VibgymEnv(SharedInterface, gym.Env):
    """Parts on the vibrating surface, and a task. One step is one oscillation period (40 ms).

    Transport, Align and Rotate are tasks for one part, Sort and Singulate for several; what is only theirs is under "Several
    parts" below. Follow is for one part or several, see "Paths". Pack, Swap, Push and Feed are open: see "Open tasks".

    ## Action space
    A flat float32 box in [-1, 1] of as many numbers as the shape below has, in C order; ``step`` takes an array of either
    shape. Values outside are clipped, NaN, infinity and wrong shapes raise ``ValueError``.

    | ``action=`` | shape | meaning |
    |---|---|---|
    | ``"element"`` (default) | (rows, columns, 2) | amplitude [0, max_amplitude] and phase [-pi, pi] of every element |
    | ``"phasor"`` | (rows, columns, 2) | amplitude x (cos, sin) phase of every element, in the unit disc |
    | ``"patch"`` | (parts, k, k, 2) | phasors of the k x k elements around each part (k = 4 for the shipped blocks) |
    | ``"field"`` | (parts, 6) | strengths of uniform x, y, squeeze x, y, radial and tangential field around each part |
    | ``"wrench"`` | (parts, 3) | wanted acceleration of each part, x, y and angular, see :class:`vibgym.envs.Wrench` |

    To learn, begin with ``"field"``: six numbers a part. The default is the machine as it is, 512 numbers on the prototype, and
    by far the hardest to learn.

    ## Observation space
    ``"state"`` (default): float32 in [-1, 1], a block of numbers for each slot; part p has block p. :attr:`observation_layout`
    says what every number means, its unit, scale and range. Transport, Align and Rotate, one block of 18:

    {pose table}

    Sort and Singulate, blocks of 20, as many as there are parts or ``slots`` says; those of absent parts are all 0:

    {arranged table}

    Follow, blocks of 37, one for each part:

    {follow table}

    A sensor that is asked to (``"tell": ["age", "sigma", "contacts"]``; contacts: an ideal one alone) adds to every block:

    {told table}

    ``"parts"``: dictionary of ``parts``, float32 in [-1, 1] (slots, numbers of a row), and ``mask`` (slots,), 1 where there is
    a part; the rows of absent parts are all 0. Part p has row p, seen from that part, in units that do not depend on the
    surface's size. :attr:`parts_layout` says what the numbers of a row mean. Only tasks with kinds of parts have ``kind``, with
    zones ``zone``, with headings that count ``turn``..., with goals that move ``goal_velocity`` to ``turn_ahead``, and for
    several parts neighbours; a sensor tells ``age``, ``sigma`` and contacts if it is asked to. In this order:

    {own table}

    and for each of the five nearest other parts that have not fallen, by the distance between outlines, nearest first, as
    ``neighbour_1_there`` and so on, ``way_far`` and ``turn`` only where some parts have to be pushed by others:

    {neighbour table}

    ``"goal"``: dictionary of ``observation`` (as above), ``achieved_goal`` and ``desired_goal``: x, y in m and, where the
    heading counts, the heading in rad; the reward is then :meth:`compute_reward`. ``"image"``: uint8
    (6 rows, 6 columns, 3), see :class:`vibgym.envs.observations.ImageObservation`. Only tasks with a goal pose have ``"goal"``.
    ``"camera"``: uint8 (lines, columns), what the camera sees; only with ``sensor="camera"``, see
    :class:`vibgym.plugins.camera.CameraSensor`. :meth:`observed` gives another one of the same instant.

    ## Rewards
    The sum of ``info["reward_terms"]``, each bounded:

    | term | meaning | bound |
    |---|---|---|
    | distance | progress towards the goal position, per 100 mm | 1 |
    | approach | progress of tanh(distance / 10 mm) | 1 |
    | turn | progress of the heading, per rad | 1 |
    | alignment | progress of tanh(heading error / 0.15 rad) | 1 |
    | inside | within tolerance, every period | 0.1 |
    | time | every period | -0.02 |
    | success | on success | 5 |
    | fallen | on falling off the surface | -5 |

    ## Several parts
    Sort: every part's centre inside the zone of its kind (parts with the same name), and slower than 20 mm/s on average over
    the last period. Singulate: every distance between parts above sqrt(2) x element size. With ``"patch"`` and ``"field"`` an
    element that several parts claim obeys the one whose centre is nearest to its own; ``"wrench"`` serves them together.

    | reward term | meaning | bound |
    |---|---|---|
    | distance | progress of the parts' mean distance to their zones, per 100 mm | 1 |
    | inside | progress of the share of parts inside their zones | 1 |
    | clearance | Singulate: progress of the mean of min(distance to the nearest part / sqrt(2) x element size, 1) | 1 |
    | time | every period | -0.003 |
    | success | on success | 5 |
    | fallen | on a part's falling off the surface | -5 |

    ``position_error`` (m) is the largest distance of a part's centre to its zone (Sort), or what the smallest distance between
    parts lacks (Singulate). ``info`` also holds ``clearance`` (m, smallest distance between parts; negative: overlap; the
    surface's diagonal without others), ``touching`` (number of pairs closer than 0.1 mm) and ``parts_done``.

    ## Paths
    Follow: the goal of each part moves along a path, from rest to rest, and the part has to be within 5 mm and 5 deg of it
    at the end of every step, until ten periods after the end of the path. An episode in which a part has been farther away
    goes on, but cannot succeed any more. ``paths=`` says which paths; by default circles, squares and figures of eight are
    drawn, run through at half of the part's top speed. See :class:`vibgym.tasks.Follow`.

    The reward terms are those of Align, about where the goal is by then; ``time`` is -0.005. ``info`` also holds ``path_error``
    (m, root mean square of the distances to the goal at the ends of all steps so far, of the part for which it is largest),
    ``largest_path_error`` (m, largest of these distances), and ``clearance``, ``touching`` and ``parts_done`` as above. A reset
    takes a ``"pose"`` within 5 mm of the path's beginning, and no ``"goal"``.

    ## Open tasks
    Pack: all parts within 1 mm and 3 deg of a pattern's poses (:class:`vibgym.tasks.Pack`). Swap: two kinds exchange the
    ends of the table, within 5 mm and 5 deg (:class:`vibgym.tasks.Swap`). In both, parts of a kind exchange goals where
    that makes their ways shorter, unless ``free`` is false. Push: parts that the elements drive push one with ``coupling``
    0, which they do not, within 5 mm and 5 deg of its goal (:class:`vibgym.tasks.Push`). Blocks and rewards are those of
    goal poses; those of parts without a goal are 0, and actions and ``parallel_env`` leave out parts that are not driven.
    ``info`` also holds ``pattern_error`` (m, root of the mean square; Pack) and ``coverage`` (share of the goal's area;
    Push).

    Feed: parts arrive by an inlet at one end and leave by the gate of their kind at the other, straight and apart; an
    episode has no success, and its limit is its end (:class:`vibgym.tasks.Feed`). ``info`` counts those that left since the
    reset (``good``, ``tilted``, ``close``, ``wrong``, ``lost``), with ``..._per_minute`` after the warm-up, ``transit`` (s)
    and ``on_table``. ``info["parts"]`` has ``arrived`` and ``event`` (how a part left in this step, a number of
    :data:`vibgym.tasks.episode.EVENTS`), and blocks have ``arrived``. A slot is empty for a step at least between two
    parts; sensors, estimators and remembered actions know nothing of the one before.

    ## Episode end
    Success (within tolerance, or all parts done, for 10 periods in a row, or as many as ``hold`` says), a fallen part or a
    diverged simulation terminate it; the limit truncates it. ``info`` holds ``is_success``, ``position_error`` (m),
    ``heading_error`` (rad, magnitude, where the heading counts), ``reward_terms``, ``fallen`` and ``diverged``; and, where
    ``randomize`` draws any, ``drawn``: the factors ``friction`` and ``mass`` of every part (parts,), ``incline`` (2,), the
    acceleration x, y (m/s^2) of what lies on the inclined table, and ``patches`` (rows, columns), the elements' factors on
    friction. Observations do not show them. With ``action="wrench"``, ``commanded`` says which parts' wishes the elements do
    not serve, and why (``unserved``, (parts,), an index of :data:`vibgym.envs.actions.REASONS`).

    ``parts`` holds what is true of each part, arrays (parts,): ``done``, ``fallen`` and ``present`` (in this episode),
    ``reward`` and ``reward_terms``. The terms are the world's, of that part alone: its own distance, turn, place and distance
    to the nearest; ``fallen`` of the part that fell; ``time`` and ``success`` as they are; 0 of absent parts. Their mean over
    the present parts is the world's term for distance, turn, inside (of zones), clearance, time and success, unless a part is
    at a term's bound. With ``observation="goal"`` they are the goal reward. With disturbances, ``struck`` is the tilt (rad) by
    which a part was struck in the step, or 0; with ``model="tilting"``, ``toppled`` says which parts have tipped beyond their
    edge: they have fallen, too.

    Args:
        task: ``"Transport"``, ``"Align"``, ``"Rotate"``, ``"Follow"``, ``"Sort"``, ``"Singulate"``, ``"Pack"``,
            ``"Swap"``, ``"Push"``, ``"Feed"``, or one that you have registered.
        surface: ``"prototype"`` or a mapping of :class:`vibgym.Surface`'s fields (keys may carry ``_mm``).
        parts: a list of names of shipped parts (``"aluminium_block"``, ``"steel_block"``) or mappings with ``shape`` and its
            fields; with one of them for Transport, Align and Rotate.
        model: ``"planar"``, ``"averaged"``, ``"tilting"`` or ``"auto"`` (its default tolerance), as for
            :class:`vibgym.Simulator`, or a mapping with ``kind`` and the model's knobs.
        action, observation: see above.
        actuators: ``"ideal"``, ``"prototype"`` (:class:`vibgym.actuators.PrototypeActuators`: a dead zone, latency, no two
            elements alike), a registered name, or a mapping with ``kind`` and its settings.
        sensor: ``"ideal"``, ``"pose"`` (:class:`vibgym.sensing.PoseSensor`: poses with noise), ``"camera"``
            (:class:`vibgym.plugins.camera.CameraSensor`: measured in images, or off as if they were with
            ``"statistical": True``, which costs little), a registered name, or a mapping with ``kind``, its settings,
            ``estimator`` (``"none"``; ``"kalman"``; ``"model"``: what is measured is the state at which the next command
            begins to act, by the simulator under the commands given) and ``tell`` (see above). ``info["measured"]`` then holds
            ``age`` (periods) and ``sigma`` (m, m, rad) of each part, and of a camera how many parts it took for others at
            the last look (``swaps``), how many ran into one another (``merges``), and how many it lost (``losses``).
        randomize: None, or a mapping of what is drawn anew for every episode. ``"friction": [low, high]`` and ``"mass"``:
            factors on friction between table and part, and on mass, one a part. ``"incline"``: the largest angle of an
            inclined table, or [low, high], rad; its direction is drawn, too. ``"patches": [low, high]``: factors on friction
            (wear, dirt), for every element its own: parts that lie on several are turned. Sort, Singulate, Pack and Swap also
            take ``"parts": [low, high]``: so many of the parts, chosen at random, are there. Prototype actuators take [low,
            high] for their settings (:attr:`vibgym.actuators.PrototypeActuators.VARIED`). ``info["drawn"]`` says what was
            drawn. ``"disturbance"``, a mapping with ``rate`` (1/s) and ``tilt`` (rad, or ``tilt_deg``; a number, or [low,
            high]), strikes each part so often on average while the episode runs: with ``model="tilting"`` it is let go from a
            tilt, with other models it gets a kick with the statistics of what that does to it.
        start: of Sort and Pack: ``"scattered"`` (default: at random, at least 2 mm apart), ``"crowded"`` (one heap, in touch)
            or ``"pattern"``; or a mapping with ``kind`` and settings (:data:`vibgym.tasks.starts.STARTS`).
        zones: of Sort: a mapping from kind to [x_low, y_low, x_high, y_high] in m. Default: zones of six columns at the left
            end for the first kind, at the right end for the second, in the middle for the third.
        slots: of tasks with several parts: parts for which the state observation has room, at least the number of parts.
        walls: of tasks with several parts, but for Follow: borders with a wall, among ``"left"``, ``"right"``,
            ``"bottom"``, ``"top"``.
        paths: of Follow: a list with a mapping for each part, or a mapping for paths that are drawn, see
            :class:`vibgym.tasks.Follow`.
        task_settings: keyword arguments that the task has besides: ``hold``, periods in a row with all parts done that make
            success (10; at most an episode); ``weights``, a mapping from reward terms to what they count instead; of Pack its
            pattern's (``gap_mm``, ``rows``, ..., see :class:`vibgym.tasks.Pack`); those of Swap, Push and Feed; and those of a
            task of your own.
        periods_per_step: oscillation periods per step. Hold, time cost and limit count periods, so the task stays the same.
        max_episode_periods: periods after which an episode is truncated, where a step has several; with one a step that is
            Gymnasium's own ``max_episode_steps``. None: no limit.
        render_mode: None, ``"rgb_array"`` or ``"human"``.

    Raises:
        ValueError: a setting that is not among those.
    """

    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": 25}

    def __init__(self, task: str, *, render_mode: str | None = None, **options: Unpack[Keywords]) -> None:
        known = Options.from_mapping("keyword arguments", {"task": task, **options}, ("render_mode",))
        if render_mode is not None:
            checks.choice("render_mode", render_mode, RENDER_MODES)
        self.core = Core(known, 1, WorldInformation)
        self.render_mode = render_mode
        self.action_space = self.core.action.space
        self.observation_space = self.core.observation.space
        self.metadata = {"render_modes": list(RENDER_MODES), "render_fps": frames_per_second(self.core)}
        self._steps = 0
        self._closed = False
        self._viewer: Any = None
        if render_mode is not None:
            from vibgym.envs.viewer import Viewer  # pygame is an extra

            self._viewer = Viewer(self, f"vibgym {task}")

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: of this and the following episodes; None goes on with the generator.
            options: what to set of the start instead of drawing it: ``"pose"``, broadcastable to (parts, 3): x, y (m), heading
                (rad); ``"goal"``, likewise, for tasks with goal poses; ``"paths"``, a list with a mapping for each part, for
                Follow; ``"parts"``, numbers of those that are there, or booleans.

        Raises:
            ValueError: a bad seed, an unknown option or a start that cannot be; nothing has changed.
        """
        if seed is not None:
            seed = checks.count("seed", seed, least=0)
        override = self._override(options)
        if override is not None:  # try it first: a start that cannot be must change nothing
            generator = seeding.np_random(seed)[0] if seed is not None else copy.deepcopy(self.np_random)
            uniform = generator.random((1, self.core.task.draws))
            self.core.start_of(_FIRST, uniform, override)
        super().reset(seed=seed)
        self.core.reset(_FIRST, [self.np_random], override)
        self._steps, self._closed = 0, False
        if self._viewer is not None:
            self._viewer.begin(0)
            self._draw()
        self.core.refresh_all()
        return self._own(self.core.observations), self.core.information.read()[2]

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Advance by one step."""
        core = self.core
        if self._closed or not core.began:
            self._check_open(self._closed)
        core.step(core.action.shaped(action, None), action)
        self._steps += 1
        if self._viewer is not None:
            self._viewer.follow(0)
            self._draw()
        truncated = core.step_limit is not None and self._steps >= core.step_limit
        batch = core.observations
        observation = batch[0] if isinstance(batch, np.ndarray) else self._own(batch)
        reward, ended, info = core.information.read()
        return observation, reward, ended, truncated, info

    @property
    def compute_reward(self) -> Any:
        """Reward of reaching one goal when another was asked for, single or batched (GoalEnv).

        See :meth:`vibgym.tasks.PoseTask.compute_reward`. It works on the goals of observations, which a sensor may blur; the
        reward of a step is the same function of the truth. Only with ``observation="goal"``: learners take an environment that
        has it for a GoalEnv.
        """
        if not self.core.observation.goal_reward:
            raise AttributeError("compute_reward: only with observation='goal'")
        return self._goal_reward

    def _goal_reward(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: Any) -> Any:
        reward = self.core.task.compute_reward(achieved_goal, desired_goal, info)  # type: ignore[attr-defined]
        return float(reward) if reward.ndim == 0 else reward

    def get_state(self) -> dict[str, Any]:
        """Everything needed to go on bit for bit, generator included. Pictures' trails are not part of it."""
        return {**self.core.get_state(), "generator": generators.state_of(self.np_random), "steps": self._steps}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Go on from what :meth:`get_state` gave on an environment with the same settings.

        Raises:
            ValueError: a state of another environment, or a damaged one; nothing has changed.
        """
        names = (*Core.STATE, "generator", "steps")
        check_keys("state", state, names)
        steps = checks.count("state['steps']", state["steps"], least=0)
        generator = generators.generator_from("state['generator']", state["generator"])
        self.core.set_state({name: state[name] for name in Core.STATE})
        self.np_random, self._steps, self._closed = generator, steps, False
        if self._viewer is not None:
            self._viewer.begin(0)

    def render(self) -> np.ndarray | None:
        """The picture for ``"rgb_array"``; ``"human"`` draws by itself."""
        if not self.core.began:
            raise gym.error.ResetNeeded("call reset() before render()")
        if self.render_mode is None:
            gym.logger.warn("render(): the environment was made without render_mode; allowed: 'rgb_array', 'human'")
        if self.render_mode == "rgb_array":
            return self._viewer.frame(0)
        return None

    def close(self) -> None:
        """Close the window, if there is one; stepping goes on after a reset only."""
        self._closed = True
        if self._viewer is not None:
            self._viewer.close()

    def _draw(self) -> None:
        if self.render_mode == "human":
            self._viewer.show(0)

    def _own(self, seen: Any) -> Any:
        if isinstance(seen, dict):
            return {key: value[0] for key, value in seen.items()}
        return seen[0]
