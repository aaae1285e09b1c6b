"""Kalman filter around a predictor that runs ahead of the readings.

A reading describes a past instant (``delay``), and a command acts later (``latency``). A controller needs the state at the
instant at which its command takes effect. The predictor is always at that instant, ``lead = delay + latency`` periods after the
time of this step's reading. So every command is simulated once, independent of the lead.

The difference between a reading and the pose predicted for its instant corrects that prediction. The linear motion of a part
near rest (:mod:`vibgym.simulation.plant`) propagates the correction to all later predictions:

    p' = v,   v' = -c v + d,   d' = 0

``p`` is x, y or heading, each filtered separately; ``d`` is an acceleration that the model does not contain (an inclined table,
a wrong coefficient of friction). The process noise of ``v'`` is a floor and a share of the acting acceleration. So readings of
parts at rest are averaged, and readings of driven parts have more weight.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field

from vibgym import checks
from vibgym.kernels.jit import jit
from vibgym.kernels.reference import Layout, Pinned
from vibgym.physics.core.drive import Drive
from vibgym.sensing.base import Sensor
from vibgym.sensing.estimation.predictors import FreePredictor, ModelPredictor, Plant, drags_of
from vibgym.sensing.measurement import Reading, new_measurement
from vibgym.settings import Acceleration, BaseSettings
from vibgym.simulation.plant import motion

MIN_SIGMA = 1e-7
"""Floor of the standard deviation of readings, m and rad: an exact reading would have infinite weight."""

START_SPEED = 1e-3  # m/s, initial standard deviation of the velocity of a part
SURPRISE = 5.0
"""Standard deviations by which a reading may differ before the estimate counts as wrong, as after a collision."""

MEMORY, TREND = 0.8, 1.0
"""Weight of the previous mean innovation, and the mean (in standard deviations) above which the estimate counts as wrong: three
times that of white noise, ``sqrt((1 - m) / (1 + m))``. Neighbouring elements with different motion move a part in a way that
neither the model nor the commanded acceleration predicts."""


PP, PV, PD, VV, VD, DD = range(6)
"""Indices of a covariance (6,) of p, v and d: its upper triangle, row by row."""


class Filter(NamedTuple):
    """State and constants of the filter, pinned in memory for kernels."""

    pose: np.ndarray  # (worlds, parts, 3) of the predictor
    velocity: np.ndarray  # (worlds, parts, 3) likewise, at its instant
    mean_velocity: np.ndarray  # (worlds, parts, 3) likewise, over the last period
    fallen: np.ndarray  # (worlds, parts) bool, likewise
    diverged: np.ndarray  # (worlds,) bool, likewise
    # (steps, worlds, parts, 3) poses predicted for the instants of readings to come, the next one first
    kept: np.ndarray
    before: np.ndarray  # (worlds, parts, 3) mean velocity of the predictor a step ago
    activity: np.ndarray  # (steps, worlds, parts) m/s^2, acceleration that acted in the steps of ``kept``
    disturbance: np.ndarray  # (worlds, parts, 3) d
    covariance: np.ndarray  # (worlds, parts, 3, 6) at the instant of the last reading
    trend: np.ndarray  # (worlds, parts, 3) mean innovation, in standard deviations
    age: np.ndarray  # (worlds, parts) periods
    sigma: np.ndarray  # (worlds, parts, 3) of the predictor's pose
    gone: np.ndarray  # (worlds, parts) bool
    scratch: np.ndarray  # (6,)
    damping: np.ndarray  # (worlds, parts) c
    arm: np.ndarray  # (worlds, parts) m, radius of gyration
    variance: np.ndarray  # (worlds, parts, 3) of readings
    idle: np.ndarray  # (worlds, parts, 2) m/s, velocity of an idle part at the start of a period
    step: float  # s
    lead: float  # s
    floor: float  # m/s^2
    model_error: float
    unknown: float  # m/s^2
    drift: float  # m/s^2 per square root of a second


FILTER: Layout[Filter] = Layout("FILTER", __name__)
filter_at = FILTER.at


@jit
def spread(covariance, way, fall, left, noise, drift, result):
    """Write the propagated covariance, ``F P F' + G G' noise`` and the drift of ``d``, to ``result``; may be the same array."""
    pp, pv, pd = covariance[PP], covariance[PV], covariance[PD]
    vv, vd, dd = covariance[VV], covariance[VD], covariance[DD]
    result[PP] = pp + 2.0 * way * pv + 2.0 * fall * pd + way * way * vv + 2.0 * way * fall * vd + fall * fall * dd
    result[PV] = left * pv + way * pd + way * (left * vv + way * vd) + fall * (left * vd + way * dd)
    result[PD] = pd + way * vd + fall * dd
    result[VV] = left * left * vv + 2.0 * left * way * vd + way * way * dd
    result[VD] = left * vd + way * dd
    result[DD] = dd + drift
    result[PP] = max(result[PP] + fall * fall * noise, 0.0)
    result[PV] += fall * way * noise
    result[VV] += way * way * noise


@jit
def noise_of(all_of, step, w, p):
    """Return the variance of the unmodelled acceleration in one of the steps of ``kept``, m^2/s^4."""
    acting = all_of.model_error * all_of.activity[step, w, p]
    return all_of.floor * all_of.floor + acting * acting


@jit
def kalman_update(covariance, innovation, variance):
    """Update a covariance by a reading; returns the corrections of p, v and d."""
    total = covariance[PP] + variance
    if innovation * innovation > SURPRISE * SURPRISE * total:
        # The prediction is rejected: full weight for the reading, larger variance of the velocity.
        covariance[PP] += innovation * innovation
        covariance[VV] += innovation * innovation * 100.0
        total = covariance[PP] + variance
    kp, kv, kd = covariance[PP] / total, covariance[PV] / total, covariance[PD] / total
    left = variance / total  # 1 - kp without cancellation
    covariance[VV] = max(covariance[VV] - kv * covariance[PV], 0.0)
    covariance[VD] = covariance[VD] - kv * covariance[PD]
    covariance[DD] = max(covariance[DD] - kd * covariance[PD], 0.0)
    covariance[PP] = left * covariance[PP]
    covariance[PV] = left * covariance[PV]
    covariance[PD] = left * covariance[PD]
    return kp * innovation, kv * innovation, kd * innovation


@jit
def inflate_covariance(all_of, w, p, k, innovation):
    """Increase the covariance of position and velocity where innovations have kept the same sign."""
    covariance = all_of.covariance[w, p, k]
    total = covariance[PP] + all_of.variance[w, p, k]
    trend = MEMORY * all_of.trend[w, p, k] + (1.0 - MEMORY) * innovation / math.sqrt(total)
    if abs(trend) > TREND:
        wrong = trend * trend * total
        covariance[PP] += wrong
        covariance[VV] += all_of.damping[w, p] * all_of.damping[w, p] * wrong
        trend = 0.0
    all_of.trend[w, p, k] = trend


@jit
def update_activity(address):
    """Update the acceleration by friction and elements from the mean velocities of the predictor's step."""
    all_of = filter_at(address)
    before, now = all_of.before, all_of.mean_velocity
    last = all_of.activity.shape[0] - 1
    for w in range(now.shape[0]):
        for p in range(now.shape[1]):
            total = 0.0
            for k in range(3):
                scale = all_of.arm[w, p] if k == 2 else 1.0
                drag = all_of.damping[w, p] * now[w, p, k]
                acting = (now[w, p, k] - before[w, p, k]) / all_of.step + drag
                total += scale * scale * (acting * acting + drag * drag)  # friction is uncertain, too
                before[w, p, k] = now[w, p, k]
            all_of.activity[last, w, p] = math.sqrt(total)


