"""PushT as a batch of worlds, and as a Gymnasium environment with the interface of gym-pusht.

Scene, controller, observations, actions, starts, reward and end of an episode are those of gym-pusht 0.1.8 (C. Chi et al.,
Diffusion Policy, RSS 2023; P. Florence et al., Implicit Behavioral Cloning, CoRL 2021). Lengths are pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding

from studies.pusht.kernel import DELAYED, HIGH, LOW, PROJECTED, PUSHER, SCENE, THICKNESS, Scene, T, advance
from vibgym import checks
from vibgym.kernels.reference import Pinned
from vibgym.physics.contacts.hulls import Hulls, HullTable, all_gaps
from vibgym.physics.contacts.impulses import new_points
from vibgym.scene.hulls import hulls_of
from vibgym.scene.parts import Part
from vibgym.tasks.push import goal_coverage

SIZE, PERIODS, SUCCESS = 512.0, 300, 0.95
"""Width of the world (px), limit of an episode, and coverage above which it ends with success."""

RADIUS, SCALE = 15.0, 30.0
"""Radius of the pusher, and width of the T's bar and stem, px."""

BAR, STEM = np.array([4.0, 1.0]) * SCALE, np.array([1.0, 3.0]) * SCALE
"""Sizes of both boxes along x and y, px; the T's origin is the middle of the bar's outer edge."""

CENTRE = np.array([0.0, 1.5]) * SCALE
"""The T's centre of mass: the mean of the centres of both boxes, as if their masses were equal."""

GYRATION = 2.0 * ((BAR @ BAR) / 12.0 + (0.5 * SCALE) ** 2)
"""Inertia over mass, px^2: twice that of the bar about the origin, which gym-pusht assigns."""

GOAL = np.array([256.0, 256.0, 0.25 * np.pi])
"""Pose of the T's origin at the goal."""

CONTACTS = {"projected": PROJECTED, "delayed": DELAYED}
"""Laws of contact, see :mod:`studies.pusht.kernel`."""


def hulls() -> Hulls:
    """Return the hulls of T and pusher about their centres of mass, and of the walls."""
    friction = 1.0  # of the table, which these kernels do not use
    boxes = [Part.rectangle(*BAR, friction=friction), Part.rectangle(*STEM, friction=friction)]
    made = hulls_of([*boxes, Part.disc(RADIUS, friction=friction)])
    corner = made.corner.copy()
    for k, middle in enumerate((0.5 * BAR[1], BAR[1] + 0.5 * STEM[1])):
        corner[made.first[k] : made.first[k + 1], 1] += middle - CENTRE[1]
    radius = np.hypot(*corner[: made.first[2], :2].T).max()
    walls = np.array([[LOW, HIGH, 1, 0], [LOW, LOW, 0, 1], [HIGH, LOW, -1, 0], [HIGH, HIGH, 0, -1]])
    # Both sides of a wall, counter-clockwise: the first one faces the world.
    sides = np.stack([walls, np.hstack([np.roll(walls[:, :2], -1, axis=0), -walls[:, 2:]])], axis=1).reshape(-1, 4)
    table = HullTable(
        corner=np.concatenate([corner, sides]),
        first=np.concatenate([made.first, made.first[-1] + 2 * np.arange(1, 5)]),
        rounding=np.concatenate([made.rounding, np.full(4, THICKNESS)]),
        owner=np.array([0, 2, 3, 7]),
        radius=np.array([radius, RADIUS, 0.0]),
    )
    return Hulls(*table, np.arange(3), np.arange(3)[None], table)


def centre_of(pose: np.ndarray) -> np.ndarray:
    """Return poses (..., 3) of the centre of mass from those of the T's origin."""
    return _shifted(pose, 1.0)


def origin_of(pose: np.ndarray) -> np.ndarray:
    """Return poses (..., 3) of the T's origin from those of its centre of mass."""
    return _shifted(pose, -1.0)


def _shifted(pose: np.ndarray, sign: float) -> np.ndarray:
    moved, length = np.array(pose, dtype=np.float64), sign * CENTRE[1]
    moved[..., 0] -= length * np.sin(moved[..., 2])
    moved[..., 1] += length * np.cos(moved[..., 2])
    return moved


