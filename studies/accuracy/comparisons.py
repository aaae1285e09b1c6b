"""One method against another at equal error, and the cheapest setting for a tolerance."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from studies.accuracy import errors
from studies.accuracy.ladder import SceneResult

SAMPLING, SCIPY, MUJOCO = "point sampling", ("SciPy LSODA", "SciPy DOP853"), "MuJoCo"
AVERAGED = ("averaged, order 1", "averaged, order 2")
STRONG_LEVEL = 5e-5  # m
WEAK_LEVEL, STEADY_LEVEL = 0.02, 1e-3


class Comparison(NamedTuple):
    """``fast`` against ``slow`` on a scene, at one error."""

    scene: str
    fast: str
    slow: str
    weak: bool  # whether the error is the mean velocity's (relative) or the trajectory's (m)
    error: float  # at which both are compared
    fast_cost: float | None  # us per period, world and core; None where the method does not reach the error
    slow_cost: float | None
    note: str = ""  # the smallest errors of methods that do not reach it

    @property
    def ratio(self) -> float | None:
        """Cost of ``slow`` over that of ``fast``."""
        if self.fast_cost is None or self.slow_cost is None:
            return None
        return self.slow_cost / self.fast_cost


def _cost_at(curve: Any, error: float) -> float | None:
    return errors.cost_at(curve["cost_us"].tolist(), curve["error"].tolist(), error)


def at_error(result: SceneResult, fast: str, slow: str, error: float, weak: bool) -> Comparison | None:
    """Return both methods where they reach ``error``; None if one of them has no usable setting."""
    curves = {method: result.curve(method, weak) for method in (fast, slow)}
    if any(curve.empty for curve in curves.values()):
        return None
    costs = {method: _cost_at(curve, error) for method, curve in curves.items()}
    short = [_reaches(name, curves[name]["error"].min(), weak) for name, cost in costs.items() if cost is None]
    return Comparison(result.scene.name, fast, slow, weak, error, costs[fast], costs[slow], "; ".join(short))


def at_its_errors(result: SceneResult, fast: str, slow: str) -> list[Comparison]:
    """Compare at the strong error of each setting of the slow method, over the worlds that it ran."""
    ours, comparisons = result.curve(fast), []
    for row in result.curve(slow).itertuples():
        mine = ours.assign(error=[errors.spread(strong[: row.worlds]).median for strong in ours["strong_each"]])
        if mine.empty or not math.isfinite(row.error):
            continue
        cost = _cost_at(mine, row.error)
        note = "" if cost is not None else _reaches(fast, mine["error"].min(), False)
        comparisons.append(Comparison(result.scene.name, fast, slow, False, row.error, cost, row.cost_us, note))
    return comparisons


def _reaches(method: str, value: float, weak: bool) -> str:
    return f"{method} gets to " + (f"{100 * value:.2g} %" if weak else f"{1e3 * value:.2g} mm")


class Headline(NamedTuple):
    """A published ratio."""

    question: str
    wanted: float | None  # required smallest ratio
    comparisons: tuple[Comparison, ...]  # one per scene (the one with the smallest ratio, where there are several)
    missing: tuple[str, ...]  # scenes without a comparison, and why

    @property
    def ratios(self) -> list[float]:
        """Ratios of the scenes where both methods reach the error."""
        return [comparison.ratio for comparison in self.comparisons if comparison.ratio is not None]

    @property
    def passed(self) -> bool | None:
        """Whether every ratio is large enough; None without a ratio or a target."""
        if self.wanted is None or not self.ratios:
            return None
        return min(self.ratios) >= self.wanted


Compare = Callable[[SceneResult], Comparison | None]


def headlines(results: list[SceneResult]) -> list[Headline]:
    """Return all published ratios."""
    moving = [result for result in results if result.scene.slides]

    def at(fast: str, slow: str, error: float, weak: bool) -> Compare:
        return lambda result: at_error(result, fast, slow, error, weak)

    def smallest(slow: str, best: bool = False) -> Compare:
        """Return the smallest ratio at the errors of all settings of the slow method, or at its smallest error."""

        def compare(result: SceneResult) -> Comparison | None:
            some = at_its_errors(result, "planar", slow)
            if best and some:
                some = [min(some, key=lambda one: one.error)]
            good = [one for one in some if one.ratio is not None]
            return min(good, key=lambda one: one.ratio or math.inf) if good else some[0] if some else None

        return compare

    def headline(
        question: str, wanted: float | None, results: list[SceneResult], method: str, compare: Compare
    ) -> Headline:
        pairs = [(result, compare(result)) for result in results]
        missing = [f"{result.scene.name}: {why_missing(result, method)}" for result, one in pairs if one is None]
        return Headline(question, wanted, tuple(one for _, one in pairs if one is not None), tuple(missing))

    strong, steady = (at("planar", SAMPLING, *level) for level in ((STRONG_LEVEL, False), (STEADY_LEVEL, True)))
    return [
        headline("planar against point sampling at 0.05 mm", 4.0, moving, SAMPLING, strong),
        headline("planar against point sampling at 0.1 % of the mean velocity", 4.0, moving, SAMPLING, steady),
        *(
            headline(f"planar against {peer} at that one's errors", 100.0, results, peer, smallest(peer))
            for peer in SCIPY
        ),
        headline(
            "planar against MuJoCo at the smallest error it reaches", 200.0, results, MUJOCO, smallest(MUJOCO, best=True)
        ),
        *(
            headline(
                f"{method} against planar at 2 % of the mean velocity", None, moving, method,
                at(method, "planar", WEAK_LEVEL, True),
            )
            for method in AVERAGED
        ),
    ]  # fmt: skip


def why_missing(result: SceneResult, method: str) -> str:
    """Return why a method has no curve on a scene."""
    refused = result.table["refused"][result.table["method"] == method]
    reasons = [reason for reason in refused if reason]
    return reasons[0] if reasons else "every setting fails in some world" if len(refused) else "not requested"


class Choice(NamedTuple):
    """The cheapest settings for one tolerance on one scene: ``row`` of all models, and by method (None: none)."""

    weak: bool
    tolerance: float
    row: Any
    by_method: dict[str, Any]


def choices(result: SceneResult) -> list[Choice]:
    """Return the choice for every tolerance of the scene."""
    scene = result.scene
    return [choice(result, False, tolerance) for tolerance in scene.strong_tolerances] + [
        choice(result, True, tolerance) for tolerance in scene.weak_tolerances
    ]


def choice(result: SceneResult, weak: bool, tolerance: float) -> Choice:
    """Return the choice for one tolerance, of the trajectory (m) or the mean velocity (relative)."""
    by_method: dict[str, Any] = {}
    for method in result.methods:
        curve = result.curve(method, weak)
        best = errors.cheapest(curve["cost_us"].tolist(), curve["error"].tolist(), tolerance)
        by_method[method] = None if best is None else list(curve.itertuples())[best]
    ours = [row for row in by_method.values() if row is not None and not row.peer]
    return Choice(weak, tolerance, min(ours, key=lambda row: row.cost_us) if ours else None, by_method)
