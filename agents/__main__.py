"""Command line: ``python -m agents evaluate CONFIG``, ``publish CONFIG``, ``verify`` and so on, see ``--help``.

Exit codes: 0 done, 2 bad input (one line that names file, field and allowed values), 130 interrupted, 1 anything else, as where
published results do not come out again.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Sequence
from pathlib import Path

from vibgym import interrupts

interrupts.start_command()

PUBLISHED = Path("results/report")


def parser() -> argparse.ArgumentParser:
    """The command line's grammar."""
    result = argparse.ArgumentParser(prog="python -m agents", description="Evaluate, compare and train policies.")
    commands = result.add_subparsers(dest="command", required=True)
    evaluating = commands.add_parser("evaluate", help="run policies on tasks and write a report")
    evaluating.add_argument("--episodes", type=int, metavar="N", help="episodes of each policy on each task")
    evaluating.add_argument(
        "--gif", nargs=3, metavar=("TASK", "POLICY", "PATH"), help="also write the film of this pair as a GIF file"
    )
    evaluating.add_argument("--gif-hardware", metavar="NAME", help="on which hardware, instead of the first one")
    comparing = commands.add_parser("compare", help="compare learned with classical policies on the same seeds")
    comparing.add_argument("--episodes", type=int, metavar="N", help="episodes of each policy on each task")
    training = commands.add_parser("train", help="train a policy, or go on from its last checkpoint")
    training.add_argument(
        "--policy", type=Path, metavar="PATH", help="the trained policy's JSON file, instead of policy.json in DIR"
    )
    training.add_argument("--agent", metavar="NAME", help="which one of a file of many, such as Align/prototype")
    training.add_argument("--seed", type=int, metavar="N", help="of the training, instead of the file's")
    tabulating = commands.add_parser(
        "tabulate", help="play the seeds of trained agents, write their table, ship the best"
    )
    tabulating.add_argument("config", type=Path, metavar="CONFIG", help="YAML file of agents")
    tabulating.add_argument(
        "--agent", action="append", metavar="NAME", help="only this one; may be given several times"
    )
    tabulating.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2], metavar="N", help="of the trainings")
    tabulating.add_argument("--episodes", type=int, default=500, metavar="N", help="of each policy")
    tabulating.add_argument("--output", type=Path, default=Path("results/agents.csv"), metavar="FILE")
    tabulating.add_argument("--page", type=Path, metavar="FILE", help="the whole table in Markdown")
    tabulating.add_argument("--ship", type=Path, metavar="DIR", help="where the best seeds' policies go")
    training.add_argument("--seeds", type=int, nargs="+", metavar="N", help="of trainings side by side, instead of one")
    tuning = commands.add_parser("tune", help="look for better hyperparameters, or go on looking")
    tuning.add_argument("--agent", metavar="NAME", help="which one of a file of many, such as Align/ideal")
    tuning.add_argument("--trials", type=int, metavar="N", help="in all, instead of the file's")
    publishing = commands.add_parser("publish", help="keep the figures and episodes of an evaluation that has been run")
    publishing.add_argument("config", type=Path, metavar="CONFIG", help="YAML file of the evaluation")
    publishing.add_argument("--run", type=Path, metavar="DIR", help="the evaluation's files, instead of its 'output'")
    publishing.add_argument("--output", type=Path, default=PUBLISHED, metavar="DIR", help="where they go")
    verifying = commands.add_parser(
        "verify", help="play a sample of published results: does each figure come out again?"
    )
    verifying.add_argument("published", type=Path, nargs="?", default=PUBLISHED, metavar="DIR", help="see publish")
    verifying.add_argument(
        "--episodes", type=int, default=20, metavar="N", help="fresh ones of each policy in each place"
    )
    verifying.add_argument("--again", type=int, default=5, metavar="N", help="published ones of each, played again")
    verifying.add_argument("--first-seed", type=int, metavar="N", help="of the fresh ones, instead of the next one")
    verifying.add_argument("--task", action="append", metavar="NAME", help="only this one; may be given several times")
    verifying.add_argument(
        "--policy", action="append", metavar="NAME", help="only this one; may be given several times"
    )
    verifying.add_argument("--output", type=Path, metavar="FILE", help="CSV file of all figures and their intervals")
    verifying.add_argument("--quiet", action="store_true", help="no progress bars")
    for command in (training, tuning, verifying):
        command.add_argument("--processes", type=int, default=2, metavar="N", help="side by side on this machine")
    for command in (evaluating, comparing, training, tuning, verifying):
        command.add_argument("--ray", metavar="ADDRESS", help="work on a Ray cluster: auto, local or HOST:PORT")
    for command in (evaluating, comparing, training, tuning):
        command.add_argument("config", type=Path, metavar="CONFIG", help="YAML file, see configs/")
        command.add_argument("--output", metavar="DIR", help="directory for what is written, instead of the file's")
        command.add_argument("--quiet", action="store_true", help="no progress bars")
    recording = commands.add_parser("record", help="play a policy and keep its episodes as a Minari data set")
    recording.add_argument("config", type=Path, metavar="CONFIG", help="YAML file, see configs/recordings/")
    recording.add_argument("--quiet", action="store_true", help="no progress bar")
    return result


