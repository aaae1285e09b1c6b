"""``python -m vibgym identify LOG``: page and settings file of a fit."""

from __future__ import annotations

import argparse
import html
import sys
from collections.abc import Iterable, Sequence
from io import StringIO
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.config import json_values
from vibgym.files import output_directory, write_together
from vibgym.identification.fit import fit
from vibgym.identification.log import Log
from vibgym.identification.outcome import Fitted

UNITS: dict[str, tuple[float, str]] = {
    "frequency": (1.0, "Hz"), "horizontal_amplitude": (1e3, "mm"), "dead_zone": (1e3, "mm"), "phase": (np.degrees(1.0), "deg"),
    "phase_spread": (np.degrees(1.0), "deg"), "camera_turn": (np.degrees(1.0), "deg"), "camera_x": (1e3, "mm"),
    "camera_y": (1e3, "mm"), "noise_position": (1e3, "mm"), "noise_heading": (np.degrees(1.0), "deg"),
    "max_amplitude": (1e3, "mm"), "latency": (1.0, "periods"), "rise_speed": (1.0, "m/s"),
}  # fmt: skip
"""Factor and unit of printed values."""

WIDTH, HEIGHT, MARGIN = 760, 190, 46
"""Size of a diagram, pixels."""

STYLE = """body{font:16px/1.5 system-ui,sans-serif;max-width:52rem;margin:2rem auto;padding:0 1rem}
body{color:#1b1b1b;background:#fff}
table{border-collapse:collapse}td,th{padding:.15rem .7rem;border-bottom:1px solid #ddd;text-align:right}
th:first-child,td:first-child{text-align:left}.wide{overflow-x:auto}svg{width:100%;height:auto}small{color:#444}"""


def identify(arguments: argparse.Namespace) -> int:
    """Fit the recording, print the result, and write both files; returns the exit code."""
    log = Log.load(arguments.log)
    folder = output_directory(arguments.output or arguments.log.parent)
    report = None if arguments.quiet else lambda line: print(line, file=sys.stderr, flush=True)
    with checks.within(arguments.log, kind=checks.Refused):
        fitted = fit(log, report=report, force=arguments.force)
    title = f"Identification of {arguments.log.name}"
    write_together({folder / "identified.html": page(fitted, title), folder / "machine.yaml": settings_text(fitted)})
    for name, value, between, unit in rows(fitted):
        print(f"{name:<28}{value:>12} {unit:<8}{between}")
    for name, advice in fitted.unidentified.items():
        print(f"not identified: {name} ({advice})")
    for note in fitted.notes:
        print(note)
    print(f"written: {folder / 'identified.html'}, {folder / 'machine.yaml'}")
    return 0


def rows(fitted: Fitted) -> list[list[str]]:
    """Return name, value, 95 % interval and unit of all values, as text."""
    lines = []
    for name, value in fitted.values.items():
        factor, unit = UNITS.get(name, (1.0, ""))
        low, high = fitted.intervals.get(name, (None, None))
        between = "" if low is None or high is None else f"{factor * low:.6g} to {factor * high:.6g}"
        lines.append([name, value if isinstance(value, str) else f"{factor * value:.6g}", between, unit])
    return lines


def settings_text(fitted: Fitted) -> str:
    """Return YAML with ``surface``, ``actuators``, ``parts`` and ``sensor``, as keyword arguments of environments."""
    from ruamel.yaml import YAML

    noise = {"position": fitted.values["noise_position"], "heading": fitted.values["noise_heading"]}
    settings = {
        "surface": fitted.surface,
        "actuators": {**fitted.actuators, "compensate": True},
        "parts": list(fitted.parts),
        "sensor": {"kind": "pose", "noise": noise},
    }
    yaml, text = YAML(), StringIO()
    yaml.default_flow_style, yaml.width = None, 120
    yaml.dump(json_values(settings), text)
    return text.getvalue()


def page(fitted: Fitted, title: str) -> str:
    """Return the page as HTML, in one file without scripts."""
    residuals = fitted.residuals
    pairs = [(a, b, value) for (a, b), value in fitted.correlation.items() if a < b and np.isfinite(value)]
    coupled = sorted(pairs, key=lambda pair: -abs(pair[2]))[:8]
    body = [
        f"<h1>{html.escape(title)}</h1>",
        "<h2>Values</h2>",
        _table(("parameter", "value", "95 % interval", "unit"), rows(fitted)),
        "<h2>Not identified</h2>",
        _table(("parameter", "recording that would identify it"), fitted.unidentified.items()),
        "<h2>Largest correlations</h2>",
        _table(("pair", "correlation"), ((f"{a}, {b}", f"{value:+.3f}") for a, b, value in coupled)),
        "<h2>Alternatives</h2>",
        _table(("hypothesis", "chi squared above the best"), ((k, f"{v:.1f}") for k, v in fitted.alternatives.items())),
        "<h2>Residuals over time</h2>",
        "<p>Measured less predicted position of each image, along x (blue) and y (orange). Structure that is larger than the "
        "noise is what the model does not describe.</p>",
        _over_time(residuals),
        "<h2>Residuals over the table</h2>",
        "<p>Root mean square of both components by element, mm.</p>",
        _over_table(fitted, _by_element(fitted)),
        "<h2>Gain of the elements</h2>",
        "<p>Relative to the common gain, in percent. Grey: not visited long enough.</p>",
        _over_table(fitted, np.where(_known(fitted), 100.0 * fitted.elements[..., 0], np.nan)),
        "<h2>Recording</h2>",
        "<ul>" + "".join(f"<li>{html.escape(note)}</li>" for note in fitted.notes) + "</ul>",
    ]
    head = (
        f'<meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>{html.escape(title)}</title>'
    )
    start = f'<!doctype html><html lang="en"><head>{head}<style>{STYLE}</style></head>'
    return f"{start}<body><main>{''.join(body)}</main></body></html>\n"


