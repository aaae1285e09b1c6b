"""``python -m agents tune CONFIG``."""

from __future__ import annotations

from pathlib import Path

from agents import locks
from agents.tuning.study import best, run_study
from agents.tuning.trial import Tried
from agents.tuning.tuning_page import write
from agents.tuning.tuning_settings import Tuning
from agents.workers import side_by_side
from vibgym import checks
from vibgym.files import output_directory


def tune(
    config: Path,
    agent: str | None = None,
    trials: int | None = None,
    output: Path | None = None,
    quiet: bool = False,
    processes: int = 2,
    ray: str | None = None,
) -> tuple[Path, Tried | None]:
    """Tune as the file says, from where an earlier sitting was ended if there was one.

    Args:
        config, agent: see :class:`agents.tuning.tuning_settings.Tuning`.
        trials: in all, instead of the file's.
        output: directory of the study, instead of ``runs/tuning/<agent>``.
        quiet: no progress bar.
        processes: side by side on this machine.
        ray: address of a cluster, see :func:`agents.workers.cluster.on_ray`.

    Returns:
        Path of the page, and the best trial; None if there is none.

    Raises:
        ValueError: bad settings, a study of other settings, or one at which another run is at work.
    """
    tuning = Tuning(config, agent)
    trials = tuning.settings.trials if trials is None else checks.count("--trials", trials, least=1, most=100_000)
    directory = output or Path("runs/tuning") / (agent or config.stem).replace("/", "-")
    output_directory(directory)
    with locks.one_run(directory), side_by_side(processes, ray) as submit:
        tried = run_study(tuning, directory, trials, submit, quiet)
        return write(tuning, tried, directory), best(tried)