def evaluate(arguments: argparse.Namespace) -> int:
    """Run an evaluation, write its files and print the summary."""
    from agents import evaluation, locks, workers
    from vibgym import files

    held = contextlib.ExitStack()  # the directory is this run's until its files are written
    try:
        settings = evaluation.load_settings(arguments.config, arguments.episodes, arguments.output)
        gif = None
        if arguments.gif is None and arguments.gif_hardware is not None:
            raise ValueError(f"--gif-hardware: got {arguments.gif_hardware!r}; allowed: nothing without --gif")
        if arguments.gif is not None:
            task, policy, path = arguments.gif
            gif = evaluation.Gif(task, policy, Path(path), arguments.gif_hardware)
        try:
            prepared = evaluation.prepare(settings, gif)
            held.enter_context(locks.one_run(Path(settings.output), "evaluation.output"))
        except ValueError as error:
            raise ValueError(f"{arguments.config}: {error}") from None
    except ValueError as error:
        return refused(error)
    try:
        with held:
            results = evaluation.evaluate(prepared, arguments.quiet, arguments.ray)
            page = evaluation.write(results, prepared.film, arguments.quiet)
    except workers.NoCluster as error:
        return refused(error)
    except files.WriteError as error:
        return failed(error)
    print(evaluation.summary_table(results))
    print(f"\nreport: {page}")
    return 0


def publish(arguments: argparse.Namespace) -> int:
    """Keep what an evaluation has found."""
    from agents.evaluation import verification
    from vibgym.files import WriteError

    try:
        record = verification.publish(arguments.config, arguments.run, arguments.output)
    except ValueError as error:
        return refused(error)
    except WriteError as error:
        return failed(error)
    print(f"published: {record}")
    return 0


def verify(arguments: argparse.Namespace) -> int:
    """Play a sample of published results and say whether each figure comes out again."""
    from agents.evaluation import verification
    from vibgym import checks, files

    asked = verification.Asked(
        arguments.episodes, arguments.again, arguments.first_seed, arguments.task, arguments.policy
    )
    try:
        checks.count("--processes", arguments.processes, most=256)
        published = verification.load_published(arguments.published)
        if arguments.output is not None:
            files.output_files([arguments.output], "--output")
        found = verification.verify(published, asked, arguments.processes, arguments.quiet, arguments.ray)
    except ValueError as error:
        return refused(error)
    try:
        if arguments.output is not None:
            files.write_atomically(arguments.output, verification.figures_csv(found))
    except files.WriteError as error:
        return failed(error)
    print(verification.report_of(found))
    return 0 if found.holds else 1


def compare(arguments: argparse.Namespace) -> int:
    """Run a comparison, write its files and print the summary."""
    from agents import locks, workers
    from agents.evaluation import comparison
    from vibgym import files

    held = contextlib.ExitStack()
    try:
        settings = comparison.load_settings(arguments.config, arguments.episodes, arguments.output)
        try:
            prepared = comparison.prepare(settings)
            held.enter_context(locks.one_run(Path(settings.output), "comparison.output"))
        except ValueError as error:
            raise ValueError(f"{arguments.config}: {error}") from None
    except ValueError as error:
        return refused(error)
    try:
        with held:
            found = comparison.compare(prepared, arguments.quiet, arguments.ray)
            page = comparison.write(found)
    except workers.NoCluster as error:
        return refused(error)
    except files.WriteError as error:
        return failed(error)
    print(comparison.summary_table(found))
    print(f"\npage: {page}")
    return 0


