"""Identification of hidden machines: ``python -m studies.benchmarks.identification [--machines 10] [--first 0]``.

Each machine has all of its parameters drawn at random. It records two minutes of :class:`vibgym.identification.Excitation` with
one part, whose nominal properties are the prototype's, and the fit knows these only. Results are stored one file a machine in
``--output`` and reused, so several processes can share the machines; the table has all machines that were asked for. With
``--stribeck`` friction depends on the speed of the slip, and the table has its rise instead of the claims on constant friction.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from studies import common
from studies.kept import show
from vibgym.config import json_values
from vibgym.files import output_directory
from vibgym.identification import Camera, Excitation, Log, fit, record
from vibgym.identification.law import applied
from vibgym.scene.parts import Part, shipped_part
from vibgym.scene.surface import Surface

NOMINAL = Surface(max_amplitude=0.35e-3)
"""Below lift-off at all frequencies drawn."""

PARTS = ("aluminium_block",)

FINE = {"steps": 20, "substeps": 4}
"""Time steps of the machines: finer than those of the fit, which then has an error of its own."""

TARGETS = {"friction": 2.0, "horizontal_amplitude": 1.0, "dead_zone": 10.0, "elements": 3.0}
"""Percent."""


class Machine(NamedTuple):
    """A machine: true surface, parts, actuators and camera, and all true values by the names of the fit."""

    surface: Surface
    parts: list[Part]
    actuators: dict[str, Any]
    camera: Camera
    truth: dict[str, Any]


def drawn(seed: int, stribeck: bool = False) -> Machine:
    """Return a random machine; ``stribeck``: with friction that falls with the speed of the slip."""
    rng = np.random.default_rng([seed, 39])
    surface = replace(NOMINAL, horizontal_amplitude=rng.uniform(2.3e-3, 3.1e-3), frequency=rng.uniform(24.0, 26.0))
    parts = []
    for name in PARTS:
        friction = rng.uniform(0.4, 0.8)
        parts.append(replace(shipped_part(name), friction=friction, static_friction=friction))
    spreads = rng.uniform(0.02, 0.08), math.radians(rng.uniform(2.0, 8.0))
    shape = surface.rows, surface.columns
    elements = np.stack(
        [1.0 + spreads[0] * rng.standard_normal(shape), spreads[1] * rng.standard_normal(shape)], axis=-1
    )
    actuators = {
        "kind": "prototype", "gain_spread": 0.0, "phase_spread": 0.0, "elements": elements.tolist(),
        "gain": rng.uniform(0.8, 1.1), "phase": rng.uniform(-0.6, 0.6), "dead_zone": rng.uniform(0.05e-3, 0.15e-3),
        "dead_zone_form": str(rng.choice(["hard", "soft", "cubic"])), "latency": int(rng.integers(0, 4)),
    }  # fmt: skip
    camera = Camera(
        scale=rng.uniform(0.98, 1.02), turn=math.radians(rng.uniform(-1.0, 1.0)), x=rng.uniform(-5e-3, 5e-3),
        y=rng.uniform(-5e-3, 5e-3), noise_position=rng.uniform(0.1e-3, 0.4e-3),
        noise_heading=math.radians(rng.uniform(0.1, 0.4)), dropout=rng.uniform(0.0, 0.05),
    )  # fmt: skip
    law: dict[str, Any] = {"friction_law": "constant"}
    if stribeck:
        rise, speed = rng.uniform(0.1, 0.6), rng.uniform(0.1, 0.4)
        parts = [applied(part, {"kind": "stribeck", "rise": rise, "speed": speed}) for part in parts]
        law = {"friction_law": "stribeck", "rise": rise, "rise_speed": speed}
    truth = {
        **law,
        **{"friction" if len(parts) == 1 else f"friction.{part.name}": part.friction for part in parts},
        **{name: getattr(surface, name) for name in ("horizontal_amplitude", "frequency")},
        **{name: actuators[name] for name in ("gain", "phase", "dead_zone", "dead_zone_form", "latency")},
        "gain_spread": spreads[0], "phase_spread": spreads[1],
        **{f"camera_{name}": getattr(camera, name) for name in ("scale", "turn", "x", "y")},
        **{name: getattr(camera, name) for name in ("noise_position", "noise_heading")},
    }  # fmt: skip
    return Machine(surface, parts, actuators, camera, truth)


def recorded(machine: Machine, seed: int, seconds: float) -> Log:
    """Return the recording of a machine, with nominal settings."""
    nominal = [shipped_part(name) for name in PARTS]
    settings = {"surface": NOMINAL, "actuators": "prototype", "parts": [part.to_dict() for part in nominal]}
    return record(
        machine.surface, machine.parts, machine.actuators, machine.camera, seconds=seconds, seed=seed, settings=settings,
        excitation=Excitation(NOMINAL, nominal, seed), **FINE,
    )  # fmt: skip


def result(seed: int, seconds: float, stribeck: bool = False) -> dict[str, Any]:
    """Return what was estimated of a machine, and the truth."""
    machine = drawn(seed, stribeck)
    log = recorded(machine, seed, seconds)
    began = time.process_time()
    fitted = fit(log, force=True)
    took = time.process_time() - began
    true = np.array(machine.actuators["elements"])
    gain = fitted.values["gain"] * (1.0 + fitted.elements[..., 0]) / (machine.truth["gain"] * true[..., 0]) - 1.0
    known = fitted.element_deviations[..., 0] < 0.8 * fitted.values["gain_spread"]
    turn = fitted.values["phase"] + fitted.elements[..., 1] - machine.truth["phase"] - true[..., 1]
    return json_values({
        "seed": seed, "truth": machine.truth, "values": fitted.values, "intervals": fitted.intervals, "cpu": took,
        "elements": 100.0 * float(np.sqrt(np.mean(gain[known] ** 2))) if known.any() else math.nan, "known": int(known.sum()),
        "turns": math.degrees(float(np.sqrt(np.mean(turn[known] ** 2)))) if known.any() else math.nan,
        "unidentified": fitted.unidentified, "alternatives": fitted.alternatives,
    })  # fmt: skip


def stored(seed: int, seconds: float, folder: Path, stribeck: bool = False) -> dict[str, Any]:
    """Return the result of a machine, from its file if there is one."""
    path = folder / f"{seed}-{seconds:g}{'-stribeck' if stribeck else ''}.json"
    return common.stored(path, lambda: result(seed, seconds, stribeck))


ROWS: dict[str, tuple[float | None, str, str]] = {
    "friction": (None, "%", "friction"),
    "rise": (1.0, "", "rise of friction at rest"),
    "rise_speed": (None, "%", "speed over which friction falls"),
    "horizontal_amplitude": (None, "%", "horizontal amplitude"),
    "gain": (None, "%", "common gain"),
    "phase": (math.degrees(1.0), "deg", "common phase"),
    "dead_zone": (None, "%", "dead zone"),
    "gain_spread": (None, "%", "spread of gains"),
    "phase_spread": (None, "%", "spread of phases"),
    "camera_scale": (None, "%", "scale of the camera"),
    "camera_turn": (math.degrees(1.0), "deg", "turn of the camera"),
    "camera_x": (1e3, "mm", "camera, x"),
    "camera_y": (1e3, "mm", "camera, y"),
    "noise_position": (None, "%", "noise of positions"),
    "noise_heading": (None, "%", "noise of headings"),
}
"""Factor of absolute errors (None: relative), unit and label of the rows."""


def compared(results: Sequence[dict[str, Any]]) -> pd.DataFrame:
    """Return a row for each value of each machine: name without the kind of part, error, its share of the truth in percent, and
    whether its interval has the truth (nan: no interval, or a dead zone of another form)."""
    rows = []
    for result in results:
        truth, values = result["truth"], result["values"]
        another = values["dead_zone_form"] != truth["dead_zone_form"]
        for key, true in truth.items():
            name = key.partition(".")[0]
            if name in ROWS and key in values:
                low, high = result["intervals"].get(key, (math.nan, math.nan))
                unknown = math.isnan(low) or (name == "dead_zone" and another)
                error = abs(values[key] - true)
                rows.append((name, error, 100.0 * error / abs(true), math.nan if unknown else low <= true <= high))
    return pd.DataFrame(rows, columns=["name", "error", "percent", "inside"])


def table(results: Sequence[dict[str, Any]]) -> list[list[str]]:
    """Return the rows of the table."""
    lines, values = [], compared(results)
    for name, (factor, unit, label) in ROWS.items():
        some = values[values["name"] == name]
        if some.empty:
            continue
        error = some["percent"] if factor is None else factor * some["error"]
        size = (f"{value:.2g} {unit}" for value in (np.sqrt(np.mean(error**2)), error.max()))
        target = f"{TARGETS[name]:g} {unit}" if name in TARGETS else ""
        lines.append([label, *size, target, f"{some['inside'].sum():.0f} of {some['inside'].count()}"])
    gains, turns = (np.array([result[name] for result in results]) for name in ("elements", "turns"))
    known = np.mean([result["known"] for result in results])
    lines.append(
        [f"gains of elements ({known:.0f} of 256)", f"{gains.mean():.2g} %", f"{gains.max():.2g} %", "3 %", ""]
    )
    lines.append(["phases of elements", f"{turns.mean():.2g} deg", f"{turns.max():.2g} deg", "", ""])
    labels = {
        "latency": "latency right",
        "dead_zone_form": "form of the dead zone right",
        "friction_law": "friction law right",
    }
    for name, label in labels.items():
        right = sum(result["values"][name] == result["truth"][name] for result in results)
        lines.append([label, f"{right} of {len(results)}", "", "all" if name == "latency" else "", ""])
    cpu, inside = np.array([result["cpu"] for result in results]), values["inside"]
    lines.append(["CPU time of a fit", f"{np.median(cpu):.0f} s", f"{cpu.max():.0f} s", "600 s", ""])
    share = f"{inside.sum():.0f} of {inside.count()} ({100 * inside.mean():.0f} %)"
    return [*lines, ["all intervals", "", "", "90 to 98 %", share]]


def main() -> None:
    """Identify machines and print the table; with ``--keep`` store it for the documentation."""
    parser = common.parser(__doc__)
    parser.add_argument("--machines", type=int, default=10)
    parser.add_argument("--first", type=int, default=0, help="seed of the first machine")
    parser.add_argument("--seconds", type=float, default=120.0, help="length of the recordings")
    parser.add_argument(
        "--stribeck", action="store_true", help="machines whose friction depends on the speed of the slip"
    )
    parser.add_argument("--output", type=Path, default=Path("runs/identification"), metavar="DIR")
    asked = parser.parse_args()
    folder = output_directory(asked.output)
    seeds = range(asked.first, asked.first + asked.machines)
    results = [stored(seed, asked.seconds, folder, asked.stribeck) for seed in seeds]
    heads = ("parameter", "rms error", "largest error", "target", "intervals with the truth")
    show("identification-stribeck" if asked.stribeck else "identification", heads, table(results), asked.keep)


if __name__ == "__main__":
    main()
