"""``python -m agents train CONFIG`` and ``tabulate CONFIG``."""

from __future__ import annotations

import argparse
from pathlib import Path

from agents import command_line
from agents.command_line import Command
from vibgym import checks


def train_arguments(parser: argparse.ArgumentParser) -> None:
    """What ``train`` takes."""
    command_line.config(parser)
    parser.add_argument(
        "--policy", type=Path, metavar="PATH", help="the trained policy's JSON file, instead of policy.json in DIR"
    )
    parser.add_argument("--agent", metavar="NAME", help="which one of a file of many, such as Align/prototype")
    parser.add_argument("--seed", type=int, metavar="N", help="of the training, instead of the file's")
    parser.add_argument("--seeds", type=int, nargs="+", metavar="N", help="of trainings side by side, instead of one")
    command_line.side_by_side(parser)


def train(arguments: argparse.Namespace) -> None:
    """Train a policy, or several with other seeds."""
    from agents.training.many import train_seeds
    from agents.training.train import train

    config, output, agent, quiet = arguments.config, arguments.output, arguments.agent, arguments.quiet
    if arguments.seeds is None:
        if arguments.ray is not None:
            raise checks.refuse("--ray", arguments.ray, "nothing without --seeds")
        train(config, output, quiet, arguments.policy, agent, arguments.seed)
        return
    for name in ("seed", "policy"):
        if getattr(arguments, name) is not None:
            raise checks.refuse(f"--{name}", getattr(arguments, name), "nothing beside --seeds")
    paths = train_seeds(config, arguments.seeds, output, quiet, agent, arguments.processes, arguments.ray)
    print("\n".join(map(str, paths)))


def tabulate_arguments(parser: argparse.ArgumentParser) -> None:
    """What ``tabulate`` takes."""
    command_line.config(parser, "YAML file of agents")
    command_line.some(parser, "--agent")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2], metavar="N", help="of the trainings")
    parser.add_argument("--episodes", type=int, default=500, metavar="N", help="of each policy")
    parser.add_argument("--page", type=Path, metavar="FILE", help="the whole table in Markdown")
    parser.add_argument("--ship", type=Path, metavar="DIR", help="where the best seeds' policies go")


def tabulate(arguments: argparse.Namespace) -> None:
    """Play the seeds of trained agents and write their table."""
    from agents.training import table
    from agents.training.training_file import agents_in

    names = table.selected(arguments.config, arguments.agent, agents_in(arguments.config))
    into = table.Places(arguments.output or Path("results"), arguments.page, arguments.ship)
    for row in table.tabulate(arguments.config, names, arguments.seeds, arguments.episodes, into):
        time = row["time_to_goal_median_s"]
        print(f"{row['agent']} seed {row['seed']}: success {100 * row['success']:.1f} %, median {time:.2f} s")


COMMANDS = {
    "train": Command(train_arguments, train, "directory for what is written, instead of the file's"),
    "tabulate": Command(
        tabulate_arguments, tabulate, "directory of agents.csv, curves and policies, instead of results"
    ),
}
