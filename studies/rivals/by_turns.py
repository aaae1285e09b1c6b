"""The plate's policy for several parts with zones: minimize the distances of predicted resting positions from the zones.

A plate has three degrees of freedom for all parts, so it cannot give each part the push that a controller commands. Velocity
control makes no progress if the velocities are not feasible together. This policy uses positions instead:

- Friction brakes a part at the rate c. A part at p with velocity v comes to rest at p + v / c.
- A stroke that pushes it with u for a time T shifts that position by u T / c.
- The policy selects stroke and strength with the smallest sum of squared distances from the zones, plus costs of positions
  beside the table and of parts near each other.
- Later strokes correct the side effects of earlier ones, so parts take turns.
- With zones alone, parts that block each other would stay. The planner therefore assigns targets in the zones, and the
  distance from these has a small weight.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from studies.rivals.fitting import effect_of
from studies.rivals.machines import MACHINES
from studies.rivals.policies import OUTPUTS, initial_strokes
from vibgym import checks
from vibgym.allocation.cut import cut_parts, new_pieces
from vibgym.kernels.jit import jit
from vibgym.policies.classical.measured import Measured
from vibgym.policies.classical.planner import PlannerPolicy
from vibgym.policies.classical.steering import SteeringMemory
from vibgym.policies.task_info import TaskInfo
from vibgym.simulation import threads as workers

STRENGTHS = np.array([1.0, -1.0, 0.4, -0.4, 0.16, -0.16, 0.06, -0.06, 0.02, -0.02])
"""Candidate strengths of every stroke, relative to the largest."""

EFFORT = 1e-7
"""m^2, cost of a stroke of full strength."""

CANDIDATES = 64
"""Number of strokes evaluated at all strengths, selected by gradient and curvature of the squared distances."""

JAMMED, EASE, EASED = 750, 150, 50
"""Number of steps after which a world counts as jammed. From then on, ``EASED`` of every ``EASE`` steps have other weights
(:data:`EASY`), so that blocking parts move away."""

EASY = 0.1, 1.0
"""Weights ``near`` and ``place`` in these steps: parts may come closer, and targets have more weight."""

INSIDE = 0.004
"""m, distance of a resting position from the border of its zone at which a part counts as arrived."""

MARGIN, EDGE, ROOM = 0.03, 0.02, 0.005
"""m, required distances: from the border of the zone, from the edge of the table, between the circles around parts."""

BESIDE, NEAR, PLACE = 100.0, 1.0, 0.05
"""Weights of squared distances relative to that from a zone: beyond the table, missing between parts, from the target."""


class CostParameters(NamedTuple):
    """Parameters of the cost of resting positions, the same in all worlds."""

    low: np.ndarray  # (parts, 2) m, corners of the zones
    high: np.ndarray
    size: np.ndarray  # (2,) m, of the table
    apart: np.ndarray  # (parts,) m, half the required distance between centres
    shift: np.ndarray  # (parts,) m, shift of the resting position by a push of 1 during a step
    margin: float
    edge: float
    beside: float
    near: float
    place: float


@jit
def resting_cost(costs, rest, present, target, one, other, pairs):
    """Return the cost of resting positions (parts, 2) m: squared distances from zones, targets, the table and each other."""
    total = 0.0
    for p in range(rest.shape[0]):
        if not present[p]:
            continue
        for k in range(2):
            x = rest[p, k]
            off = max(costs.low[p, k] + costs.margin - x, x - costs.high[p, k] + costs.margin, 0.0)
            out = max(costs.edge - x, x - (costs.size[k] - costs.edge), 0.0)
            total += off * off + costs.beside * out * out + costs.place * (x - target[p, k]) ** 2
    for i in range(pairs):
        p, q = one[i], other[i]
        x, y = rest[p, 0] - rest[q, 0], rest[p, 1] - rest[q, 1]
        square, least = x * x + y * y, costs.apart[p] + costs.apart[q]
        if square < least * least:
            lack = least - math.sqrt(square)
            total += costs.near * lack * lack
    return total


@jit
def resting_gradient(costs, rest, present, target, one, other, pairs, slope):
    """Write the gradient of :func:`resting_cost`, (parts, 2) m."""
    slope[:] = 0.0
    for p in range(rest.shape[0]):
        if not present[p]:
            continue
        for k in range(2):
            x = rest[p, k]
            off = min(x - costs.low[p, k] - costs.margin, 0.0) + max(x - costs.high[p, k] + costs.margin, 0.0)
            out = min(x - costs.edge, 0.0) + max(x - (costs.size[k] - costs.edge), 0.0)
            slope[p, k] = 2.0 * (off + costs.beside * out + costs.place * (x - target[p, k]))
    for i in range(pairs):
        p, q = one[i], other[i]
        x, y = rest[p, 0] - rest[q, 0], rest[p, 1] - rest[q, 1]
        length, least = max(math.sqrt(x * x + y * y), 1e-9), costs.apart[p] + costs.apart[q]
        if length < least:
            pull = -2.0 * costs.near * (least - length) / length
            slope[p, 0] += pull * x
            slope[p, 1] += pull * y
            slope[q, 0] -= pull * x
            slope[q, 1] -= pull * y


@jit
def predicted_decrease(costs, effect, slope, most):
    """Return the decrease of the cost at the best strength up to ``most``, by gradient and curvature without collisions."""
    fall, bend = 0.0, 1e-15
    for p in range(effect.shape[0]):
        x, y = costs.shift[p] * effect[p, 0], costs.shift[p] * effect[p, 1]
        fall += x * slope[p, 0] + y * slope[p, 1]
        bend += x * x + y * y
    strength = min(0.5 * abs(fall) / bend, most)
    return strength * (abs(fall) - strength * bend)


@jit
def near_pairs(costs, rest, present, one, other):
    """Write the pairs that may come too close in a step into ``one`` and ``other``; return their number."""
    pairs = 0
    for p in range(rest.shape[0]):
        for q in range(p):
            x, y = rest[p, 0] - rest[q, 0], rest[p, 1] - rest[q, 1]
            least = costs.apart[p] + costs.apart[q] + costs.shift[p] + costs.shift[q]
            if present[p] and present[q] and x * x + y * y < least * least:
                one[pairs], other[pairs] = p, q
                pairs += 1
    return pairs


@jit
def arrived(costs, rest, present):
    """Return whether the resting positions of all parts are in their zones."""
    for p in range(rest.shape[0]):
        for k in range(2):
            x = rest[p, k]
            if present[p] and (x < costs.low[p, k] + INSIDE or x > costs.high[p, k] - INSIDE):
                return False
    return True


@jit
def choose_strokes(
    start,
    stop,
    usual,
    easy,
    eased,
    outlines,
    pose,
    present,
    rest,
    target,
    stroke,
    push,
    strength,
    pieces,
    scratch,
    result,
):
    """Write the stroke (worlds, 3) with the smallest :func:`resting_cost`.

    Args:
        start, stop: range of worlds.
        usual, easy: :class:`CostParameters`, the second where ``eased`` (worlds,) bool.
        outlines, pieces: see :func:`vibgym.allocation.cut.cut_parts`.
        pose, present: (worlds, parts, 3) and (worlds, parts).
        rest, target: (worlds, parts, 2) m.
        stroke, push: (n, 3) and (n, elements, 2).  strength: (m,) candidates.
        scratch: see :func:`new_scratch`.
        result: (worlds, 3) output.
    """
    effect, moved, slope, one, other, decrease = scratch
    for w in range(start, stop):
        result[w] = 0.0
        costs = easy if eased[w] else usual
        if arrived(costs, rest[w], present[w]):
            continue
        count = cut_parts(outlines, w, pose[w], present[w], pieces)
        pairs = near_pairs(costs, rest[w], present[w], one, other)
        best = resting_cost(costs, rest[w], present[w], target[w], one, other, pairs)
        resting_gradient(costs, rest[w], present[w], target[w], one, other, pairs, slope)
        for k in range(stroke.shape[0]):
            effect_of(pieces, count, push[k], effect)
            decrease[k] = predicted_decrease(costs, effect, slope, strength[0])
        for _ in range(min(CANDIDATES, stroke.shape[0])):
            k = 0
            for i in range(1, stroke.shape[0]):
                if decrease[i] > decrease[k]:
                    k = i
            decrease[k] = -1.0
            effect_of(pieces, count, push[k], effect)
            for j in range(strength.shape[0]):
                for p in range(rest.shape[1]):
                    moved[p, 0] = rest[w, p, 0] + strength[j] * costs.shift[p] * effect[p, 0]
                    moved[p, 1] = rest[w, p, 1] + strength[j] * costs.shift[p] * effect[p, 1]
                cost = resting_cost(costs, moved, present[w], target[w], one, other, pairs)
                cost += EFFORT * strength[j] * strength[j]
                if cost < best:
                    best = cost
                    for i in range(3):
                        result[w, i] = strength[j] * stroke[k, i]


def new_scratch(parts: int, strokes: int) -> tuple[np.ndarray, ...]:
    """Allocate the scratch arrays of one thread."""
    pairs = np.empty((2, parts * parts), dtype=np.int64)
    return np.empty((parts, 3)), np.empty((parts, 2)), np.empty((parts, 2)), pairs[0], pairs[1], np.empty(strokes)


class ByTurnsPolicy(PlannerPolicy):
    """Strokes of one plate for several parts with zones; see the module.

    Args:
        info: task and scene.
        machine: ``"plate"`` or ``"plain-plate"``.

    Raises:
        ValueError: a task without zones, or an unknown machine.
    """

    def __init__(self, info: TaskInfo, machine: str) -> None:
        super().__init__(info, PlannerPolicy.Settings(law="pose", learn=False))
        if info.zones is None:
            raise checks.conflict(f"the policy 'by turns' requires a task with zones, unlike {info.name}")
        self.action = checks.choice("machine", machine, ("plate", "plain-plate"))
        self.output = OUTPUTS[machine](info, MACHINES[machine](info.surface, info.parts))
        self.allocator, surface, plant = self.output.allocator, info.surface, info.plant
        zone, self.drag = info.zones[list(info.kind)], plant.drag
        self.costs = CostParameters(
            low=np.ascontiguousarray(zone[:, :2]),
            high=np.ascontiguousarray(zone[:, 2:]),
            size=np.array([surface.width, surface.depth]),
            apart=np.array([part.radius for part in info.parts]) + 0.5 * ROOM,
            shift=plant.push / plant.strength * info.step_time / plant.drag,
            margin=min(MARGIN, 0.5 * float((zone[:, 2:] - zone[:, :2]).min())),
            edge=EDGE,
            beside=BESIDE,
            near=NEAR,
            place=PLACE,
        )
        plate = self.output.machine
        self.easy = self.costs._replace(near=EASY[0], place=EASY[1])
        self.stroke = initial_strokes(surface, plate, self.output.place).stroke
        push = plate.pushes(self.stroke).reshape(len(self.stroke), -1, 2)
        self.push, self.strength = np.ascontiguousarray(push), self.allocator.most * STRENGTHS

    def act(self, measured: Measured, memory: SteeringMemory, new: np.ndarray) -> tuple[np.ndarray, SteeringMemory]:
        """Return strokes; see :meth:`vibgym.policies.classical.steering.Steering.act`."""
        info, plan = self.info, self.aim(measured, memory.own, new)
        present, target = (np.ascontiguousarray(array) for array in (measured.present, plan.target))
        pose = np.ascontiguousarray(measured.pose + self.output.half * measured.rate)
        rest = np.ascontiguousarray(measured.centre + measured.velocity / self.drag[:, None])
        steps = plan.waited[:, 0]  # this policy counts steps in the planner's field for waiting times
        eased = (steps > JAMMED) & (steps % EASE < EASED)
        result = np.zeros((len(pose), 3))

        def work(start: int, stop: int) -> None:
            choose_strokes(
                start, stop, self.costs, self.easy, eased, self.allocator.outlines, pose, present, rest, target, self.stroke,
                self.push, self.strength, new_pieces(info.surface, info.parts),
                new_scratch(len(info.parts), len(self.stroke)), result,
            )  # fmt: skip

        workers.share(work, len(pose), self.output.threads)
        action = result.astype(np.float32)
        effect = self.allocator.effect(pose, present, self.output.machine.pushes(action.astype(np.float64)))
        acceleration, _ = self.process.acceleration(measured.rate, effect)
        memory = memory._replace(acceleration=acceleration, own=plan._replace(waited=plan.waited + 1.0))
        return (action[0] if measured.single else action), memory