def train(arguments: argparse.Namespace) -> int:
    """Train a policy."""
    from agents.training.checkpoint import TrainingError
    from agents.training.many import train_seeds
    from agents.training.train import train
    from vibgym.files import WriteError

    output = None if arguments.output is None else Path(arguments.output)
    config, agent, quiet = arguments.config, arguments.agent, arguments.quiet
    try:
        if arguments.seeds is None:
            if arguments.ray is not None:
                raise ValueError(f"--ray: got {arguments.ray!r}; allowed: nothing without --seeds")
            train(config, output, quiet, arguments.policy, agent, arguments.seed)
        else:
            for name in ("seed", "policy"):
                if getattr(arguments, name) is not None:
                    raise ValueError(f"--{name}: got {getattr(arguments, name)}; allowed: nothing beside --seeds")
            paths = train_seeds(config, arguments.seeds, output, quiet, agent, arguments.processes, arguments.ray)
            print("\n".join(map(str, paths)))
    except ValueError as error:
        return refused(error)
    except (TrainingError, WriteError) as error:
        return failed(error)
    return 0


def tune(arguments: argparse.Namespace) -> int:
    """Look for better hyperparameters."""
    from agents.tuning.tune import tune
    from vibgym.files import WriteError

    output = None if arguments.output is None else Path(arguments.output)
    try:
        page, best = tune(
            arguments.config,
            arguments.agent,
            arguments.trials,
            output,
            arguments.quiet,
            arguments.processes,
            arguments.ray,
        )
    except ValueError as error:
        return refused(error)
    except WriteError as error:
        return failed(error)
    if best is not None:
        print(f"best: trial {best.number}, {best.score:.3f} s, {best.values}")
    print(f"page: {page}")
    return 0


def record(arguments: argparse.Namespace) -> int:
    """Keep a policy's episodes."""
    from agents.recording.record import record
    from agents.recording.settings import load_settings
    from vibgym.files import WriteError

    try:
        settings = load_settings(arguments.config)
        try:
            place, steps, seconds = record(settings, arguments.quiet)
        except ValueError as error:
            raise ValueError(f"{arguments.config}: {error}") from None
    except ValueError as error:
        return refused(error)
    except WriteError as error:
        return failed(error)
    print(f"{place}: {settings.episodes} episodes, {steps} steps in {seconds:.1f} s, {steps / seconds:.0f} steps/s")
    return 0


def tabulate(arguments: argparse.Namespace) -> int:
    """Play the seeds of trained agents and write their table."""
    from agents.training.settings import agents_in
    from agents.training.table import selected, tabulate
    from vibgym.files import WriteError

    try:
        names = selected(arguments.config, arguments.agent, agents_in(arguments.config))
        rows = tabulate(
            arguments.config,
            names,
            arguments.seeds,
            arguments.episodes,
            arguments.output,
            arguments.ship,
            arguments.page,
        )
    except ValueError as error:
        return refused(error)
    except WriteError as error:
        return failed(error)
    for row in rows:
        time = row["time_to_goal_median_s"]
        print(f"{row['agent']} seed {row['seed']}: success {100 * row['success']:.1f} %, median {time:.2f} s")
    return 0


EXTRAS = {
    "h5py": "data",
    "jinja2": "report",
    "joblib": "report",
    "matplotlib": "report",
    "minari": "data",
    "optuna": "tune",
    "ray": "cluster",
    "scipy": "report",
    "stable_baselines3": "learn",
    "torch": "learn",
}
"""Which of our extras brings a package that a command may need."""


def refused(error: ValueError) -> int:
    """Say in one line what is wrong with the input."""
    print(" ".join(str(error).split()), file=sys.stderr)
    return 2


def failed(error: Exception) -> int:
    """Say in one line what has kept a run with good input from its end."""
    print(" ".join(str(error).split()), file=sys.stderr)
    return 1


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    arguments = parser().parse_args(argv)
    commands = {
        "evaluate": evaluate,
        "publish": publish,
        "verify": verify,
        "compare": compare,
        "train": train,
        "tabulate": tabulate,
        "tune": tune,
        "record": record,
    }
    run = commands[arguments.command]

    def connected() -> int:
        try:
            return run(arguments)
        except ConnectionError as error:  # of a cluster whose nodes are lost for good
            return failed(error)
        except ModuleNotFoundError as error:
            extra = EXTRAS.get((error.name or "").partition(".")[0])
            if extra is None:
                raise
            text = f"{arguments.command}: {error.name} is not installed: pip install 'vibgym[{extra}]'"
            return failed(RuntimeError(text))

    return interrupts.run(connected)


if __name__ == "__main__":
    interrupts.leave(main())
