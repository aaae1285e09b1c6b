"""Path errors at half the top speed: ``python -m studies.benchmarks.following [--worlds 20] [--policy pose]``.

Errors are distances from the moving goal at the ends of steps. Worlds have different headings and, on the prototype, different
elements. Output over the worlds: median and maximum of an episode's rms error (of its worst part), largest error, largest
heading error, smallest distance between parts, and share of the episodes within the task's tolerances.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

import vibgym
from agents.evaluation.table import quantity
from studies import common
from studies.common import HARDWARE
from studies.kept import show
from vibgym.policies.registry import make_policy
from vibgym.policies.rollout import Episodes, worlds_of
from vibgym.policies.task_info import TaskInfo

CIRCLE = {"shape": "circle", "centre_mm": [416, 104], "radius_mm": 60}
SQUARE = {"shape": "square", "centre_mm": [416, 104], "side_mm": 120}
THREE = [
    {"shape": "circle", "centre_mm": [110, 104], "radius_mm": 60},
    {"shape": "square", "centre_mm": [416, 104], "side_mm": 120},
    {"shape": "figure_eight", "centre_mm": [680, 104], "radius_mm": 36},
]
CLOSE = [{"shape": "circle", "centre_mm": [x, 104], "radius_mm": 60} for x in (316, 416, 516)]
"""Paths that cross, followed in phase with 100 mm between centres: parts are more than 36.8 mm apart, as their circumscribed
circles have a radius of 31 mm."""

PATHS: dict[str, list[dict[str, Any]]] = {
    "circle": [CIRCLE],
    "square": [SQUARE],
    "circle, along": [{**CIRCLE, "heading": "along"}],
    "three parts": THREE,
    "three parts side by side": CLOSE,
}


class Followed(NamedTuple):
    """An episode per world; nan after its end."""

    errors: np.ndarray  # (steps, worlds, parts, 3) m, m, rad, at the ends of steps
    gap: np.ndarray  # (steps, worlds) m, smallest distance between parts; undefined for one part


def follow(policy: Any, paths: list[dict[str, Any]], worlds: int, **environment: Any) -> Followed:
    """Run an episode of ``policy`` in each of ``worlds`` worlds with these paths."""
    arguments = {"paths": paths, "parts": ["aluminium_block"] * len(paths), **environment}
    env: Any = worlds_of("Follow", worlds, action="phasor", **arguments)
    errors, gaps = [], []
    for step in Episodes(make_policy(policy, TaskInfo.of(env)), env, range(worlds)):
        truth = env.unwrapped.truth
        errors.append(np.where(step.playing[:, None, None], truth.error, np.nan))
        gaps.append(np.where(step.playing, truth.gap.min(axis=1), np.nan))
    env.close()
    return Followed(np.array(errors), np.array(gaps))


HEADS = (
    "hardware", "paths", "rms: median (largest)", "largest error", "largest heading error", "smallest distance",
    "within tolerances",
)  # fmt: skip


def line(followed: Followed, tolerance: tuple[float, float]) -> list[str]:
    """Return the cells of a row."""
    errors = followed.errors
    away, turned = np.hypot(errors[..., 0], errors[..., 1]), np.abs(errors[..., 2])
    rms = np.sqrt(np.nanmean(away**2, axis=0)).max(axis=-1)
    kept = (np.nanmax(away, axis=(0, 2)) <= tolerance[0]) & (np.nanmax(turned, axis=(0, 2)) <= tolerance[1])
    return [
        f"{1e3 * np.median(rms):.3f} ({1e3 * rms.max():.3f}) mm",
        quantity(np.nanmax(away), 1e3, 2, "mm"),
        quantity(np.degrees(np.nanmax(turned)), 1.0, 2, "deg"),
        quantity(np.nanmin(followed.gap) if errors.shape[2] > 1 else np.nan, 1e3, 1, "mm"),
        quantity(kept.mean(), 100.0, 1, "%"),
    ]


def main() -> None:
    """Evaluate and print."""
    parser = common.parser(__doc__)
    parser.add_argument("--worlds", type=int, default=20)
    parser.add_argument("--policy", type=common.policy, default="pose", help="name or JSON")
    parser.add_argument("--hardware", nargs="*", default=list(HARDWARE), choices=list(HARDWARE))
    parser.add_argument("--paths", nargs="*", default=list(PATHS), choices=list(PATHS))
    arguments = parser.parse_args()
    tolerance = vibgym.tasks.Follow.position_tolerance, vibgym.tasks.Follow.heading_tolerance
    lines = []
    for hardware in arguments.hardware:
        for name in arguments.paths:
            followed = follow(arguments.policy, PATHS[name], arguments.worlds, **HARDWARE[hardware])
            lines.append([hardware, name, *line(followed, tolerance)])
    show("following", HEADS, lines, arguments.keep)


if __name__ == "__main__":
    main()
