"""Gauss-Newton steps for a recording: many initial states, some shared parameters, and elements with a normal prior.

Each segment has an initial state of its own, which is eliminated by a QR decomposition of its block; what is left is one dense
system in the shared parameters and the elements' errors. ``scipy.optimize.least_squares`` would decompose a Jacobian of some
10000 rows and 1000 columns instead. Gain and phase errors of elements are normal with unknown standard deviations, which are
estimated with them (empirical Bayes by expectation maximization).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from vibgym.identification.plant import LOCAL, Derivatives, Parameters, Plant

RIDGE = 1e-3
"""Bounds steps of an initial state, to about 1000 times :data:`STATE_SCALE`, where images do not determine it (discs)."""

HALVINGS = 5
"""Times that a step is halved until the cost decreases."""

MAXIMIZATIONS = 5
"""Steps of expectation maximization for each linearization."""

MIN_SPREAD = 1e-3
"""Smallest standard deviation of the elements' errors."""

STATE_SCALE = np.array([1e-3, 1e-3, 1e-2, 0.1, 0.1, 1.0])
"""Size of changes of an initial state."""


@dataclass(frozen=True)
class Prior:
    """Weak normal prior: of the shared parameters, and of the elements.

    Attributes:
        mean, deviation: of :meth:`Parameters.vector`.
        spread: (2,) standard deviations of the elements' gain errors (not relative to the common gain) and phase errors (rad).
    """

    mean: np.ndarray
    deviation: np.ndarray
    spread: np.ndarray


@dataclass(frozen=True)
class Estimate:
    """Parameters, initial states (segments, LOCAL), noise (2,) of positions (m) and headings (rad), and the prior."""

    parameters: Parameters
    starts: np.ndarray
    noise: np.ndarray
    prior: Prior


class System(NamedTuple):
    """Linearized problem after elimination of the initial states, without priors.

    Attributes:
        which: segments.
        matrix, right: normal equations in shared parameters and elements (rows, columns, 2), flat.
        blocks: for each segment Q, R of its initial state, and its weighted matrix of the shared and element columns.
        columns: for each segment the indices of these columns.
        residuals: for each segment (n, 3), not weighted.
        derivatives: for each segment, from which the others follow.
    """

    which: Sequence[int]
    matrix: np.ndarray
    right: np.ndarray
    blocks: list[tuple[np.ndarray, np.ndarray, np.ndarray]]
    columns: list[np.ndarray]
    residuals: list[np.ndarray]
    derivatives: list[Derivatives]


class Progress(NamedTuple):
    """Result of a step.

    Attributes:
        estimate: after the step.
        before, after: cost.
        moved: largest change of a shared parameter by the whole step, over its standard deviation.
        free: degrees of freedom of the residuals, see :meth:`Solver.freedom`.
        residuals: for each segment (n, 3), after the step.
        derivatives: that the step has used.
    """

    estimate: Estimate
    before: float
    after: float
    moved: float
    free: np.ndarray
    residuals: list[np.ndarray]
    derivatives: list[Derivatives]


