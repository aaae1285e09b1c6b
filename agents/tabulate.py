"""The table of trained agents: every seed of a run on fresh episodes, and which of them is shipped.

``python -m agents tabulate configs/agents/ppo.yaml --seeds 0 1 2 --ship vibgym/policies/trained/shipped``
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from agents import command_line, served
from agents.command_line import Command
from agents.evaluation.plan import has_fast_contacts
from agents.evaluation.statistics import bootstrap
from agents.evaluation.table import RATES, ends, frame, mean, summary, values
from agents.learning_curve import FILE as CURVE
from agents.learning_curve import RATE, evaluation_environments, rank, read_texts, without_hold
from agents.train import POLICY
from agents.training_file import agents_in, load_settings
from agents.training_settings import TrainSettings
from vibgym import checks
from vibgym.files import csv_text, write_together
from vibgym.policies.measures import Measures
from vibgym.policies.rollout import rollout
from vibgym.policies.trained.storage import load_set, save_set
from vibgym.policies.trained.trained import KIND, RESIDUAL, VERSION
from vibgym.registration import ENVIRONMENTS
from vibgym.seeds import RANGES

FIRST_SEED = 200_000
"""First seed of the new episodes, in the range "evaluation" of :mod:`vibgym.seeds`."""

LEVEL, RESAMPLES = 0.95, 2000

TABLE = "agents.csv"

NOT_EVALUATED = {"success": 0.0, "speed": 0.0, "time_to_goal": "", "cost": "inf"}
"""Row of a run without a learning curve."""


def tabulate(
    config: Path,
    names: Sequence[str],
    seeds: Sequence[int],
    episodes: int,
    output: Path,
    page: Path | None = None,
    ship: Path | None = None,
    choose: int | None = None,
) -> list[dict[str, Any]]:
    """Play all seeds of agents, write their table, and ship the best seed of each, with the parts that it serves.

    The best seed has the best row of its own learning curve, on other episodes than these. The learning curve
    (``curves/align-ideal-seed-0.csv``) and the policy (``policies/``) of every seed are copied.

    Args:
        config: file of agents.
        names: of agents in it.
        seeds: of their trainings.
        episodes: of each policy.
        output: directory of ``agents.csv``, in which rows of other agents are kept, ``curves/`` and ``policies/``.
        page: Markdown file of the whole table, or None.
        ship: directory for the policies of the best seeds, ``align.json``, ``align-prototype.json`` and so on, or None.
        choose: seed to ship instead of the best.

    Raises:
        ValueError: a policy is missing or does not load, too many episodes, or a chosen seed that is not one of ``seeds``
            or without ``ship``; nothing is written.
    """
    if choose is not None and choose not in seeds:
        raise checks.refuse("--choose", choose, f"one of the seeds {', '.join(map(str, seeds))}")
    if choose is not None and ship is None:
        raise checks.conflict("--choose requires --ship")
    checks.count("--episodes", episodes, most=RANGES["evaluation"].stop - FIRST_SEED)
    new = pd.DataFrame([_row(name, load_settings(config, name, seed), episodes) for name in names for seed in seeds])
    ranked = new.assign(other=new["seed"] != choose).sort_values(["other", "selection", "seed"])
    best = ranked.groupby("agent", sort=False).head(1).index
    new["shipped"] = new.index.isin(best) & (ship is not None)
    files: dict[Path, str | bytes] = {}
    for row in new.to_dict("records"):
        run, path = f"{row['agent'].lower().replace('/', '-')}-seed-{row['seed']}", Path(row["path"])
        if (path.parent / CURVE).exists():
            files[output / "curves" / f"{run}.csv"] = (path.parent / CURVE).read_text(encoding="utf-8")
        _copy(path, output / "policies" / f"{run}.json")
    rows = new.drop(columns=["selection", "path"]).astype(object)
    table = rows
    if (output / TABLE).exists():  # rows of older tables lack the last columns
        former = read_texts(output / TABLE)
        table = pd.concat([former[~former["agent"].isin(names)], rows])
        table = pd.DataFrame(table, columns=rows.columns).fillna("")
    table = table.sort_values(
        ["agent", "seed"], key=lambda column: column if column.name == "agent" else column.astype(int)
    )
    files[output / TABLE] = csv_text(table.to_dict("records"))
    if page is not None:
        files[page] = markdown(table.to_dict("records"))
    for path in files:
        path.parent.mkdir(parents=True, exist_ok=True)
    write_together(files)
    if ship is not None:
        for row in new.loc[best].to_dict("records"):
            path = ship / f"{shipped_name(row['agent'])}.json"
            _copy(Path(row["path"]), path)
            if all(task in ENVIRONMENTS for task in load_set(path, KIND, VERSION)[1]["tasks"]):
                served.store(path)
            else:
                print(f"{path}: the parts that it serves are measured only in environments of vibgym")
    return rows.to_dict("records")


def markdown(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the table in Markdown: one line for every training."""
    machines = sorted({f"{row['processor']}, {row['threads']} thread(s); {row['versions']}" for row in rows})
    lines = [INTRODUCTION, *(_line(row) for row in rows), "", *(f"Trained on: {machine}" for machine in machines)]
    return "\n".join(lines) + "\n"


