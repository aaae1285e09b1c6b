"""Command line: ``python -m studies.accuracy.rigid [STUDY ...]`` measures, stores the figures and prints them as tables."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from agents.evaluation.table import markdown
from studies.accuracy import rigid
from studies.accuracy.rigid import motion
from studies.accuracy.rigid.studies import STUDIES
from vibgym import files


def cell(value: Any) -> str:
    """Return the text of a value in a table."""
    if isinstance(value, list):
        return ", ".join(cell(entry) for entry in value)
    return f"{value:.4g}" if isinstance(value, float) else "–" if value is None else str(value)


def main(argv: Sequence[str] | None = None) -> int:
    """Measure the named studies and print them all."""
    parser = argparse.ArgumentParser("python -m studies.accuracy.rigid", description=__doc__)
    parser.add_argument("study", nargs="*", help=f"among {', '.join(STUDIES)}; default: all (20 minutes)")
    parser.add_argument(
        "--output", type=Path, default=rigid.PLACE, help="JSON file (default: in the directory of this module)"
    )
    parser.add_argument("--print", action="store_true", help="print the stored figures without a measurement")
    arguments = parser.parse_args(argv)
    for name in arguments.study:
        if name not in STUDIES:
            parser.error(f"study: got {name!r}, allowed: {', '.join(STUDIES)}")
    figures = rigid.stored(arguments.output)
    for name in [] if arguments.print else arguments.study or STUDIES:
        began = time.perf_counter()
        rows = STUDIES[name](lambda text: print(text, file=sys.stderr, flush=True))
        figures[name] = {
            "rows": rows,
            "seconds": round(time.perf_counter() - began),
            "step_us": 1e6 * motion.STEP,
            "sag_um": 1e6 * motion.SAG,
            "restitution": motion.RESTITUTION,
        }
        files.write_together({arguments.output: json.dumps(figures, indent=1, allow_nan=False) + "\n"})
    for name, study in figures.items():
        rows = study["rows"]
        table = markdown(list(rows[0]), [[cell(value) for value in row.values()] for row in rows])
        print(f"\n{name} ({study['seconds']} s)\n\n{table}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
