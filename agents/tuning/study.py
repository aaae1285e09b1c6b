"""A study: trials proposed one after the other, carried out side by side, kept by Optuna in a file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from pathlib import Path
from typing import Any

import optuna
from optuna.exceptions import StorageInternalError
from sqlalchemy.exc import SQLAlchemyError
from tqdm import tqdm

import vibgym
from agents.tuning.trial import Tried, run_trial
from agents.tuning.tuning_settings import Tuning
from agents.workers import Submit
from vibgym import checks
from vibgym.files import WriteError, write_atomically

STUDY, SETTINGS, NAME = "study.db", "tuning.json", "tuning"


def run_study(tuning: Tuning, directory: Path, trials: int, submit: Submit, quiet: bool = False) -> list[Tried]:
    """Carry out the trials that are not done yet.

    Args:
        tuning: what is tuned.
        directory: of the study; that of another one is refused.
        trials: in all, those of earlier sittings included.
        submit: of :func:`agents.workers.side_by_side`.
        quiet: no progress bar.

    Returns:
        All trials, in their order.

    Raises:
        ValueError: the directory holds a study of other settings or of another version, or a file that is none.
        WriteError: no space is left, or the like; the trials that are done stay.
    """
    check_same(tuning, directory)
    study, kept = opened(directory / STUDY)
    done: dict[int, Tried] = {}
    under_way: dict[Future[Tried], int] = {}
    abreast, number = tuning.settings.abreast, 0
    with tqdm(total=trials, desc="tuning", unit="trial", disable=quiet) as bar:
        while len(done) < trials:
            while number < trials and all(k in done for k in range(number - abreast + 1)):
                before = [done[k] for k in range(max(number - abreast + 1, 0))]
                values = proposed(tuning, number, before)
                folder = directory / f"trial-{number:03d}"
                asked = submit(run_trial, tuning.path, tuning.agent, number, values, before, folder)
                under_way[asked] = number
                number += 1
            for future in wait(under_way, return_when=FIRST_COMPLETED).done:
                done[under_way.pop(future)] = future.result()
                bar.update()
            while kept in done:  # in their order, so that the file is always a whole beginning of the study
                try:
                    study.add_trial(done[kept].frozen(tuning.space))
                except (StorageInternalError, SQLAlchemyError) as error:  # which is rolled back
                    allowed = "the same command goes on once it can be"
                    raise WriteError(
                        f"{directory / STUDY}: could not be written ({_first(error)}); {allowed}"
                    ) from error
                kept += 1
            found = best(list(done.values()))
            if found is not None:
                bar.set_postfix_str(f"best {found.score:.3f} s, trial {found.number}", refresh=False)
    return [done[k] for k in range(trials)]


def opened(path: Path) -> tuple[optuna.Study, int]:
    """The study in a file, which is made if there is none, and how many trials it has.

    Raises:
        ValueError: the file is no study.
    """
    try:
        study = optuna.create_study(storage=f"sqlite:///{path}", study_name=NAME, load_if_exists=True)
        return study, len(study.get_trials(deepcopy=False))
    except (StorageInternalError, SQLAlchemyError, RuntimeError) as error:  # RuntimeError: of another version of Optuna
        allowed = "a study that Optuna can read; remove it, and the same command writes it anew from the trials"
        raise checks.refuse(str(path), f"not readable ({_first(error)})", allowed) from None


def _first(error: BaseException) -> str:
    """What the database itself says."""
    cause = error.__cause__ or error
    return str(getattr(cause, "orig", None) or cause).partition("\n")[0]


def proposed(tuning: Tuning, number: int, before: Sequence[Tried]) -> dict[str, Any]:
    """What a trial tries: by the tree-structured Parzen estimator (Bergstra et al. 2011), from nothing but these arguments."""
    sampler = optuna.samplers.TPESampler(
        n_startup_trials=tuning.settings.startup, seed=tuning.settings.seed + 1_000_003 * number
    )
    study = optuna.create_study(sampler=sampler)
    for each in before:
        study.add_trial(each.frozen(tuning.space))
    return dict(study.ask(tuning.space).params)


def best(tried: Sequence[Tried]) -> Tried | None:
    """The trial with the best score among those that were not stopped; of equals the first."""
    whole = [each for each in tried if each.state == "complete" and each.score is not None]
    return min(whole, key=lambda each: (each.score, each.number), default=None)


def check_same(tuning: Tuning, directory: Path) -> None:
    """Keep what the study depends on, or compare it with what was kept.

    Raises:
        ValueError: they differ.
    """
    path, mine = directory / SETTINGS, {**tuning.as_written(), "version": {"vibgym": vibgym.__version__}}
    if not path.exists():
        if (directory / STUDY).exists():
            allowed = f"one beside its {SETTINGS}; remove it or choose another output"
            raise checks.refuse(str(directory / STUDY), "a study of unknown settings", allowed)
        write_atomically(path, json.dumps(mine, indent=2, sort_keys=True) + "\n")
        return
    try:
        theirs = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(theirs, dict) or not all(isinstance(theirs.get(part), dict) for part in mine):
            raise ValueError(f"no mapping of {', '.join(mine)}")
    except (OSError, ValueError) as error:
        raise checks.refuse(str(path), f"not readable ({error})", "the settings of a study") from None
    differing = [f"{part}.{key}" for part in mine for key in mine[part] if theirs[part].get(key) != mine[part][key]]
    if differing:
        allowed = "a study of the same settings; remove it or choose another output"
        raise checks.refuse(str(directory), f"a study with other {', '.join(differing)}", allowed)