INTRODUCTION = """\
# Trained agents

Written by `python -m agents tabulate`: every training seed on fresh episodes, with a 95 % interval; times are
medians, with the hold of 0.4 s, the bound is the lower bound of [bound.md](bound.md). Shipped is the seed that did
best on the episodes of its own learning curve, not on these, unless `--choose` named another ([learning](learning.md)).
What was trained on what: `results/agents.csv`.
Steps and minutes are those of the last run; one with `start` in its settings continues from another agent.
Where parts come and go there is no success; *faulty* is the share of parts that leave otherwise than they should.
Contacts are certified; in parentheses the same with the fast contacts of agents that were trained with them.

| agent | seed | steps | minutes | success | of | interval | time to goal | over bound | good a minute | faulty | collisions \
| fallen | shipped |
|---|---|---|---|---|---|---|---|---|---|---|---|---|---|"""


def _line(row: Mapping[str, Any]) -> str:
    def number(name: str, form: str, factor: float = 1.0, otherwise: str = "–") -> str:
        value = float(row[name]) if row.get(name) not in ("", None) else float("nan")
        return form.format(factor * value) if np.isfinite(value) else otherwise

    ends = number("good_per_minute_mean", "{}") == "–"  # where parts come and go there is no success
    success = number("success", "{:.1f} %", 100.0) + number("success_fast_contacts", " ({:.1f} %)", 100.0, "")
    rate = number("good_per_minute_mean", "{:.1f}") + number("good_per_minute_fast_contacts", " ({:.1f})", otherwise="")
    interval = f"{number('success_low', '{:.1f}', 100)} to {number('success_high', '{:.1f} %', 100)}"
    cells = [
        row["agent"],
        row["seed"],
        f"{int(row['steps']):_}".replace("_", " "),
        number("minutes", "{:.1f}"),
        success if ends else "–",
        row["episodes"],
        interval if ends else "–",
        number("time_to_goal_median_s", "{:.2f} s"),
        number("time_over_bound_median", "{:.3f}"),
        rate,
        number("faulty_share", "{:.1f} %", 100.0),
        number("collisions_mean", "{:.2f}"),
        row["fallen"],
        "yes" if str(row["shipped"]) == "True" else "",
    ]
    return "| " + " | ".join(map(str, cells)) + " |"


FAULTY = [name for name in RATES if name != RATE]
"""Columns of parts that leave otherwise than they should."""


def shipped_name(agent: str) -> str:
    """Return ``align`` for ``Align/ideal``, ``align-prototype`` for ``Align/prototype``."""
    task, _, variant = agent.partition("/")
    return task.lower() if variant == "ideal" else f"{task.lower()}-{variant}"


