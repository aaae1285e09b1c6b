"""Command line: ``python -m agents evaluate CONFIG``, ``train CONFIG`` and so on, see ``--help``."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from agents.command_line import Entry, run_one_of

COMMANDS = {
    "evaluate": Entry("agents.evaluation.commands", "run policies on tasks and write a report"),
    "compare": Entry("agents.evaluation.commands", "compare learned with classical policies on the same seeds"),
    "score": Entry("agents.evaluation.commands", "score policies on a suite of tasks, or a policy of your own"),
    "datasheet": Entry("agents.evaluation.commands", "one printable page: what a surface does with a part of your own"),
    "publish": Entry("agents.evaluation.commands", "keep the figures and episodes of an evaluation"),
    "verify": Entry(
        "agents.evaluation.commands",
        "play a sample of published results: does each figure come out again?",
    ),
    "train": Entry("agents.train", "train a policy, or continue from its last checkpoint"),
    "tabulate": Entry("agents.tabulate", "evaluate the seeds of trained agents, write their table, ship the best"),
    "tune": Entry("agents.tune", "tune hyperparameters, or continue a study"),
    "record": Entry("agents.recording.commands", "play a policy and keep its episodes as a Minari data set"),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    return run_one_of("python -m agents", "Evaluate, compare and train policies.", COMMANDS, argv)


if __name__ == "__main__":
    sys.exit(main())