def start_of(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return position (2,) of the pusher and pose (3,) of the T's centre of mass that gym-pusht draws for a seed."""
    generator, _ = seeding.np_random(seed)
    drawn = [int(generator.integers(*limits)) for limits in ((50, 450), (50, 450), (100, 400), (100, 400))]
    # gym-pusht turns the T after placing it at heading 0, so its centre of mass stays where it is then.
    pose = np.array([drawn[2], drawn[3] + CENTRE[1], generator.uniform(-np.pi, np.pi)])
    return np.array(drawn[:2], dtype=np.float64), pose


class PushStep(NamedTuple):
    """Result of a control period of all worlds."""

    observation: np.ndarray  # (worlds, 5) x, y of the pusher; x, y of the T's origin, px; its angle in [0, 2 pi)
    reward: np.ndarray  # (worlds,) coverage / 0.95, at most 1
    success: np.ndarray  # (worlds,) bool: coverage above 0.95, which ends the episode
    coverage: np.ndarray  # (worlds,) share of the goal that the T covers


class PushT:
    """A batch of worlds.

    Args:
        worlds: number of worlds.
        contacts: ``"projected"``, or ``"delayed"``: as in pymunk.

    Attributes:
        pusher: (worlds, 4) position px and velocity px/s.
        block: (worlds, 3) pose of the T's centre of mass.
        drift: (worlds, 3) velocity of the T at the next step of ``"delayed"``.
    """

    def __init__(self, worlds: int = 1, contacts: str = "projected") -> None:
        self.worlds = checks.count("worlds", worlds)
        self.law = CONTACTS[checks.choice("contacts", contacts, CONTACTS)]
        self.hulls = hulls()
        points = new_points(3, 2 * 2 * 5)  # two of each box with the pusher and each wall
        points.inverse[T] = 1.0, 1.0 / GYRATION  # the others are not pushed
        self._scene = Pinned(SCENE, Scene(self.hulls, points, self.hulls.corner.copy()))
        self.pusher, self.block = np.zeros((self.worlds, 4)), np.zeros((self.worlds, 3))
        self.drift = np.zeros((self.worlds, 3))
        self.goal = centre_of(GOAL)

    def reset(self, seeds: Sequence[int]) -> np.ndarray:
        """Set the starts of seeds (worlds,) and take a step without control, as gym-pusht does; return observations."""
        if len(seeds) != self.worlds:
            raise checks.refuse("seeds", seeds, f"{self.worlds} whole numbers")
        starts = [start_of(checks.count("seed", seed, least=0)) for seed in seeds]
        self.set_state(np.array([pusher for pusher, _ in starts]), np.array([block for _, block in starts]))
        self._advance(self.pusher[:, None, :2].copy(), controlled=False)
        return self.observation()

    def set_state(self, pusher: Any, block: Any, drift: Any = 0.0) -> None:
        """Set all worlds.

        Args:
            pusher: (worlds, 2) or (worlds, 4) position, and velocity (default: at rest).
            block: (worlds, 3) pose of the T's centre of mass.
            drift: see :attr:`drift`.
        """
        moving = np.shape(pusher)[-1:] == (4,)
        pusher = checks.array("pusher", pusher, (self.worlds, 4 if moving else 2))
        block = checks.array("block", block, (self.worlds, 3))
        drift = checks.array("drift", drift, (self.worlds, 3))
        self.pusher[:], self.block[:], self.drift[:] = 0.0, block, drift
        self.pusher[:, : pusher.shape[1]] = pusher

    def observation(self) -> np.ndarray:
        """Return the observations (worlds, 5)."""
        block = origin_of(self.block)
        block[:, 2] %= 2.0 * np.pi
        return np.concatenate([self.pusher[:, :2], block], axis=1)

    def coverage(self, block: np.ndarray | None = None) -> np.ndarray:
        """Return the shares (n,) of the goal that a T covers at poses (n, 3) of its centre of mass, by default all worlds'."""
        block = self.block if block is None else block
        coverage = np.empty(len(block))
        goal_coverage(
            self.hulls, T, block[:, None], np.tile(self.goal, (len(block), 1, 1)), coverage, np.arange(len(block))
        )
        return coverage

    def gaps(self) -> np.ndarray:
        """Return the gaps (worlds,) between T and pusher, px; negative: overlap."""
        pose, gaps = np.zeros((self.worlds, 3, 3)), np.empty((self.worlds, 3, 3))
        pose[:, T], pose[:, PUSHER, :2] = self.block, self.pusher[:, :2]
        all_gaps(self.hulls, pose, gaps)
        return gaps[:, T, PUSHER]

    def step(self, action: Any) -> PushStep:
        """Advance all worlds by a control period (0.1 s).

        Args:
            action: (worlds, 2) target positions of the pushers in [0, 512] px.
        """
        self.rollout(checks.array("action", action, (self.worlds, 2), least=0.0, most=SIZE)[:, None])
        coverage = self.coverage()
        return PushStep(self.observation(), np.minimum(coverage / SUCCESS, 1.0), coverage > SUCCESS, coverage)

    def rollout(self, actions: Any) -> np.ndarray:
        """Advance all worlds by several periods; return pushers' positions and T's poses after each, (worlds, periods, 5).

        Args:
            actions: (worlds, periods, 2) px.
        """
        if np.ndim(actions) != 3:
            raise checks.refuse("actions", np.shape(actions), f"of shape ({self.worlds}, periods, 2)")
        actions = checks.array("actions", actions, (self.worlds, np.shape(actions)[1], 2))
        return self._advance(np.array(actions, order="C"), controlled=True)

    def _advance(self, actions: np.ndarray, controlled: bool) -> np.ndarray:
        trace = np.empty((self.worlds, actions.shape[1], 5))
        advance(self._scene.address, self.law, controlled, self.pusher, self.block, self.drift, actions, trace)
        return trace


class PushTEnv(gym.Env):
    """One world with the interface of gym-pusht's ``PushT-v0`` and ``obs_type="state"``, its limit of 300 steps included."""

    metadata = {"render_modes": [], "render_fps": 10}

    def __init__(self, contacts: str = "projected") -> None:
        self.batch = PushT(1, contacts)
        self.action_space = spaces.Box(0.0, SIZE, (2,), np.float32)
        high = np.array([SIZE, SIZE, SIZE, SIZE, 2.0 * np.pi])
        self.observation_space = spaces.Box(np.zeros(5), high, dtype=np.float64)
        self._steps = 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start an episode; without a seed, one is drawn."""
        super().reset(seed=seed)
        self._steps = 0
        chosen = int(self.np_random.integers(2**31)) if seed is None else seed
        return self.batch.reset([chosen])[0], {"is_success": False}

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Advance by a control period."""
        step = self.batch.step(action)
        self._steps += 1
        done = bool(step.success[0])
        info = {"is_success": done, "coverage": float(step.coverage[0])}
        return step.observation[0], float(step.reward[0]), done, self._steps >= PERIODS, info