@jit
def carry_disturbance(all_of, w, p):
    """Add the estimated disturbance acceleration to the predictor's step."""
    way, fall, _ = motion(all_of.damping[w, p], all_of.step)
    last = all_of.kept.shape[0] - 1
    for k in range(3):
        push = all_of.disturbance[w, p, k]
        all_of.pose[w, p, k] += fall * push
        all_of.kept[last, w, p, k] += fall * push
        all_of.velocity[w, p, k] += way * push
        all_of.mean_velocity[w, p, k] += way * push


@jit
def start_track(all_of, w, p, pose):
    """Restart the filter of a part at a pose (3,), at rest."""
    for k in range(3):
        scale = all_of.arm[w, p] if k == 2 else 1.0
        all_of.disturbance[w, p, k], all_of.trend[w, p, k] = 0.0, 0.0
        for step in range(all_of.kept.shape[0]):
            all_of.kept[step, w, p, k] = pose[k]
        covariance = all_of.covariance[w, p, k]
        covariance[:] = 0.0
        covariance[PP] = all_of.variance[w, p, k]
        covariance[VV] = (START_SPEED / scale) ** 2
        covariance[DD] = (all_of.unknown / scale) ** 2


@jit
def reset_track(all_of, w, p, pose):
    """Place a part of the predictor at a measured pose (3,), at rest."""
    start_track(all_of, w, p, pose)
    for k in range(3):
        all_of.pose[w, p, k], all_of.velocity[w, p, k], all_of.mean_velocity[w, p, k] = pose[k], 0.0, 0.0
    all_of.velocity[w, p, 0], all_of.velocity[w, p, 1] = all_of.idle[w, p, 0], all_of.idle[w, p, 1]
    all_of.fallen[w, p] = False


