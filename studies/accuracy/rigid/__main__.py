"""Command line: ``python -m studies.accuracy.rigid [STUDY ...]`` measures, stores the figures and prints them as tables."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from studies.accuracy.rigid import fields, housner, motion, releases, stored
from vibgym import files


def rocking(progress: Callable[[str], Any]) -> list[dict[str, Any]]:
    """Housner's block, ever stiffer."""
    found = []
    for slenderness in (3.0, 2.0):
        for sag in (8e-7, 2e-7, 5e-8):
            progress(f"Housner, {slenderness:g}, sag {sag:g} m")
            share = housner.measured(slenderness, sag)
            found.append(
                {
                    "slenderness": slenderness,
                    "sag_um": 1e6 * sag,
                    "left": share,
                    "wanted": housner.expected(slenderness),
                }
            )
    return found


STUDIES: dict[str, Callable[[Callable[[str], Any]], list[dict[str, Any]]]] = {
    "housner": rocking,
    "uniform": fields.uniform,
    "random_fields": fields.random_fields,
    "blocks": releases.blocks,
    "slender": releases.slender,
}


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Rows as Markdown."""
    lines = ["| " + " | ".join(rows[0]) + " |", "|---" * len(rows[0]) + "|"]
    lines += ["| " + " | ".join(_cell(value) for value in row.values()) + " |" for row in rows]
    return "\n".join(lines)


def _cell(value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(_cell(each) for each in value)
    return f"{value:.4g}" if isinstance(value, float) else "–" if value is None else str(value)


def main(argv: Sequence[str] | None = None) -> int:
    """Measure what is asked for, keep the rest as it is stored."""
    parser = argparse.ArgumentParser("python -m studies.accuracy.rigid", description=__doc__)
    parser.add_argument("study", nargs="*", help=f"some of {', '.join(STUDIES)}; all, if none is named (20 minutes)")
    parser.add_argument("--output", type=Path, default=stored.PLACE, help="JSON file (default: beside this module)")
    parser.add_argument("--print", action="store_true", help="print what is stored and measure nothing")
    asked = parser.parse_args(argv)
    for name in asked.study:
        if name not in STUDIES:
            parser.error(f"study: got {name!r}, allowed: {', '.join(STUDIES)}")
    figures = stored.load(asked.output)
    for name in [] if asked.print else asked.study or STUDIES:
        began = time.perf_counter()
        rows = STUDIES[name](lambda text: print(text, file=sys.stderr, flush=True))
        figures[name] = {
            "rows": rows,
            "seconds": round(time.perf_counter() - began),
            "step_us": 1e6 * motion.STEP,
            "sag_um": 1e6 * motion.SAG,
            "restitution": motion.RESTITUTION,
        }
        files.write_together({asked.output: json.dumps(figures, indent=1, allow_nan=False) + "\n"})
    for name, study in figures.items():
        print(f"\n{name} ({study['seconds']} s)\n\n{table(study['rows'])}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
