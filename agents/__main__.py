"""Command line: ``python -m agents evaluate CONFIG``, ``train CONFIG`` and so on, see ``--help``."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from agents.command_line import Entry, run_one_of

COMMANDS = {
    "evaluate": Entry("agents.evaluation.report", "run policies on tasks and write a report"),
    "compare": Entry("agents.evaluation.report", "compare learned with classical policies on the same seeds"),
    "score": Entry("agents.evaluation.score", "score policies on a suite of tasks, or a user-defined policy"),
    "datasheet": Entry(
        "agents.evaluation.datasheet_page", "one printable page: rates and limits of a surface with a part"
    ),
    "publish": Entry("agents.evaluation.published", "publish the figures and episodes of an evaluation"),
    "verify": Entry("agents.evaluation.verify", "play a sample of published results and test every figure"),
    "train": Entry("agents.train", "train a policy, or continue from its last checkpoint"),
    "tabulate": Entry("agents.tabulate", "evaluate the seeds of trained agents, write their table, ship the best"),
    "range": Entry("agents.served", "measure which parts trained agents serve, and store it in their files"),
    "tune": Entry("agents.tune", "tune hyperparameters, or continue a study"),
    "record": Entry("agents.recording.record", "record episodes of a policy as a Minari data set"),
    "replay": Entry("agents.recording.replay", "replay the episodes of a data set, bit for bit"),
    "export": Entry("agents.recording.export", "replay a data set and write it in LeRobot's format"),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    return run_one_of("python -m agents", "Evaluate, compare and train policies.", COMMANDS, argv)


if __name__ == "__main__":
    sys.exit(main())
