"""One method against another at equal error, and the cheapest setting for a tolerance."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from studies.accuracy import errors
from studies.accuracy.ladder import Row, SceneResult, drift

SAMPLING, SCIPY, MUJOCO = "point sampling", ("SciPy LSODA", "SciPy DOP853"), "MuJoCo"
AVERAGED = ("averaged, order 1", "averaged, order 2")
STRONG_LEVEL = 5e-5  # m
WEAK_LEVEL, STEADY_LEVEL = 0.02, 1e-3


@dataclass(frozen=True)
class Comparison:
    """``fast`` against ``slow`` on a scene, at one error.

    Attributes:
        weak: whether the error is the mean velocity's (relative) or the trajectory's (m).
        error: at which both are taken.
        fast_cost, slow_cost: us per period, world and core; None where the method does not get there.
        note: what that means in words, or "".
    """

    scene: str
    fast: str
    slow: str
    weak: bool
    error: float
    fast_cost: float | None
    slow_cost: float | None
    note: str = ""

    @property
    def ratio(self) -> float | None:
        """How many times cheaper the first one is."""
        if self.fast_cost is None or self.slow_cost is None:
            return None
        return self.slow_cost / self.fast_cost


def at_error(result: SceneResult, fast: str, slow: str, error: float, weak: bool) -> Comparison | None:
    """Both methods where they reach ``error``; None if one of them has no usable setting at all."""
    curves = [result.curve(method, weak) for method in (fast, slow)]
    if not all(rows for rows, _, _ in curves):
        return None
    found = [errors.cost_at(costs, values, error) for _, costs, values in curves]
    short = [
        f"{method} gets to {_error(min(values), weak)}"
        for method, (_, _, values), cost in zip((fast, slow), curves, found, strict=True)
        if cost is None
    ]
    return Comparison(result.scene.name, fast, slow, weak, error, found[0], found[1], "; ".join(short))


def at_its_errors(result: SceneResult, fast: str, slow: str) -> list[Comparison]:
    """At the strong error of each setting of the slow method, over the worlds that it ran: the fast one at the same."""
    ours, costs, _ = result.curve(fast)
    found = []
    for row in result.curve(slow)[0]:
        mine = [errors.spread(each.strong_each[: row.worlds]).median for each in ours]
        if not mine or not math.isfinite(row.strong.median):
            continue
        cost = errors.cost_at(costs, mine, row.strong.median)
        note = "" if cost is not None else f"{fast} gets to {_error(min(mine), False)}"
        found.append(Comparison(result.scene.name, fast, slow, False, row.strong.median, cost, row.cost, note))
    return found


def _error(value: float, weak: bool) -> str:
    return f"{100 * value:.2g} %" if weak else f"{1e3 * value:.2g} mm"


@dataclass(frozen=True)
class Headline:
    """A figure that the models are held to.

    Attributes:
        question: in words.
        wanted: least ratio, or None where it is only shown.
        found: one comparison per scene (the one with the smallest ratio, where there are several).
        missing: scenes without a comparison, and why.
    """

    question: str
    wanted: float | None
    found: tuple[Comparison, ...]
    missing: tuple[str, ...]

    @property
    def ratios(self) -> list[float]:
        """Of the scenes where both methods get there."""
        return [each.ratio for each in self.found if each.ratio is not None]

    @property
    def passed(self) -> bool | None:
        """Whether every ratio is what it should be; None if there is nothing to judge."""
        if self.wanted is None or not self.ratios:
            return None
        return min(self.ratios) >= self.wanted


def headlines(results: list[SceneResult]) -> list[Headline]:
    """All of them."""
    moving = [each for each in results if each.scene.slides]
    return [
        _headline("planar against point sampling at 0.05 mm", 4.0, moving, SAMPLING, STRONG_LEVEL, False),
        _headline(
            "planar against point sampling at 0.1 % of the mean velocity", 4.0, moving, SAMPLING, STEADY_LEVEL, True
        ),
        *(_at_theirs(f"planar against {peer} at that one's errors", 100.0, results, peer) for peer in SCIPY),
        _at_theirs("planar against MuJoCo at the smallest error it reaches", 200.0, results, MUJOCO, best=True),
        *(
            Headline(
                f"{method} against planar at 2 % of the mean velocity",
                None,
                *_split(moving, [at_error(each, method, "planar", WEAK_LEVEL, True) for each in moving], method),
            )
            for method in AVERAGED
        ),
    ]


def _headline(
    question: str, wanted: float, results: list[SceneResult], slow: str, error: float, weak: bool
) -> Headline:
    found = [at_error(each, "planar", slow, error, weak) for each in results]
    return Headline(question, wanted, *_split(results, found, slow))


def _at_theirs(question: str, wanted: float, results: list[SceneResult], slow: str, best: bool = False) -> Headline:
    """At the errors of all settings of the slow method, or its smallest one; the smallest ratio of each scene counts."""
    found = []
    for result in results:
        each = at_its_errors(result, "planar", slow)
        if best and each:
            each = [min(each, key=lambda one: one.error)]
        good = [one for one in each if one.ratio is not None]
        found.append(min(good, key=lambda one: one.ratio or math.inf) if good else (each[0] if each else None))
    return Headline(question, wanted, *_split(results, found, slow))


def _split(
    results: list[SceneResult], found: list[Comparison | None], method: str
) -> tuple[tuple[Comparison, ...], tuple[str, ...]]:
    missing = [
        f"{result.scene.name}: {why_missing(result, method)}"
        for result, one in zip(results, found, strict=True)
        if one is None
    ]
    return tuple(one for one in found if one is not None), tuple(missing)


def why_missing(result: SceneResult, method: str) -> str:
    """Why a method has no curve on a scene."""
    rows = [row for row in result.rows if row.candidate.method == method]
    if not rows:
        return "not asked for"
    refused = [row.refused for row in rows if row.refused]
    if refused:
        return refused[0]
    return "every setting fails in some world"


@dataclass(frozen=True)
class Choice:
    """The cheapest settings for one tolerance on one scene: ``row`` of all that are ours, and by method (None: none)."""

    weak: bool
    tolerance: float
    row: Row | None
    by_method: dict[str, Row | None]


def choices(result: SceneResult) -> list[Choice]:
    """For every tolerance of the scene."""
    scene = result.scene
    return [choice(result, False, each) for each in scene.strong_tolerances] + [
        choice(result, True, each) for each in scene.weak_tolerances
    ]


def choice(result: SceneResult, weak: bool, tolerance: float) -> Choice:
    """For one tolerance, of the trajectory (m) or the mean velocity (relative)."""
    by_method: dict[str, Row | None] = {}
    for method in result.methods:
        rows, costs, values = result.curve(method, weak)
        best = errors.cheapest(costs, values, tolerance)
        by_method[method] = None if best is None else rows[best]
    ours = [row for row in by_method.values() if row is not None and not row.candidate.peer]
    return Choice(weak, tolerance, min(ours, key=lambda each: each.cost) if ours else None, by_method)


def front(result: SceneResult, weak: bool) -> list[Row]:
    """The Pareto front over all methods, peers included, cheapest first."""
    rows = [row for row in result.rows if row.usable]
    values = [row.weak if weak else row.strong.median for row in rows]
    return [rows[k] for k in errors.pareto([row.cost for row in rows], values)]


def order_gain(result: SceneResult) -> float | None:
    """Model error of first over second order: mean over worlds of the drift's error; None where a model has no run."""
    found = {each.method: each for each in result.models}
    if not all(method in found for method in AVERAGED):
        return None
    right = drift(result.scene, result.truth)
    first, second = (
        float(np.mean(np.hypot(*(drift(result.scene, found[method].outcome) - right).T))) for method in AVERAGED
    )
    return first / second
