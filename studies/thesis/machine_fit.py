"""Fit of the thesis's machine to its measurements: ``python -m studies.thesis.machine_fit [--keep]``.

Least squares on simulations, for each experiment alone and for several together, within the ranges of
:data:`studies.thesis.measurements.BOX`. Residuals are in units of the measurements' errors, so that a machine reproduces the
measurements if none is larger than 1. Takes about ten minutes of one core.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import qmc

from studies.kept import argument, show
from studies.thesis.machine import Machine, predictions, residuals
from studies.thesis.measurements import BOX, EXPERIMENTS, MEASUREMENTS
from vibgym.files import output_directory, write_atomically
from vibgym.physics.core.hardware import FORMS

SHARED = ("friction", "horizontal_amplitude", "frequency", "gain")
STRIBECK = ("rise", "speed", "shape")
OF_STEPS = ("dead_zone", "limit", "step")
"""Parameters that the steps alone determine; they also change the speed at 0.08 mm and the squeeze field, which are bounds."""


class Model(NamedTuple):
    """Hypothesis: its name in tables, fitted parameters that are not only of the steps, and fixed ones."""

    label: str
    names: tuple[str, ...]
    start: Machine


MODELS: dict[str, Model] = {
    "constant": Model("constant friction", SHARED, Machine()),
    "stribeck": Model("Stribeck friction", (*SHARED, *STRIBECK), Machine(rise=0.5)),
    "weak": Model("Stribeck, more amplitude", (*SHARED, *STRIBECK), Machine(rise=0.5, reach=None)),
    "frequency": Model("constant, other frequency", (*SHARED, "top_frequency"), Machine(top_frequency=28.0)),
}
"""Hypotheses. In the first two the top speed was measured like all others: at 25 Hz and up to the 0.4 mm at which the axes of
the thesis end. In the third the elements were given more, and in the last one it was measured at a frequency of its own."""

LATENCIES = (0, 1, 2)

DIFFERENCE = 0.02
"""Of finite differences, as a share of the range: the limit cycles of a hard dead zone are not smooth below that."""

COVERING, STARTS, SAMPLES = 64, 2, 8
"""Points of the box from which fits of quick experiments start, and how many do; points of the steps by latency and form."""

STEPS_EVALUATIONS = 10

SHARPER = 4
"""Power of the residuals, by which least squares approximates the smallest possible largest residual."""


class Fit(NamedTuple):
    """Fitted machine, its predictions, and residuals (n,) in the order of the predictions."""

    machine: Machine
    predicted: dict[str, float]
    residuals: np.ndarray

    @property
    def largest(self) -> float:
        """Largest absolute residual."""
        return float(np.abs(self.residuals).max())

    @property
    def cost(self) -> float:
        """Sum of the squares."""
        return float((self.residuals**2).sum())

    @property
    def worst(self) -> str:
        """Measurement with the largest residual."""
        return list(self.predicted)[int(np.abs(self.residuals).argmax())]


def evaluate(machine: Machine, experiments: Iterable[str] = EXPERIMENTS) -> Fit:
    """Return predictions and residuals of a machine."""
    predicted = predictions(machine, experiments)
    return Fit(machine, predicted, residuals(predicted))


def sample(names: Sequence[str], count: int, seed: int = 0) -> np.ndarray:
    """Return points (count, n) that cover the box of some parameters, each from 1 (low) to 2 (high)."""
    return 1.0 + qmc.Sobol(len(names), rng=seed).random(count)


def placed(machine: Machine, names: Sequence[str], point: np.ndarray) -> Machine:
    """Return the machine with parameters at a point of :func:`sample`."""
    boxes = [BOX[name] for name in names]
    values = [box.low + (at - 1.0) * (box.high - box.low) for box, at in zip(boxes, point.tolist(), strict=True)]
    return replace(machine, **dict(zip(names, values, strict=True)))


def point_of(machine: Machine, names: Sequence[str]) -> np.ndarray:
    """Return the point (n,) of a machine, the inverse of :func:`placed`; parameters outside of the box are moved into it."""
    point = []
    for name in names:
        value, box = getattr(machine, name), BOX[name]
        point.append(1.5 if value is None else 1.0 + (value - box.low) / (box.high - box.low))
    return np.clip(point, 1.01, 1.99)


def fit(
    start: Machine,
    names: Sequence[str],
    experiments: Sequence[str] = EXPERIMENTS,
    *,
    power: int = 1,
    evaluations: int = 20,
) -> Fit:
    """Return the least-squares fit from a start.

    Args:
        start: also gives all parameters that are not fitted.
        names: of fitted parameters.
        experiments: that are fitted.
        power: of the residuals; :data:`SHARPER` minimises the largest one rather than the sum of squares.
        evaluations: most steps.
    """

    def misfit(point: np.ndarray) -> np.ndarray:
        off = evaluate(placed(start, names, point), experiments).residuals
        return np.sign(off) * np.abs(off) ** power

    best = least_squares(
        misfit, point_of(start, names), bounds=(1.0, 2.0), diff_step=DIFFERENCE / 1.5, max_nfev=evaluations, xtol=1e-4,
        ftol=1e-4,
    )  # fmt: skip
    return evaluate(placed(start, names, best.x), experiments)


def best_of(start: Machine, names: Sequence[str], experiments: Sequence[str], count: int) -> list[Fit]:
    """Return ``count`` points that cover the whole box, those of the smallest sum of squares first."""
    fits = [evaluate(placed(start, names, point), experiments) for point in sample(names, count)]
    return sorted(fits, key=lambda fit: fit.cost)


QUICK = ("friction", "steady", "top speed")
"""Experiments that take milliseconds to simulate."""


def quick_fit(model: Model, experiments: Sequence[str] = QUICK, sharpest: bool = False, **fixed: float) -> Fit:
    """Return the best of several fits to experiments among :data:`QUICK`.

    Args:
        model: hypothesis.
        experiments: that are fitted.
        sharpest: minimise the largest residual rather than the sum of squares.
        **fixed: values of parameters that are not fitted.
    """
    names = [name for name in model.names if name not in fixed]
    starts = best_of(replace(model.start, **fixed), names, experiments, COVERING)[:STARTS]
    best = min((fit(start.machine, names, experiments) for start in starts), key=lambda fitted: fitted.cost)
    if not sharpest or best.largest <= 1.0:
        return best
    sharp = fit(best.machine, names, experiments, power=SHARPER, evaluations=40)
    return min(best, sharp, key=lambda fitted: fitted.largest)


def steps_start() -> Fit:
    """Return the best sample of the steps over latencies and forms of the dead zone, with nominal friction and table."""
    nominal = [Machine(form=form, latency=latency) for form, latency in product(FORMS, LATENCIES)]
    samples = [best_of(start, OF_STEPS, ("steps",), SAMPLES)[0] for start in nominal]
    return min(samples, key=lambda fitted: fitted.cost)


def full_fit(model: Model, start: Machine, experiments: Sequence[str] = EXPERIMENTS) -> Fit:
    """Return the fit to experiments that include the steps.

    Args:
        model: hypothesis.
        start: gives the parameters of the steps, latency and form of the dead zone; the other experiments give those of
            friction and table.
        experiments: that are fitted.
    """
    others = [name for name in experiments if name in QUICK]
    machine = quick_fit(model, others).machine if others else model.start
    taken = {name: getattr(start, name) for name in (*OF_STEPS, "form", "latency")}
    return fit(replace(machine, **taken), (*model.names, *OF_STEPS), experiments, evaluations=STEPS_EVALUATIONS)


def stored(name: str, folder: Path, make: Callable[[], Fit], experiments: Sequence[str]) -> Fit:
    """Return a fit, from its file if there is one; print its result."""
    path = folder / f"{name}.json"
    if path.exists():
        fit = evaluate(Machine(**json.loads(path.read_text(encoding="utf-8"))), experiments)
    else:
        fit = make()
        write_atomically(path, json.dumps(asdict(fit.machine)))
    print(f"{name}: {fit.largest:.2f} ({fit.worst})", flush=True)
    return fit


SUBSETS: tuple[tuple[str, ...], ...] = (
    ("friction",), ("steady",), ("top speed",), ("steady", "top speed"), ("friction", "top speed"), QUICK,
)  # fmt: skip
GAINS = (0.8, 0.9, 1.0)


def subset_table(fits: Mapping[str, Fit], steps: Fit, folder: Path) -> list[list[str]]:
    """Return rows of the largest residual by fitted experiments and hypothesis.

    Args:
        fits: to all experiments.
        steps: fit of constant friction to the steps alone, which all hypotheses contain.
        folder: of stored fits.
    """
    models = [name for name in MODELS if name != "frequency"]
    rows = []
    for experiments, gain in [*((subset, None) for subset in SUBSETS), *((QUICK, gain) for gain in GAINS)]:
        fixed = {} if gain is None else {"gain": gain}
        label = ", ".join(experiments) + ("" if gain is None else f", gain {gain:g}")
        cells = []
        for name in models:
            if gain is not None and name != "weak":  # fails with any gain
                cells.append("–")
                continue
            key = f"{name}-{label.replace(', ', '-').replace(' ', '_')}"
            make = partial(quick_fit, MODELS[name], experiments, True, **fixed)
            cells.append(largest_text(stored(key, folder, make, experiments)))
        rows.append([label, *cells])
    rows.append(["steps", largest_text(steps), *("at most as much" for _ in models[1:])])
    squeezed = [largest_text(evaluate(fits[name].machine, ("squeeze",))) for name in models]
    rows.append(["squeeze (not fitted)", *squeezed])
    rows.append(["all", *(largest_text(fits[name]) for name in models)])
    return rows


def largest_text(fit: Fit) -> str:
    """Return the largest residual, and its measurement where it is above 1."""
    return f"{fit.largest:.1f}" + (f" ({MEASUREMENTS[fit.worst].what})" if fit.largest > 1.0 else "")


def measurement_table(fits: Sequence[Fit]) -> list[list[str]]:
    """Return a row per measurement: value of the thesis, and value and residual of each machine."""
    rows = []
    for name, measured in MEASUREMENTS.items():
        values = [fit.predicted[name] for fit in fits]
        cells = [f"{value:.3g} ({measured.residual(value):+.1f})" for value in values]
        rows.append([f"{measured.what} ({measured.source}; {measured.kind})", measured.text(), *cells])
    rows.append(["largest residual", "1", *(f"{fit.largest:.1f}" for fit in fits)])
    rows.append(["sum of squares", "", *(f"{fit.cost:.1f}" for fit in fits)])
    return rows


def parameter_table(machines: Sequence[Machine]) -> list[list[str]]:
    """Return a row per parameter: its range, and the value of each machine."""

    def cell(name: str, machine: Machine) -> str:
        value, box = getattr(machine, name), BOX[name]
        if value is None or (name in ("speed", "shape") and machine.rise == 0.0):
            return "–"
        return f"{box.scale * value:.3g} {box.unit}".strip()

    rows = []
    for name, box in BOX.items():
        limits = f"{box.scale * box.low:g} to {box.scale * box.high:g} {box.unit}".strip()
        rows.append(
            [f"{name.replace('_', ' ')} ({box.source})", limits, *(cell(name, machine) for machine in machines)]
        )
    rows.append(["form of the dead zone", ", ".join(FORMS), *(machine.form for machine in machines)])
    latencies = ", ".join(map(str, LATENCIES))
    rows.append(["further latency, periods", latencies, *(str(machine.latency) for machine in machines)])
    return rows


def main() -> None:
    """Fit and print; with ``--keep`` write the tables of the documentation."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    argument(parser)
    parser.add_argument(
        "--output", type=Path, default=Path("runs/thesis-machine"), help="stored fits, reused if present"
    )
    arguments = parser.parse_args()
    folder = output_directory(arguments.output)
    nominal = evaluate(Machine())
    start = stored("start", folder, steps_start, ("steps",)).machine
    # First the one whose top speed does not distort the fit of the steps: the others start from these.
    first = stored("frequency", folder, partial(full_fit, MODELS["frequency"], start), EXPERIMENTS)
    fits = {
        name: first
        if name == "frequency"
        else stored(name, folder, partial(full_fit, model, first.machine), EXPERIMENTS)
        for name, model in MODELS.items()
    }
    make = partial(full_fit, MODELS["constant"], fits["constant"].machine, ("steps",))
    steps = stored("constant-steps", folder, make, ("steps",))
    labels = ("nominal", *(model.label for model in MODELS.values()))
    machines = [nominal, *fits.values()]
    rows = (
        measurement_table(machines),
        parameter_table([fit.machine for fit in machines]),
        subset_table(fits, steps, folder),
    )
    show("thesis-machine", ("measurement", "thesis", *labels), rows[0], arguments.keep)
    show("thesis-machine-parameters", ("parameter", "range", *labels), rows[1], arguments.keep)
    show("thesis-machine-subsets", ("fitted experiments", *labels[1:4]), rows[2], arguments.keep)


if __name__ == "__main__":
    main()
