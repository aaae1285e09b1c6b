"""A study's page: one HTML file that needs nothing else."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import optuna
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter
from optuna.visualization import matplotlib as plots

from agents.evaluation.figures import png
from agents.evaluation.pages import data_address, render
from agents.provenance import provenance
from agents.tuning.study import NAME, STUDY, best
from agents.tuning.trial import Tried
from agents.tuning.tuning_settings import Tuning
from vibgym.files import csv_text, write_together

BEST_SHOWN = 10

PLOTS: tuple[tuple[str, str, Callable[[optuna.Study], Any]], ...] = (
    ("Every trial, and the best so far", "Lower is better.", plots.plot_optimization_history),
    ("Learning curves of the trials", "Those that end early were stopped.", plots.plot_intermediate_values),
    ("What mattered", "Share of the variance of the score that a setting explains (PED-ANOVA).", plots.plot_param_importances),
    ("Each setting by itself", "A dot is a trial; dark ones are late.", plots.plot_slice),
)  # fmt: skip
"""Title, what to see, and how Optuna draws it."""


def write(tuning: Tuning, tried: Sequence[Tried], directory: Path) -> Path:
    """Write ``tuning.html`` and ``trials.csv``; returns the page's path."""
    study = optuna.load_study(storage=f"sqlite:///{directory / STUDY}", study_name=NAME)
    found = best(tried)
    whole = [each for each in tried if each.state == "complete" and each.score is not None]
    html = render(
        Path(__file__).with_name("tune.html.j2"),
        agent=tuning.agent or tuning.base.task,
        config=str(tuning.path),
        tuning=tuning.settings,
        judging=tuning.changes({})["judging"],
        steps=tuning.settings.steps or tuning.base.steps,
        trials=len(tried),
        pruned=sum(each.state == "pruned" for each in tried),
        failed=sum(each.state == "failed" for each in tried),
        names=list(tuning.space),
        best=found,
        rows=sorted(whole, key=lambda each: (each.score, each.number))[:BEST_SHOWN],
        plots=[
            {"title": title, "text": text, "image": image}
            for title, text, draw in PLOTS
            if (image := _drawn(draw, study)) is not None
        ],
        provenance=provenance(),
        settings_text=json.dumps(tuning.as_written(), indent=2),
    )
    rows = [{"trial": each.number, "state": each.state, "score_s": each.score, **each.values} for each in tried]
    page = directory / "tuning.html"
    write_together({page: html, directory / "trials.csv": csv_text(rows)})
    return page


def _drawn(draw: Callable[[optuna.Study], Any], study: optuna.Study) -> str | None:
    """The picture as the page's address of it; None where there is too little to draw."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # experimental, says Optuna of all of them
        try:
            axes = draw(study)
        except (ValueError, RuntimeError, ZeroDivisionError):  # too few trials, or all alike
            return None
    every = np.ravel(np.asarray(axes, dtype=object))
    for each in every:
        if each.get_xscale() == "log":  # powers of ten would be formulas, which pictures here do not have
            each.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            each.xaxis.set_minor_formatter(NullFormatter())
    first = every[0]
    figure: Figure = first.figure
    figure.set_size_inches(max(8.6, 2.0 * len(every)), 3.4)
    figure.set_layout_engine("constrained")
    if legend := first.get_legend():
        legend.set_visible(len(legend.get_texts()) <= 6)
    return data_address(png(figure))