def _known(fitted: Fitted) -> np.ndarray:
    """Return (rows, columns) whether an element's gain is known better than its prior."""
    return fitted.element_deviations[..., 0] < 0.8 * fitted.values["gain_spread"]


def _table(heads: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """Return a table."""
    head = "".join(f'<th scope="col">{html.escape(title)}</th>' for title in heads)
    cells = ("".join(f"<td>{html.escape(str(cell))}</td>" for cell in line) for line in lines)
    return f'<div class="wide" tabindex="0"><table><tr>{head}</tr>{"".join(f"<tr>{row}</tr>" for row in cells)}</table></div>'


def _over_time(residuals: np.ndarray) -> str:
    """Return a scatter diagram of residuals (mm) over cycles."""
    cycle, most = residuals[:, 0], max(float(np.abs(residuals[:, 4:]).max()) * 1e3, 1e-6)
    first, last = float(cycle.min()), float(cycle.max())

    def at(time: Any, value: Any) -> tuple[Any, Any]:
        x = MARGIN + (WIDTH - MARGIN - 8) * (time - first) / max(last - first, 1.0)
        return x, 0.5 * (HEIGHT - 24) * (1.0 - value / most) + 4

    parts = [_svg(WIDTH, HEIGHT, "Residuals of all images over time, in millimetres")]
    for value in (-most, 0.0, most):
        _, y = at(first, value)
        parts.append(f'<line x1="{MARGIN}" x2="{WIDTH - 8}" y1="{y:.1f}" y2="{y:.1f}" stroke="#bbb"/>')
        parts.append(f'<text x="2" y="{y + 4:.1f}" font-size="11">{value:.3g}</text>')
    for column, colour in ((4, "#1f4e79"), (5, "#e08a1e")):
        x, y = at(cycle, 1e3 * residuals[:, column])
        dots = "".join(f"M{a:.1f} {b:.1f}h.01" for a, b in zip(x.tolist(), y.tolist(), strict=True))
        parts.append(f'<path d="{dots}" stroke="{colour}" stroke-width="1.6" stroke-linecap="round"/>')
    parts.append(f'<text x="{MARGIN}" y="{HEIGHT - 4}" font-size="11">cycle {first:.0f}</text>')
    parts.append(f'<text x="{WIDTH - 8}" y="{HEIGHT - 4}" font-size="11" text-anchor="end">{last:.0f}</text></svg>')
    return "".join(parts)


def _by_element(fitted: Fitted) -> np.ndarray:
    """Return (rows, columns) the root mean square of the residuals of images by the element at the part's centre, mm."""
    surface, residuals = fitted.surface, fitted.residuals
    column = np.clip(residuals[:, 2] // surface.element_size, 0, surface.columns - 1).astype(int)
    row = np.clip(residuals[:, 3] // surface.element_size, 0, surface.rows - 1).astype(int)
    total, count = np.zeros((2, surface.rows, surface.columns))
    np.add.at(total, (row, column), 0.5 * (residuals[:, 4:] ** 2).sum(axis=1))
    np.add.at(count, (row, column), 1.0)
    return 1e3 * np.sqrt(np.where(count > 0.0, total / np.maximum(count, 1.0), np.nan))


def _over_table(fitted: Fitted, values: np.ndarray) -> str:
    """Return a map of the surface, y upwards; NaN is grey."""
    side = WIDTH / fitted.surface.columns
    known = values[np.isfinite(values)]
    least, most = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    parts = [_svg(WIDTH, side * fitted.surface.rows + 20, f"Map of the surface, from {least:.3g} to {most:.3g}")]
    for (row, column), value in np.ndenumerate(values):
        fill = "#ddd" if np.isnan(value) else _colour((value - least) / max(most - least, 1e-12))
        x, y = column * side, (fitted.surface.rows - 1 - row) * side
        parts.append(f'<rect x="{x:.1f}" y="{y:.1f}" width="{side:.1f}" height="{side:.1f}" fill="{fill}">')
        parts.append(f"<title>row {row}, column {column}: {value:.3g}</title></rect>")
    y = side * fitted.surface.rows + 15
    parts.append(f'<text x="0" y="{y:.0f}" font-size="12">from {least:.3g} (light) to {most:.3g} (dark)</text></svg>')
    return "".join(parts)


def _colour(share: float) -> str:
    """Return a colour from light (0) to dark (1)."""
    return f"rgb({255 - 200 * share:.0f},{250 - 150 * share:.0f},{240 - 60 * share:.0f})"


def _svg(width: float, height: float, label: str) -> str:
    return f'<svg viewBox="0 0 {width:.0f} {height:.0f}" role="img" aria-label="{html.escape(label)}" fill="#1b1b1b">'
