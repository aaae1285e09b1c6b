"""Search for sensorless schedules: ``python -m studies.sensorless configs/sensorless.yaml``.

Compares schedules with hand-made ones, and writes the best of each part and hardware model, and a page.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from agents import command_line
from studies import common
from studies.sensorless.settings import load_settings
from studies.sensorless.study import study
from vibgym.files import output_directory, write_atomically


def run(asked: argparse.Namespace) -> int:
    """Search, evaluate, and write schedules and page; return the exit code."""
    settings = load_settings(asked.config)
    directory = output_directory(asked.output)
    page = asked.page or directory / "sensorless.md"
    write_atomically(page, study(settings, str(asked.config), directory))
    print(f"page: {page}")
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    parser = common.parser(__doc__, keep=False)
    command_line.config(parser, "YAML file, see configs/sensorless.yaml")
    parser.add_argument("--output", type=Path, default=Path("runs/sensorless"), help="directory of the schedules")
    parser.add_argument("--page", type=Path, metavar="PATH", help="path of the page (default: in that directory)")
    asked = parser.parse_args(argv)
    return command_line.guarded("python -m studies.sensorless", lambda: run(asked))


if __name__ == "__main__":
    sys.exit(main())