def _row(name: str, settings: TrainSettings, episodes: int) -> dict[str, Any]:
    """Return the row of one training: its record, and the results of its policy on new episodes."""
    directory = Path(str(settings.output))
    path = directory / POLICY
    record = load_set(path, KIND, VERSION)[1]
    training, kind = record["training"], RESIDUAL if RESIDUAL in record else "trained"
    policy = {"kind": kind, "path": str(path)}
    trained_in, selection = without_hold(settings), settings.selection
    played = _played(policy, settings.task, evaluation_environments(settings), episodes)
    # Agents trained with fast contacts: the difference that these make.
    fast: dict[str, Any] = {"success_fast_contacts": None, "good_per_minute_fast_contacts": None}
    if any(has_fast_contacts(scene.get("model", "")) for scene in trained_in):
        quick = _played(policy, settings.task, trained_in, episodes)
        fast = {"success_fast_contacts": mean(quick, "success"), "good_per_minute_fast_contacts": mean(quick, RATE)}
    totals, good, faulty = (
        summary(played, LEVEL, RESAMPLES),
        values(played, RATE),
        played[FAULTY].sum(axis=1, skipna=False),
    )
    seconds = played["time_to_goal_s"].dropna().to_numpy()
    middle = bootstrap(seconds, LEVEL, RESAMPLES) if len(np.unique(seconds)) > 1 else None
    criterion: dict[str, Any] = (
        {} if selection is None else {"best": selection.best, "cost_limit": selection.cost_limit}
    )
    curve = read_texts(directory / CURVE).to_dict("records") if (directory / CURVE).exists() else []
    best_row = min(curve, key=lambda row: rank(row, **criterion), default=NOT_EVALUATED)
    return {
        "agent": name,
        "seed": settings.seed,
        "algorithm": training["algorithm"],
        "environment": json.dumps(settings.environment, sort_keys=True),
        "steps": training["steps"],
        "kept_from_step": training.get("kept_from_step", training["steps"]),
        "minutes": training["minutes"],
        "threads": training["threads"],
        "processor": training["processor"],
        "versions": " ".join(f"{key} {value}" for key, value in sorted(training["versions"].items()) if value),
        "selection": rank(best_row, **criterion),
        "selection_success": float(best_row["success"]),
        "selection_time_s": float(best_row["time_to_goal"] or "inf"),
        "episodes": episodes,
        "first_seed": FIRST_SEED,
        "success": totals["success_rate"],
        **{name: totals[name] for name in ("success_low", "success_high", "time_to_goal_median_s")},
        "time_to_goal_mean_s": float(np.mean(seconds)) if len(seconds) else math.nan,
        **ends("time_to_goal_mean", middle, "_s"),
        **{name: totals[name] for name in ("time_over_bound_median", "collisions_mean", "fallen")},
        "selection_rate": float(best_row.get("rate") or 0.0),
        "good_per_minute_mean": mean(played, RATE),
        "faulty_share": faulty.mean() / (good + faulty).mean(),
        **fast,
        "path": str(path),
        "shipped": False,
    }


def _played(policy: Any, task: str, scenes: Sequence[Mapping[str, Any]], episodes: int) -> pd.DataFrame:
    """Return new episodes of a policy, see :mod:`agents.evaluation.table`; they are divided among scenes."""
    tables, longest = [], 0.0
    for scene, share in zip(scenes, np.array_split(np.arange(episodes), len(scenes)), strict=True):
        own = {key: value for key, value in scene.items() if key not in ("action", "observation", "autoreset_mode")}
        seeds = [FIRST_SEED + int(k) for k in share]
        result = rollout(policy, task, seeds=seeds, keep=Measures, **own)
        tables.append(frame(result))
        longest = max(longest, result.step_time * float(result.steps.max()))
    return pd.concat(tables, ignore_index=True).assign(training_seed=-1, limit_s=longest)


def _copy(path: Path, to: Path) -> None:
    """Copy a policy file and its tensors, whose name follows the file's."""
    tensors, record = load_set(path, KIND, VERSION)
    content = {key: value for key, value in record.items() if key not in ("tensors", "sha256")}
    save_set(to, KIND, tensors, content, VERSION)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``tabulate``."""
    command_line.config(parser, "YAML file of agents")
    command_line.some(parser, "--agent")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2], metavar="N", help="of the trainings")
    parser.add_argument("--episodes", type=int, default=500, metavar="N", help="of each policy")
    parser.add_argument("--page", type=Path, metavar="FILE", help="the whole table in Markdown")
    parser.add_argument("--ship", type=Path, metavar="DIR", help="directory for the best seeds' policies")
    parser.add_argument("--choose", type=int, metavar="SEED", help="ship this seed instead of the best")


def command(args: argparse.Namespace) -> None:
    """Evaluate the seeds of trained agents and write their table."""
    known = agents_in(args.config)
    for name in args.agent or ():
        checks.choice("--agent", name, tuple(known))
    names, output = args.agent or list(known), args.output or Path("runs/agents")
    for row in tabulate(args.config, names, args.seeds, args.episodes, output, args.page, args.ship, args.choose):
        time = row["time_to_goal_median_s"]
        print(f"{row['agent']} seed {row['seed']}: success {100 * row['success']:.1f} %, median {time:.2f} s")


COMMANDS = {
    "tabulate": Command(arguments, command, "directory of agents.csv, curves and policies, instead of runs/agents")
}