@jit
def begin_filter(which, pose, gone, address):
    """Restart for the parts ``which`` (worlds, parts), which the predictor has placed at ``pose``."""
    all_of = filter_at(address)
    for w in range(pose.shape[0]):
        for p in range(pose.shape[1]):
            if not which[w, p]:
                continue
            start_track(all_of, w, p, pose[w, p])
            for k in range(3):
                all_of.before[w, p, k], all_of.sigma[w, p, k] = 0.0, math.sqrt(all_of.variance[w, p, k])
            for step in range(all_of.activity.shape[0]):
                all_of.activity[step, w, p] = 0.0
            all_of.age[w, p], all_of.gone[w, p] = 0, gone[w, p]


@jit
def correct_all(reading, delay, periods, address):
    """Correct the predictions for the instant of the readings of all worlds, and all later predictions."""
    all_of = filter_at(address)
    scratch, steps, step = all_of.scratch, all_of.kept.shape[0], all_of.step
    for w in range(all_of.pose.shape[0]):
        for p in range(all_of.pose.shape[1]):
            seen, gone = reading.seen[w, p], reading.gone[w, p]
            all_of.age[w, p] += periods
            if seen:
                all_of.age[w, p], all_of.gone[w, p] = delay, gone
            lost = all_of.fallen[w, p] or all_of.diverged[w]
            if seen and lost and not gone:
                reset_track(all_of, w, p, reading.pose[w, p])
                lost = False
            if not lost:
                carry_disturbance(all_of, w, p)
            way, fall, left = motion(all_of.damping[w, p], step)
            on_way, on_fall, on_left = motion(all_of.damping[w, p], all_of.lead)
            rest_way, rest_fall, rest_left = motion(all_of.damping[w, p], all_of.lead - (steps - 1) * step)
            for k in range(3):
                scale = all_of.arm[w, p] if k == 2 else 1.0
                covariance = all_of.covariance[w, p, k]
                drift = all_of.drift * all_of.drift * step / (scale * scale)
                if all_of.age[w, p] > delay or seen:  # else still the covariance of the start
                    spread(covariance, way, fall, left, noise_of(all_of, 0, w, p) / (scale * scale), drift, covariance)
                if seen and not gone and not lost:
                    innovation = reading.pose[w, p, k] - all_of.kept[0, w, p, k]
                    inflate_covariance(all_of, w, p, k, innovation)
                    dp, dv, dd = kalman_update(covariance, innovation, all_of.variance[w, p, k])
                    all_of.disturbance[w, p, k] += dd
                    for later in range(1, steps):
                        a, b, _ = motion(all_of.damping[w, p], later * step)
                        all_of.kept[later, w, p, k] += dp + a * dv + b * dd
                    all_of.pose[w, p, k] += dp + on_way * dv + on_fall * dd
                    all_of.velocity[w, p, k] += on_left * dv + on_way * dd
                    all_of.mean_velocity[w, p, k] += on_left * dv + on_way * dd
                    all_of.before[w, p, k] += on_left * dv + on_way * dd
                for row in range(6):
                    scratch[row] = covariance[row]
                for later in range(1, steps):
                    noise = noise_of(all_of, later, w, p) / (scale * scale)
                    spread(scratch, way, fall, left, noise, 0.0, scratch)
                noise = noise_of(all_of, steps - 1, w, p) / (scale * scale)
                spread(scratch, rest_way, rest_fall, rest_left, noise, 0.0, scratch)
                all_of.sigma[w, p, k] = math.sqrt(max(scratch[PP], 0.0))
        if all_of.diverged[w]:
            all_of.diverged[w] = False


