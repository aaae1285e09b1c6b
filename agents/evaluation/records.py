"""What is kept of episodes: a line for each, and a row of statistics of some."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from agents.evaluation.resampling import Interval
from agents.evaluation.statistics import quartiles, success_interval
from agents.evaluation.tables import colour, quantity
from vibgym.policies.rollout import OWN_FACTS, Outcomes


class Trial(NamedTuple):
    """What is run and judged in one piece."""

    task: str
    hardware: str
    policy: str


class Row(SimpleNamespace):
    """Statistics of some episodes by name, in the order of a file's columns: a row of a table, or a cell of a study."""

    @property
    def percent(self) -> str:
        """Success rate as tables write it, without its sign."""
        return f"{100 * self.success_rate:.1f}"

    def percent_between(self, joint: str = " to ") -> str:
        """Its interval."""
        return f"{100 * self.success_low:.1f}{joint}{100 * self.success_high:.1f}"

    def shaded(self, median_time: float) -> dict[str, str]:
        """What a cell of a study shows, in a colour that goes by the success rate."""
        return {
            "success": f"{self.percent} %",
            "interval": self.percent_between(" – "),
            "method": self.success_interval_method,
            "time": quantity(median_time, 1.0, 2, "s"),
            "colour": colour(self.success_rate),
        }


def successes(success: np.ndarray, level: float, resamples: int) -> dict[str, Any]:
    """The columns on success, which is (episodes,) or (runs, episodes) bool: counts, rate and its interval."""
    interval = success_interval(success, level, resamples)
    return {
        "episodes": success.shape[-1],
        "successes": int(success.sum()),
        "success_rate": float(success.mean()),
        **ends("success", interval),
        "success_interval_method": interval.method,
    }


def ends(name: str, interval: Interval | None, unit: str = "") -> dict[str, float]:
    """The columns on an interval's ends; nan without one."""
    low, high = (math.nan, math.nan) if interval is None else (interval.low, interval.high)
    return {f"{name}_low{unit}": low, f"{name}_high{unit}": high}


def spread(name: str, values: np.ndarray, unit: str = "") -> dict[str, float]:
    """The columns on quartiles of the finite values."""
    found = quartiles(values)
    return {f"{name}_{which}{unit}": value for which, value in zip(("q25", "median", "q75"), found, strict=True)}


ENDS = {
    "seed": "seeds",
    "success": "success",
    "steps": "steps",
    "time_to_goal_s": "time_to_goal",
    "position_error_m": "position_error",
    "heading_error_rad": "heading_error",
    "fallen": "fallen",
}
"""Column -> what it holds of episodes of which the ends are kept."""

OWN = {
    "transit_s": "transit",
    "pattern_error_m": "pattern_error",
    **{name: name for name in OWN_FACTS if name not in ("transit", "pattern_error")},
}
"""The same of what some tasks alone say at the end."""

ALL = {
    "seed": "seeds",
    "success": "success",
    "steps": "steps",
    "time_to_goal_s": "time_to_goal",
    "bound_s": "bound",
    "time_over_bound": "time_over_bound",
    "position_error_m": "position_error",
    "heading_error_rad": "heading_error",
    "path_error_m": "path_error",
    "fallen": "fallen",
    "diverged": "diverged",
    "return": "returns",
    "path_length_m": "path_length",
    "path_efficiency": "path_efficiency",
    "parts_done": "parts_done",
    "throughput_parts_per_s": "throughput",
    "collisions": "collisions",
    "clearance_m": "clearance",
    "rate_over_bound": "rate_over_bound",
    **OWN,
}
"""The same of episodes of which all is kept: the columns of episodes.csv."""

COUNTS = ("parts_done", "collisions")


def of_episodes(found: Outcomes, what: str) -> np.ndarray:
    """(episodes,) what is kept of each, or what tasks say at the end."""
    return found.fact(what) if what in OWN_FACTS else np.asarray(getattr(found, what))


def episodes_of(found: Outcomes, columns: dict[str, str] = ENDS, **head: Any) -> list[dict[str, Any]]:
    """One mapping per episode, each with ``head`` first."""
    values = {name: of_episodes(found, what).tolist() for name, what in columns.items()}
    for name in COUNTS:
        if name in values:
            values[name] = [int(value) if math.isfinite(value) else value for value in values[name]]
    return [{**head, **dict(zip(values, each, strict=True))} for each in zip(*values.values(), strict=True)]