class Solver:
    """Fits a plant to its segments.

    Args:
        plant: of the recording.
        headings: (kinds,) whether the heading of a kind is measured (not of discs).
    """

    def __init__(self, plant: Plant, headings: Sequence[bool]) -> None:
        self.plant, self._headings = plant, headings
        self._width = plant.surface.columns
        self._elements = 2 * plant.surface.rows * plant.surface.columns

    def weights(self, segment: int, noise: np.ndarray) -> np.ndarray:
        """Return (3,) reciprocal standard deviations of a segment's measurements."""
        seen = self._headings[self.plant.segments[segment].kind]
        return np.array([1.0 / noise[0], 1.0 / noise[0], 1.0 / noise[1] if seen else 0.0])

    def linearize(
        self, which: Sequence[int], now: Estimate, elements: bool, derivatives: list[Derivatives] | None = None
    ) -> System:
        """Return the linearized problem at an estimate, with given derivatives or new ones."""
        slopes = derivatives
        if slopes is None:
            slopes = self.plant.differentiate(which, now.parameters, now.starts, elements=elements)
        shared = len(now.prior.mean)
        size = shared + self._elements
        matrix, right = np.zeros((size, size)), np.zeros(size)
        blocks, columns, residuals = [], [], self.residuals(which, now)
        for segment, slope, residual in zip(which, slopes, residuals, strict=True):
            weights = self.weights(segment, now.noise)
            own = self._columns(segment, shared, elements)
            block = np.concatenate([slope.shared, slope.elements.reshape(*residual.shape, -1)], axis=2)
            block = (block * weights[:, None]).reshape(residual.size, -1)
            q, r = _orthogonal(slope, weights)
            left, rest = (_rest(q, values) for values in (block, (residual * weights).reshape(-1, 1)))
            matrix[np.ix_(own, own)] += left.T @ left
            right[own] += left.T @ rest[:, 0]
            blocks.append((q, r, block))
            columns.append(own)
        return System(which, matrix, right, blocks, columns, residuals, slopes)

    def _columns(self, segment: int, shared: int, elements: bool) -> np.ndarray:
        """Return the indices of a segment's columns in the dense system."""
        if not elements:
            return np.arange(shared)
        row, column = self.plant.segments[segment].elements.T
        first = shared + 2 * (row * self._width + column)
        return np.concatenate([np.arange(shared), np.column_stack([first, first + 1]).ravel()])

    def posterior(self, system: System, now: Estimate, fixed: Sequence[int] = ()) -> tuple[np.ndarray, np.ndarray]:
        """Return step and covariance of the dense unknowns with the prior; unknowns ``fixed`` do not change."""
        precision, gradient = self._prior_terms(now)
        matrix = system.matrix + np.diag(precision)
        free = np.delete(np.arange(len(matrix)), fixed)
        covariance, step = np.zeros_like(matrix), np.zeros(len(matrix))
        covariance[np.ix_(free, free)] = inverse = np.linalg.inv(matrix[np.ix_(free, free)])
        step[free] = inverse @ (system.right + gradient)[free]
        return step, covariance

    def freedom(self, system: System, covariance: np.ndarray) -> np.ndarray:
        """Return degrees of freedom (2,) of the residuals of positions and of headings, at least 1.

        They are numbers of measurements less the traces of the hat matrix's blocks. If the priors hold, the expected sum of
        squared residuals is the variance times this. Positions and headings are fitted by different shares of the unknowns.
        """
        free = np.zeros(3)
        for segment, (q, _, block), own in zip(system.which, system.blocks, system.columns, strict=True):
            top, left = q[: len(block)], _rest(q, block)[: len(block)]
            lever = (top**2).sum(axis=1) + ((left @ covariance[np.ix_(own, own)]) * left).sum(axis=1)
            free += np.sign(self.weights(segment, np.ones(2))) * (1.0 - lever.reshape(-1, 3)).sum(axis=0)
        return np.maximum([free[0] + free[1], free[2]], 1.0)

    def _prior_terms(self, now: Estimate) -> tuple[np.ndarray, np.ndarray]:
        """Return precisions of the prior, and its gradient at the estimate."""
        spread = np.tile(now.prior.spread, self._elements // 2)
        precision = np.concatenate([now.prior.deviation, spread]) ** -2.0
        away = np.concatenate([now.prior.mean - now.parameters.vector(), -now.parameters.elements.ravel()])
        return precision, precision * away

    def cost(self, residuals: Sequence[np.ndarray], which: Sequence[int], now: Estimate, elements: bool) -> float:
        """Return the sum of weighted squares of residuals and prior."""
        weighted = (residual * self.weights(k, now.noise) for k, residual in zip(which, residuals, strict=True))
        total = sum(float((residual**2).sum()) for residual in weighted)
        total += float((((now.parameters.vector() - now.prior.mean) / now.prior.deviation) ** 2).sum())
        return total + (float(((now.parameters.elements / now.prior.spread) ** 2).sum()) if elements else 0.0)

    def residuals(self, which: Sequence[int], now: Estimate) -> list[np.ndarray]:
        """Return residuals (n, 3) of segments, measured less predicted."""
        predicted = self.plant.predict(which, now.parameters, now.starts)
        return [self.plant.segments[k].pose - pose for k, pose in zip(which, predicted, strict=True)]

    def step(
        self,
        which: Sequence[int],
        now: Estimate,
        *,
        elements: bool,
        fixed: Sequence[int] = (),
        spreads: bool = False,
        derivatives: list[Derivatives] | None = None,
    ) -> Progress:
        """Return the estimate after a Gauss-Newton step.

        Args:
            which: segments to use.
            elements: whether to estimate the elements' errors.
            fixed: indices of shared parameters that do not change.
            spreads: whether to estimate the standard deviations of the elements' errors.
            derivatives: of an earlier step nearby; None: new ones.
        """
        system = self.linearize(which, now, elements, derivatives)
        if spreads:
            now = self.with_spreads(system, now, fixed)
        before = self.cost(system.residuals, which, now, elements)
        step, covariance = self.posterior(system, now, fixed)
        shared, share = len(now.prior.mean), 1.0
        free = self.freedom(system, covariance)
        deviation = np.sqrt(np.diag(covariance)[:shared])
        known = deviation > 0.0
        moved = float((np.abs(step[:shared][known]) / deviation[known]).max(initial=0.0))
        vector, errors = now.parameters.vector(), now.parameters.elements
        moves = []
        parts = zip(which, system.blocks, system.columns, system.residuals, strict=True)
        for segment, (q, r, block), own, residual in parts:
            rest = (residual * self.weights(segment, now.noise)).ravel() - block @ step[own]
            padded = np.concatenate([rest, np.zeros(LOCAL)])
            moves.append(STATE_SCALE * np.linalg.solve(r, q.T @ padded))
        for _ in range(HALVINGS):
            starts = now.starts.copy()
            starts[list(which)] += share * np.array(moves)
            own_errors = errors + share * step[shared:].reshape(errors.shape)
            changed = now.parameters.changed(vector + share * step[:shared], own_errors)
            after = replace(now, parameters=changed, starts=starts)
            residuals = self.residuals(which, after)
            cost = self.cost(residuals, which, after, elements)
            if cost < before:
                return Progress(after, before, cost, moved, free, residuals, system.derivatives)
            share *= 0.5
        return Progress(now, before, before, moved, free, system.residuals, system.derivatives)

    def with_spreads(self, system: System, now: Estimate, fixed: Sequence[int] = ()) -> Estimate:
        """Return the estimate with standard deviations of the elements' errors, estimated on visited elements."""
        shared, visited = len(now.prior.mean), np.diag(system.matrix)[len(now.prior.mean) :] > 0.0
        if not visited.any():
            return now
        for _ in range(MAXIMIZATIONS):
            step, covariance = self.posterior(system, now, fixed)
            errors = now.parameters.elements.ravel() + step[shared:]
            square = errors**2 + np.diag(covariance)[shared:]
            spread = [np.sqrt(square[k::2][visited[k::2]].mean()) for k in range(2)]
            now = replace(now, prior=replace(now.prior, spread=np.maximum(spread, MIN_SPREAD)))
        return now

    def with_noise(
        self, which: Sequence[int], now: Estimate, residuals: Sequence[np.ndarray], free: np.ndarray | None = None
    ) -> Estimate:
        """Return the estimate with the noise of its residuals, of ``free`` (2,) degrees of freedom; None: their number."""
        square, count = np.zeros(3), np.zeros(3)
        for segment, residual in zip(which, residuals, strict=True):
            seen = np.sign(self.weights(segment, now.noise))
            square, count = square + seen * (residual**2).sum(axis=0), count + seen * len(residual)
        square, count = (np.array([sums[0] + sums[1], sums[2]]) for sums in (square, count))
        noise = np.sqrt(square / np.maximum(count if free is None else free, 1.0))
        return replace(now, noise=np.where(noise > 0.0, np.maximum(noise, 1e-9), now.noise))

    def scan(
        self, now: Estimate, system: System, predicted: Sequence[np.ndarray], fixed: Sequence[int]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return products (m, m) of what all unknowns but ``fixed`` ones, fitted linearly, leave of m hypotheses' residuals.

        Their diagonal is the least cost of each hypothesis. Also return the gradients (unknowns, m).

        Args:
            predicted: for each segment (m, n, 3) by each hypothesis.
        """
        _, covariance = self.posterior(system, now, fixed)
        _, gradient = self._prior_terms(now)
        count = len(predicted[0])
        rights, squares = np.zeros((len(gradient), count)), np.zeros((count, count))
        parts = zip(system.which, predicted, system.blocks, system.columns, strict=True)
        for segment, pose, (q, _, block), own in parts:
            residual = (self.plant.segments[segment].pose - pose) * self.weights(segment, now.noise)
            left, rest = _rest(q, block), _rest(q, residual.reshape(count, -1).T)
            rights[own] += left.T @ rest
            squares += rest.T @ rest
        rights += gradient[:, None]
        rights[list(fixed)] = 0.0
        return squares - rights.T @ covariance @ rights, rights


def _orthogonal(derivatives: Derivatives, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return Q and R of the columns of a segment's initial state, with a ridge."""
    local = (derivatives.local * weights[:, None]).reshape(-1, LOCAL) * STATE_SCALE
    return np.linalg.qr(np.concatenate([local, RIDGE * np.eye(LOCAL)]))


def _rest(q: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the parts of columns that the initial state cannot explain."""
    padded = np.concatenate([values, np.zeros((LOCAL, values.shape[1]))])
    return padded - q @ (q.T @ padded)
