"""Estimate gain and phase of each element from where parts come to rest after pulses.

Near rest a part at p with velocity v comes to rest at ``zeta = p + v / c`` (:class:`.law.Settling`). A step of pushes ``u_e``
of the elements e under it shifts that place by ``B sum_e J_e h_e u_e``. ``J_e`` is the share of the part on the element and its
lever, ``h_e`` a complex gain: 1 for an ideal element, 0 for a dead one, with the element's phase error as its angle. An
estimator of the pose predicts with gains of 1, and later readings correct it. So the place of rest moves beyond its nominal
shift by ``B sum_e J_e (h_e - 1) u_e``, late and spread over some periods. Both sides are summed with a memory of some periods,
and a Kalman filter estimates ``h_e - 1`` of the elements under a part from these sums. One more unknown for each direction is
a drift of the place of rest, for example on an inclined table.

Elements that a part has left keep their estimates until their slots are needed for others.

The constants are tuned by hand on the prototype's hardware, with its readings and estimator: where goals are held
(``python -m studies.benchmarks.pose_control``), and on elements that are dead or differ by more.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.allocation.cut import Outlines, cut_parts, new_pieces, outlines_of
from vibgym.allocation.projections import SPREAD
from vibgym.kernels.jit import jit
from vibgym.policies.classical.measured import Measured
from vibgym.policies.task_info import TaskInfo

KEEP = 0.9  # share of the sums that is kept from step to step
BLUR = 0.82  # share of what an estimator has not yet corrected that it leaves to the next step
UNSEEN = 0.4e-3  # m, upper limit of what readings will yet correct: estimators that see much to correct are faster
ARRIVAL = 1.2e-3  # m, error of the place of rest of a part that has just become slow; it fades as the sums do
GAIN_SPREAD, PHASE_SPREAD = 0.06, 0.09  # prior standard deviations of gains, and of phases (rad)
DRIFT = 0.02e-3  # m per step, prior standard deviation of the drift
DRIFT_WANDER = 0.05  # share of that by which the drift changes in a step
NOISE = 0.08e-3  # m, of the measured sum
MISFIT = 0.05  # share of the sum of nominal shifts by which it may differ, because friction is not exactly linear
REPEATS = 4.0  # successive sums contain nearly the same information: this many count as one
SURPRISE = 3.0  # standard deviations beyond which elements are taken to be faulty
FAULT = 0.3  # standard deviation of their gains then
WANDER = 0.002  # standard deviation by which gains change in a step in which they act
SLOW, SLOW_TURN = 0.040, 1.5  # m/s and rad/s, below which the linear motion holds
MAX, MAX_PHASE, MIN = 1.3, 0.35, 0.35  # limits of gains and of phases (rad); elements below MIN count as dead
CAUTION = 1.2  # spread that the allocator assumes over the estimated standard deviation
SURE = 0.08  # minimum spread of an element whose gain has been estimated


class ElementGains(NamedTuple):
    """Memory of the estimator: arrays (batch, parts, ...), with ``room`` slots for elements under a part."""

    element: np.ndarray  # (..., room) int64, index of the element; -1: a free slot
    arm: np.ndarray  # (..., room, 3) share and lever of the part on it now, 0 where it is not under it
    mean: np.ndarray  # (..., 2 room + 3) real and imaginary parts of h - 1, and the drift, m a step
    covariance: np.ndarray  # (..., 2 room + 3, 2 room + 3)
    waiting: np.ndarray  # (..., lag, room, 2, 3) m, shifts by h - 1 = 1 and h - 1 = i, in steps not measured yet
    coming: np.ndarray  # (..., room, 2, 3) m, likewise, of which the readings contain a part so far
    summed: np.ndarray  # (..., room, 2, 3) m, sum of the shifts contained in the readings
    moved: np.ndarray  # (..., 3) m, the sum of shifts of the place of rest beyond the nominal one
    steps: np.ndarray  # (...) the sum of ones: 0 where nothing has been summed up; -1: the part is too fast
    rest: np.ndarray  # (..., 3) where the part should come to rest, by the nominal shift: m, m, rad


class PartConstants(NamedTuple):
    """Constants of the parts, for the kernels."""

    outlines: Outlines
    shift: np.ndarray  # (parts,) B, m
    gyration: np.ndarray  # (parts,) m
    turn: np.ndarray  # (parts,) rad, after which a part looks the same; 0: always


@jit
def within(value, most):
    """Return a value clipped to +-most."""
    return min(max(value, -most), most)


@jit
def assign_slots(gains, w, pieces, count):
    """Assign slots to the elements now under the parts of world ``w``, and set their arms."""
    room = gains.element.shape[2]
    gains.arm[w] = 0.0
    for i in range(count):  # elements that have a slot
        p = pieces.part[i]
        for k in range(room):
            if gains.element[w, p, k] == pieces.element[i]:
                set_arm(gains, w, p, k, pieces, i)
    for i in range(count):  # the others, in slots whose elements are no longer under the part
        p, free, known = pieces.part[i], -1, False
        for k in range(room):
            known = known or gains.element[w, p, k] == pieces.element[i]
            if free < 0 and gains.arm[w, p, k, 0] == 0.0:
                free = k
        if not known and free >= 0:
            reset_slot(gains, w, p, free, pieces.element[i])
            set_arm(gains, w, p, free, pieces, i)


@jit
def set_arm(gains, w, p, k, pieces, i):
    """Set the arm of slot ``k`` to that of piece ``i``."""
    gains.arm[w, p, k, 0] = pieces.share[i]
    gains.arm[w, p, k, 1], gains.arm[w, p, k, 2] = pieces.lever[i, 0], pieces.lever[i, 1]


@jit
def reset_slot(gains, w, p, k, e):
    """Assign slot ``k`` to element ``e``, with the prior estimate."""
    gains.element[w, p, k] = e
    for q in range(2):
        i = 2 * k + q
        gains.mean[w, p, i] = 0.0
        gains.covariance[w, p, i, :] = 0.0
        gains.covariance[w, p, :, i] = 0.0
        gains.covariance[w, p, i, i] = PHASE_SPREAD**2 if q else GAIN_SPREAD**2
    gains.summed[w, p, k] = 0.0
    gains.waiting[w, p, :, k] = 0.0
    gains.coming[w, p, k] = 0.0


@jit
def kalman_update(gains, w, p, axis, noise, column):
    """Correct the estimate by the sum along one axis, whose other side is ``summed``; noise is a variance, m^2."""
    mean, covariance, summed = gains.mean[w, p], gains.covariance[w, p], gains.summed[w, p]
    room, n = summed.shape[0], mean.shape[0]
    drift, steps = 2 * room + axis, gains.steps[w, p]
    error, total = gains.moved[w, p, axis] - steps * mean[drift], noise
    for i in range(n):
        value = covariance[i, drift] * steps
        for k in range(room):
            value += covariance[i, 2 * k] * summed[k, 0, axis] + covariance[i, 2 * k + 1] * summed[k, 1, axis]
        column[i] = value
    for k in range(room):
        for q in range(2):
            error -= summed[k, q, axis] * mean[2 * k + q]
            total += summed[k, q, axis] * column[2 * k + q]
    total += steps * column[drift]
    if error * error > SURPRISE * SURPRISE * total:  # some element is faulty
        for k in range(room):
            for q in range(2):
                s = summed[k, q, axis]
                i = 2 * k + q
                more = max(FAULT * FAULT - covariance[i, i], 0.0)
                if s != 0.0 and more > 0.0:
                    covariance[i, i] += more
                    column[i] += more * s
                    total += more * s * s
    for i in range(n):
        mean[i] += column[i] * error / total
        for j in range(n):
            covariance[i, j] -= column[i] * column[j] / total
    for i in range(n):
        covariance[i, i] = max(covariance[i, i], 0.0)
    for k in range(room):
        mean[2 * k] = min(max(mean[2 * k], -1.0), MAX - 1.0)
        mean[2 * k + 1] = within(mean[2 * k + 1], MAX_PHASE)


@jit
def correct(gains, constants, w, p, rest, column):
    """Correct the estimate by where a slow part comes to rest according to the readings of this step."""
    room, size = gains.summed.shape[2], 0.0
    gains.steps[w, p] = KEEP * gains.steps[w, p] + 1.0
    for axis in range(3):
        off = rest[axis] - gains.rest[w, p, axis]
        if axis == 2:
            if constants.turn[p] == 0.0:
                off = 0.0
            else:
                off = constants.gyration[p] * (off - constants.turn[p] * math.floor(0.5 + off / constants.turn[p]))
        gains.moved[w, p, axis] = KEEP * gains.moved[w, p, axis] + off
        net = 0.0
        for k in range(room):
            for q in range(2):
                shift = (1.0 - BLUR) / BLUR * gains.coming[w, p, k, q, axis]
                gains.summed[w, p, k, q, axis] = KEEP * gains.summed[w, p, k, q, axis] + shift
            net += gains.summed[w, p, k, 0, axis]
        size += net * net
    early = ARRIVAL * (1.0 - (1.0 - KEEP) * gains.steps[w, p])
    noise = REPEATS * (NOISE * NOISE + MISFIT * MISFIT * size + early * early)
    for i in range(2 * room):
        gains.covariance[w, p, i, i] += WANDER * WANDER if gains.summed[w, p, i // 2, 0, 0] != 0.0 else 0.0
    for axis in range(3):
        gains.covariance[w, p, 2 * room + axis, 2 * room + axis] += (DRIFT_WANDER * DRIFT) ** 2
    for axis in range(3):
        if axis < 2 or constants.turn[p] != 0.0:
            kalman_update(gains, w, p, axis, noise, column)


@jit
def learn(constants, pieces, gains, pose, present, rest, slow, column, ahead, doubt):
    """Update the estimates from where the parts come to rest.

    Args:
        pose, rest: (batch, parts, 3), now, and where the parts come to rest.
        present, slow: (batch, parts) bool.
        column: (2 room + 3,) scratch.
        ahead: (batch, parts, 3) m, m, rad: corrections that later readings will contain; overwritten.
        doubt: (batch, parts, 3) m, m, rad: their standard deviation; overwritten.
    """
    lag, room = gains.waiting.shape[2], gains.element.shape[2]
    for w in range(pose.shape[0]):
        any_slow = False
        for p in range(pose.shape[1]):
            if not (present[w, p] and slow[w, p]):
                gains.steps[w, p] = -1.0
                continue
            any_slow = True
            if gains.steps[w, p] >= 0.0:
                correct(gains, constants, w, p, rest[w, p], column)
            else:
                gains.steps[w, p] = 0.0
                gains.moved[w, p] = 0.0
                gains.summed[w, p] = 0.0
        if any_slow:
            assign_slots(gains, w, pieces, cut_parts(constants.outlines, w, pose[w], present[w], pieces))
        else:
            gains.arm[w] = 0.0
    for w in range(pose.shape[0]):
        for p in range(pose.shape[1]):
            for axis in range(3):
                total, variance = 0.0, 0.0
                for k in range(room):
                    for q in range(2):
                        left = gains.coming[w, p, k, q, axis]
                        for j in range(lag - 1):
                            left += gains.waiting[w, p, j, k, q, axis]
                        total += gains.mean[w, p, 2 * k + q] * left
                        variance += gains.covariance[w, p, 2 * k + q, 2 * k + q] * left * left
                doubt[w, p, axis] = math.sqrt(variance) if axis < 2 else math.sqrt(variance) / constants.gyration[p]
                total = within(total, UNSEEN)
                ahead[w, p, axis] = total if axis < 2 else total / constants.gyration[p]


@jit
def put_known(gains, gain, phase, spread):
    """Write the estimates of the elements under slow parts into arrays (batch, elements)."""
    for w in range(gains.element.shape[0]):
        for p in range(gains.element.shape[1]):
            for k in range(gains.element.shape[2]):
                e = gains.element[w, p, k]
                if e < 0 or gains.arm[w, p, k, 0] == 0.0:
                    continue
                real, imaginary = 1.0 + gains.mean[w, p, 2 * k], gains.mean[w, p, 2 * k + 1]
                size = math.sqrt(real * real + imaginary * imaginary)
                if real < MIN:
                    gain[w, e] = 0.0
                else:
                    gain[w, e] = min(size, MAX)
                    phase[w, e] = within(math.atan2(imaginary, real), MAX_PHASE)
                own = gains.covariance[w, p, 2 * k, 2 * k] + gains.covariance[w, p, 2 * k + 1, 2 * k + 1]
                spread[w, e] = max(CAUTION * math.sqrt(own), SURE)


@jit
def predict(constants, gains, push, effect):
    """Store the shifts by the commanded pushes (batch, elements, 2), and the predicted places of rest of the parts.

    Rows of ``effect`` (batch, parts, 3) of slow parts are overwritten with the pushes that nominal elements give them.
    """
    room = gains.element.shape[2]
    for w in range(effect.shape[0]):
        for p in range(effect.shape[1]):
            gains.waiting[w, p, 0] = 0.0
            total, across, turned, b = 0.0, 0.0, 0.0, constants.shift[p]
            for k in range(room):
                e, share = gains.element[w, p, k], gains.arm[w, p, k, 0]
                if e < 0 or share == 0.0:
                    continue
                lx, ly = gains.arm[w, p, k, 1], gains.arm[w, p, k, 2]
                x, y = push[w, e, 0], push[w, e, 1]
                own = gains.waiting[w, p, 0, k]
                own[0, 0], own[0, 1], own[0, 2] = b * share * x, b * share * y, b * (lx * y - ly * x)
                own[1, 0], own[1, 1], own[1, 2] = -b * share * y, b * share * x, b * (lx * x + ly * y)
                total, across, turned = total + own[0, 0], across + own[0, 1], turned + own[0, 2]
            gains.rest[w, p, 0] += total
            gains.rest[w, p, 1] += across
            gains.rest[w, p, 2] += turned / constants.gyration[p]
            if gains.steps[w, p] >= 0.0:
                effect[w, p, 0], effect[w, p, 1], effect[w, p, 2] = total / b, across / b, turned / b


class GainLearner:
    """Estimator of gains and phases of elements; see the module.

    Args:
        info: task, scene and step time.
    """

    def __init__(self, info: TaskInfo) -> None:
        surface, plant = info.surface, info.plant
        self.info, self.elements = info, surface.rows * surface.columns
        self.coast = 1.0 / plant.drag  # s
        outlines = outlines_of(surface, info.parts)
        shift = info.step_time * plant.push / plant.strength * self.coast
        turn = np.array([2.0 * math.pi / part.symmetry if part.symmetry else 0.0 for part in info.parts])
        self.constants = PartConstants(outlines, shift, np.sqrt([part.gyration for part in info.parts]), turn)
        self.room = max((math.floor(2.0 * part.radius / surface.element_size) + 2) ** 2 for part in info.parts)
        self.lag = -(-info.hardware.latency // info.periods_per_step) + 2

    def begin(self, batch: int) -> ElementGains:
        """Return the memory before the first measurement."""
        shape, room = (batch, len(self.info.parts)), self.room
        prior = np.append(np.zeros(2 * room), np.full(3, DRIFT**2))
        return ElementGains(
            element=np.full((*shape, room), -1),
            arm=np.zeros((*shape, room, 3)),
            mean=np.zeros((*shape, 2 * room + 3)),
            covariance=np.tile(np.diag(prior), (*shape, 1, 1)),
            waiting=np.zeros((*shape, self.lag, room, 2, 3)),
            coming=np.zeros((*shape, room, 2, 3)),
            summed=np.zeros((*shape, room, 2, 3)),
            moved=np.zeros((*shape, 3)),
            steps=np.full(shape, -1.0),
            rest=np.zeros((*shape, 3)),
        )

    def learn(self, measured: Measured, gains: ElementGains) -> tuple[np.ndarray, np.ndarray]:
        """Update the estimates, in place, by the present measurement.

        Returns:
            Corrections that later measurements will contain, and their standard deviation: (batch, parts, 3) m, m, rad.
        """
        pose = measured.pose
        rest = pose + self.coast[:, None] * measured.rate
        slow = ((measured.velocity**2).sum(axis=-1) < SLOW**2) & (np.abs(measured.spin) < SLOW_TURN)
        pieces, column = new_pieces(self.info.surface, self.info.parts), np.empty(gains.mean.shape[-1])
        ahead, doubt = np.empty_like(pose), np.empty_like(pose)
        gains.coming[...] = BLUR * (gains.coming + gains.waiting[:, :, -1])
        learn(self.constants, pieces, gains, pose, measured.present, rest, slow, column, ahead, doubt)
        gains.rest[...] = rest
        return ahead, doubt

    def known(self, gains: ElementGains) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return gain, phase (rad) and spread of the elements, (batch, elements) each."""
        shape = (len(gains.element), self.elements)
        gain, phase, spread = np.ones(shape), np.zeros(shape), np.full(shape, SPREAD)
        put_known(gains, gain, phase, spread)
        return gain, phase, spread

    def predict(self, push: np.ndarray, gains: ElementGains, effect: np.ndarray) -> np.ndarray:
        """Store the pushes (batch, rows, columns, 2) of elements; return the pushes that nominal ones give to the parts.

        Args:
            effect: (batch, parts, 3) pushes that the parts were meant to get, returned for fast parts.
        """
        gains.waiting[:, :, 1:] = gains.waiting[:, :, :-1].copy()
        effect = effect.copy()
        predict(self.constants, gains, push.reshape(len(push), -1, 2), effect)
        return effect


@jit
def turn_pushes(angle, push):
    """Turn pushes (batch, elements, 2) by angles (batch, elements), rad, in place."""
    for w in range(angle.shape[0]):
        for e in range(angle.shape[1]):
            if angle[w, e] != 0.0:
                cosine, sine = math.cos(angle[w, e]), math.sin(angle[w, e])
                x, y = push[w, e, 0], push[w, e, 1]
                push[w, e, 0], push[w, e, 1] = cosine * x - sine * y, sine * x + cosine * y
