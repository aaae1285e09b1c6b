"""Command line: ``python -m agents evaluate CONFIG``, ``train CONFIG`` and so on, see ``--help``."""

from __future__ import annotations

from collections.abc import Sequence

from vibgym import interrupts

interrupts.start_command()

from agents.command_line import Room, run_one_of  # noqa: E402 - imports take seconds in which Ctrl-C is in hand already

ROOMS = {
    "evaluate": Room("agents.evaluation.commands", "run policies on tasks and write a report"),
    "compare": Room("agents.evaluation.commands", "compare learned with classical policies on the same seeds"),
    "score": Room("agents.evaluation.commands", "score policies on a suite of tasks, or a policy of your own"),
    "datasheet": Room("agents.evaluation.commands", "one printable page: what a surface does with a part of your own"),
    "publish": Room("agents.evaluation.commands", "keep the figures and episodes of an evaluation"),
    "verify": Room(
        "agents.evaluation.commands",
        "play a sample of published results: does each figure come out again?",
    ),
    "train": Room("agents.training.commands", "train a policy, or go on from its last checkpoint"),
    "tabulate": Room("agents.training.commands", "play the seeds of trained agents, write their table, ship the best"),
    "tune": Room("agents.tuning.commands", "look for better hyperparameters, or go on looking"),
    "record": Room("agents.recording.commands", "play a policy and keep its episodes as a Minari data set"),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    return run_one_of("python -m agents", "Evaluate, compare and train policies.", ROOMS, argv)


if __name__ == "__main__":
    interrupts.leave(main())