class FilterEstimator:
    """A predictor corrected by readings; see the module.

    The measurement is the state at which the next command begins to act: ``latency`` periods after the present.

    Args:
        sensor: source of the readings.
        predictor: propagates the estimate.
        latency: periods between a command and its effect.
        settings: of the filter.
        model_error: see :class:`ModelEstimator.Settings`.

    Attributes:
        measurement: the predictor's state, live.
        lead: the latency.
    """

    class Settings(BaseSettings):
        """Settings of the Kalman filter."""

        acceleration: Acceleration = Field(default=1.5, gt=0.0, le=1e3)
        """Standard deviation of the unmodelled acceleration at rest."""

        unknown: Acceleration = Field(default=1.0, ge=0.0, le=1e3)
        """Standard deviation of an unmodelled acceleration that is constant in the episode."""

        drift: float = Field(default=0.02, ge=0.0, le=1e3)
        """m/s^2 per square root of a second, rate at which that changes."""

        sigma: float = Field(default=1.0, gt=0.0, le=1e3)
        """Factor on the standard deviations of readings."""

    def __init__(
        self,
        sensor: Sensor,
        predictor: FreePredictor | ModelPredictor,
        latency: int,
        settings: Settings,
        model_error: float = 0.0,
    ) -> None:
        worlds, parts, periods = sensor.worlds, len(sensor.parts), sensor.periods
        lead = sensor.delay + latency
        self._sensor, self._predictor, self.lead = sensor, predictor, latency
        self._factor = settings.sigma
        self._instant = periods - lead % periods
        steps, state = lead // periods + 1, predictor.state
        measured = new_measurement(worlds, parts)
        self.measurement = measured._replace(pose=state.pose, mean_velocity=state.mean_velocity)
        period = sensor.surface.period
        self._filter = Pinned(
            FILTER,
            Filter(
                pose=state.pose,
                velocity=state.velocity,
                mean_velocity=state.mean_velocity,
                fallen=state.fallen,
                diverged=state.diverged,
                kept=np.zeros((steps, worlds, parts, 3)),
                before=np.zeros((worlds, parts, 3)),
                activity=np.zeros((steps, worlds, parts)),
                disturbance=np.zeros((worlds, parts, 3)),
                covariance=np.zeros((worlds, parts, 3, 6)),
                trend=np.zeros((worlds, parts, 3)),
                age=measured.age,
                sigma=measured.sigma,
                gone=measured.gone,
                scratch=np.zeros(6),
                damping=drags_of(sensor),
                arm=sensor.kinds.values(lambda part: math.sqrt(part.gyration), worlds),
                variance=np.zeros((worlds, parts, 3)),
                idle=sensor.kinds.values(lambda part: sensor.surface.idle_velocity(part.friction), worlds),
                step=periods * period,
                lead=lead * period,
                floor=settings.acceleration,
                model_error=model_error,
                unknown=settings.unknown,
                drift=settings.drift,
            ),
        )

        self._update_variance()

    def _update_variance(self) -> None:
        """Set the variance of readings, which may depend on the kinds of the parts."""
        self._filter.record.variance[...] = (self._factor * np.maximum(self._sensor.all_sigma, MIN_SIGMA)) ** 2

    def prepare(self, command: Drive) -> None:
        self._predictor.prepare(command)

    def reset(self, worlds: np.ndarray, reading: Reading) -> None:
        self._predictor.place(worlds, reading.pose[worlds], reading.gone[worlds])
        if self._sensor.kinds.vary:
            self._update_variance()
        which = np.zeros(reading.gone.shape, dtype=bool)
        which[worlds] = True
        begin_filter(which, reading.pose, reading.gone, self._filter.address)

    def reset_parts(self, which: np.ndarray, reading: Reading) -> None:
        self._predictor.reset_parts(which, reading.pose[which], reading.gone[which])
        begin_filter(which, reading.pose, reading.gone, self._filter.address)

    def predict(self, command: Drive) -> None:
        record = self._filter.record
        if len(record.kept) > 1:
            record.kept[:-1] = record.kept[1:]
            record.activity[:-1] = record.activity[1:]
        self._predictor.run(command, self._instant, record.kept[-1])
        update_activity(self._filter.address)

    def correct(self, reading: Reading) -> None:
        if self._sensor.kinds.vary:  # a snapshot may have changed them
            self._update_variance()
        correct_all(reading, self._sensor.delay, self._sensor.periods, self._filter.address)

    def live(self) -> dict[str, np.ndarray]:
        own = ("kept", "before", "activity", "disturbance", "covariance", "trend", "age", "sigma", "gone")
        return {**{name: getattr(self._filter.record, name) for name in own}, **self._predictor.live()}


