"""One method against another at equal error, and the cheapest setting for a tolerance."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from studies.accuracy import errors
from studies.accuracy.ladder import Row, SceneResult

SAMPLING, SCIPY, MUJOCO = "point sampling", ("SciPy LSODA", "SciPy DOP853"), "MuJoCo"
AVERAGED = ("averaged, order 1", "averaged, order 2")
STRONG_LEVEL = 5e-5  # m
WEAK_LEVEL, STEADY_LEVEL = 0.02, 1e-3


class Comparison(NamedTuple):
    """``fast`` against ``slow`` on a scene, at one error.

    Attributes:
        weak: whether the error is the mean velocity's (relative) or the trajectory's (m).
        error: at which both are compared.
        fast_cost, slow_cost: us per period, world and core; None where the method does not reach the error.
        note: the smallest errors of methods that do not reach it, or "".
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
        """Cost of ``slow`` over that of ``fast``."""
        if self.fast_cost is None or self.slow_cost is None:
            return None
        return self.slow_cost / self.fast_cost


def at_error(result: SceneResult, fast: str, slow: str, error: float, weak: bool) -> Comparison | None:
    """Return both methods where they reach ``error``; None if one of them has no usable setting."""
    curves = [result.curve(method, weak) for method in (fast, slow)]
    if not all(rows for rows, _, _ in curves):
        return None
    found = [errors.cost_at(costs, values, error) for _, costs, values in curves]
    short = [
        _reaches(method, min(values), weak)
        for method, (_, _, values), cost in zip((fast, slow), curves, found, strict=True)
        if cost is None
    ]
    return Comparison(result.scene.name, fast, slow, weak, error, found[0], found[1], "; ".join(short))


def at_its_errors(result: SceneResult, fast: str, slow: str) -> list[Comparison]:
    """Compare at the strong error of each setting of the slow method, over the worlds that it ran."""
    ours, costs, _ = result.curve(fast)
    found = []
    for row in result.curve(slow)[0]:
        mine = [errors.spread(each.strong_each[: row.worlds]).median for each in ours]
        if not mine or not math.isfinite(row.strong.median):
            continue
        cost = errors.cost_at(costs, mine, row.strong.median)
        note = "" if cost is not None else _reaches(fast, min(mine), False)
        found.append(Comparison(result.scene.name, fast, slow, False, row.strong.median, cost, row.cost, note))
    return found


def _reaches(method: str, value: float, weak: bool) -> str:
    return f"{method} gets to " + (f"{100 * value:.2g} %" if weak else f"{1e3 * value:.2g} mm")


class Headline(NamedTuple):
    """A published ratio.

    Attributes:
        question: as text.
        wanted: required smallest ratio, or None.
        found: one comparison per scene (the one with the smallest ratio, where there are several).
        missing: scenes without a comparison, and why.
    """

    question: str
    wanted: float | None
    found: tuple[Comparison, ...]
    missing: tuple[str, ...]

    @property
    def ratios(self) -> list[float]:
        """Ratios of the scenes where both methods reach the error."""
        return [each.ratio for each in self.found if each.ratio is not None]

    @property
    def passed(self) -> bool | None:
        """Whether every ratio is large enough; None without a ratio or a target."""
        if self.wanted is None or not self.ratios:
            return None
        return min(self.ratios) >= self.wanted


def headlines(results: list[SceneResult]) -> list[Headline]:
    """Return all published ratios."""
    moving = [each for each in results if each.scene.slides]

    def fixed(fast: str, slow: str, error: float, weak: bool) -> Callable[[SceneResult], Comparison | None]:
        return lambda result: at_error(result, fast, slow, error, weak)

    def smallest(slow: str, best: bool = False) -> Callable[[SceneResult], Comparison | None]:
        """Return the smallest ratio at the errors of all settings of the slow method, or at its smallest error."""

        def compare(result: SceneResult) -> Comparison | None:
            each = at_its_errors(result, "planar", slow)
            if best and each:
                each = [min(each, key=lambda one: one.error)]
            good = [one for one in each if one.ratio is not None]
            return min(good, key=lambda one: one.ratio or math.inf) if good else each[0] if each else None

        return compare

    strong, steady = (fixed("planar", SAMPLING, *level) for level in ((STRONG_LEVEL, False), (STEADY_LEVEL, True)))
    rows = [
        ("planar against point sampling at 0.05 mm", 4.0, moving, SAMPLING, strong),
        ("planar against point sampling at 0.1 % of the mean velocity", 4.0, moving, SAMPLING, steady),
    ]
    rows += [(f"planar against {peer} at that one's errors", 100.0, results, peer, smallest(peer)) for peer in SCIPY]
    question = "planar against MuJoCo at the smallest error it reaches"
    rows += [(question, 200.0, results, MUJOCO, smallest(MUJOCO, best=True))]
    for method in AVERAGED:
        question = f"{method} against planar at 2 % of the mean velocity"
        rows += [(question, None, moving, method, fixed(method, "planar", WEAK_LEVEL, True))]
    return [_headline(*each) for each in rows]


def _headline(
    question: str,
    wanted: float | None,
    results: list[SceneResult],
    method: str,
    compare: Callable[[SceneResult], Comparison | None],
) -> Headline:
    found, missing = [], []
    for result in results:
        one = compare(result)
        if one is None:
            missing.append(f"{result.scene.name}: {why_missing(result, method)}")
        else:
            found.append(one)
    return Headline(question, wanted, tuple(found), tuple(missing))


def why_missing(result: SceneResult, method: str) -> str:
    """Return why a method has no curve on a scene."""
    rows = [row for row in result.rows if row.candidate.method == method]
    refused = [row.refused for row in rows if row.refused]
    return refused[0] if refused else "every setting fails in some world" if rows else "not requested"


class Choice(NamedTuple):
    """The cheapest settings for one tolerance on one scene: ``row`` of all models, and by method (None: none)."""

    weak: bool
    tolerance: float
    row: Row | None
    by_method: dict[str, Row | None]


def choices(result: SceneResult) -> list[Choice]:
    """Return the choice for every tolerance of the scene."""
    scene = result.scene
    return [choice(result, False, each) for each in scene.strong_tolerances] + [
        choice(result, True, each) for each in scene.weak_tolerances
    ]


def choice(result: SceneResult, weak: bool, tolerance: float) -> Choice:
    """Return the choice for one tolerance, of the trajectory (m) or the mean velocity (relative)."""
    by_method: dict[str, Row | None] = {}
    for method in result.methods:
        rows, costs, values = result.curve(method, weak)
        best = errors.cheapest(costs, values, tolerance)
        by_method[method] = None if best is None else rows[best]
    ours = [row for row in by_method.values() if row is not None and not row.candidate.peer]
    return Choice(weak, tolerance, min(ours, key=lambda each: each.cost) if ours else None, by_method)


def front(result: SceneResult, weak: bool) -> list[Row]:
    """Return the Pareto front over all methods, peers included, cheapest first."""
    rows = [row for row in result.rows if row.usable]
    values = [row.weak if weak else row.strong.median for row in rows]
    return [rows[k] for k in errors.pareto([row.cost for row in rows], values)]