class KalmanEstimator(FilterEstimator):
    """Kalman filter with friction as the only model."""

    def __init__(
        self,
        sensor: Sensor,
        plant: Plant,
        latency: int,
        walls: Sequence[str],
        settings: FilterEstimator.Settings | None = None,
    ) -> None:
        super().__init__(sensor, FreePredictor(sensor), latency, settings or self.Settings())


class ModelEstimator(FilterEstimator):
    """The simulator as a model of the hardware, corrected by a Kalman filter."""

    class Settings(FilterEstimator.Settings):
        """Settings of the filter with a model of the hardware: smaller accelerations are not modelled."""

        acceleration: Acceleration = Field(default=0.001, gt=0.0, le=1e3)
        unknown: Acceleration = Field(default=0.01, ge=0.0, le=1e3)
        drift: float = Field(default=0.005, ge=0.0, le=1e3)

        model: Literal["planar", "averaged", "auto"] = "planar"
        """Of the simulator; planar ones only, since sensors do not measure tilts."""

        model_error: float = Field(default=0.06, ge=0.0, le=10.0)
        """Standard deviation of the unmodelled acceleration, as a share of the acting one."""

        delivered: float = Field(default=1.0, gt=0.0, le=1.0)
        """Share of the elements' motion that reaches parts; rigid parts that rock get less than even pressure yields, see
        docs/tilting.md."""

    def __init__(
        self, sensor: Sensor, plant: Plant, latency: int, walls: Sequence[str], settings: Settings | None = None
    ) -> None:
        chosen = settings or self.Settings()
        with checks.within("sensor.estimator", "."):  # only the model's settings can be invalid here
            predictor = ModelPredictor(sensor, plant, walls, chosen.model, chosen.delivered)
        super().__init__(sensor, predictor, latency, chosen, chosen.model_error)
