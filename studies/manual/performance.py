"""Tables and charts of docs/performance.md, from the figures that ``python -m studies.benchmarks.costs --keep`` stores."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Callable, Mapping
from typing import Any

from agents.evaluation.table import markdown
from studies.manual.figures_file import RESULTS

STORED = RESULTS / "performance.json"

CURVES = {
    "worlds": ("worlds", "us per world and step", "Rotate, action `element`"),
    "parts": ("parts", "us per part and period", "blocks 90 mm apart in one world, with walls"),
    "elements": ("elements under the part", "us per world and period", "a square part in each of 64 worlds"),
}
"""Heads of the columns, and the scene, of each curve."""

LINES = ("#12958d", "#d1572a")
"""Colours that have contrast on white and on black."""

INK = "#010203"
"""Stands for the colour of the text, which depends on the page."""


def generated() -> dict[str, str]:
    """Return tables and charts as Markdown, by name."""
    measured = json.loads(STORED.read_text(encoding="utf-8"))
    return {**tables(measured), **charts(measured), "provenance": _provenance(measured["about"])}


def _provenance(about: Mapping[str, Any]) -> str:
    at = "" if about["commit"] is None else f" at commit {about['commit'][:7]}"
    machine = f"{about['host']['processor']}, {about['host']['cores']} cores"
    versions = ", ".join(f"{name} {about['versions'][name]}" for name in ("numba", "gymnasium"))
    return (
        f"`{about['command']}`, {about['time'][:10]}{at}, {machine}, Python {about['versions']['python']}, {versions}. "
        f"Load of the host by other processes at the start: {about['load']:.1f}."
    )


# -- tables ------------------------------------------------------------------------------------------------------------


def tables(measured: Mapping[str, Any]) -> dict[str, str]:
    """Return the tables of measured figures, in Markdown, by name.

    Args:
        measured: figures of :mod:`studies.benchmarks.costs`, as read from JSON.
    """
    return {
        "limits": _limits(measured["roofline"]),
        "operations": _operations(measured["roofline"]),
        "stages": _stages(measured["stages"]),
        **{name: _curve(measured["curves"][name], *CURVES[name][:2]) for name in CURVES},
    }


def _limits(roofline: Mapping[str, float]) -> str:
    rate = roofline["flops"] / roofline["period"]
    rows = [
        ["multiplications and additions, in registers", f"{1e-9 * roofline['peak']:.1f} Gflop/s"],
        ["first cache, `a = b + c d`", f"{1e-9 * roofline['cache']:.0f} GB/s"],
        ["memory, `a = b + c d`", f"{1e-9 * roofline['memory']:.1f} GB/s"],
        ["kernel", f"{1e-9 * rate:.1f} Gflop/s, {100 * rate / roofline['peak']:.0f} % of the first line"],
        ["kernel, loads and stores", f"{1e-9 * roofline['cache_bytes'] / roofline['period']:.0f} GB/s"],
        ["kernel, from memory", f"{1e-9 * roofline['memory_bytes'] / roofline['period']:.2f} GB/s"],
        ["kernel, time", f"{1e6 * roofline['period']:.2f} us per world and period"],
    ]
    return markdown(["limit or use of one core", "measured"], rows)


def _operations(roofline: Mapping[str, float]) -> str:
    names = {
        "add": "additions, subtractions", "multiply": "multiplications", "divide": "divisions", "sqrt": "square roots",
        "select": "minima, maxima, selections", "compare": "comparisons", "load": "loads", "store": "stores",
    }  # fmt: skip
    rows = [[text, f"{roofline[kind]:,.0f}".replace(",", " ")] for kind, text in names.items()]
    rows += [
        ["floating-point operations (the first four)", f"{roofline['flops']:,.0f}".replace(",", " ")],
        ["operations per byte loaded or stored", f"{roofline['flops'] / roofline['cache_bytes']:.2f}"],
        ["operations per byte from memory", f"{roofline['flops'] / roofline['memory_bytes']:.0f}"],
    ]
    return markdown(["per world and period", "number"], rows)


def _stages(scenes: list[Mapping[str, Any]]) -> str:
    rows = []
    names = list(dict.fromkeys(stage for scene in scenes for stage in scene["stages"]))
    wholes = [sum(scene["stages"].values()) for scene in scenes]
    for stage in sorted(names, key=lambda stage: -max(scene["stages"].get(stage, 0.0) for scene in scenes)):
        spent = [scene["stages"].get(stage) for scene in scenes]
        cells = [
            "" if time is None else f"{time:.2f} ({100 * time / whole:.0f} %)"
            for time, whole in zip(spent, wholes, strict=True)
        ]
        rows.append([stage.replace("_", " "), *cells])
    rows.append(["step", *(f"{whole:.2f}" for whole in wholes)])
    rows.append(["of it, reading the clock", *(f"{scene['clock']:.2f}" for scene in scenes)])
    heads = [f"{scene['name'].removeprefix('vibgym/')}, `{scene['action']}`, {scene['worlds']}" for scene in scenes]
    return markdown(["stage, us per world and step", *heads], rows)


def _curve(curve: Mapping[str, list[list[float]]], size: str, unit: str) -> str:
    at = {threads: {x: y for x, y in points} for threads, points in curve.items()}
    rows = [
        [f"{x:g}", *(f"{points[x]:.3g}" for points in at.values()), f"{at['1'][x] / at['2'][x]:.2f}"] for x in at["1"]
    ]
    return markdown([size, f"{unit}, 1 thread", "2 threads", "ratio"], rows)


# -- charts ------------------------------------------------------------------------------------------------------------


def charts(measured: Mapping[str, Any]) -> dict[str, str]:
    """Return the charts as figures of HTML with inline SVG, in the colours of the page, by name and ``-chart``."""
    made = {f"{name}-chart": _drawn(name, _curve_chart(measured["curves"][name], *CURVES[name])) for name in CURVES}
    return {"roofline-chart": _drawn("roofline", _roofline_chart(measured["roofline"])), **made}


def _curve_chart(curve: Mapping[str, list[list[float]]], size: str, unit: str, scene: str) -> Callable[[Any], str]:
    def draw(axes: Any) -> str:
        for colour, mark, (threads, points) in zip(LINES, "os", curve.items(), strict=True):
            label = f"{threads} thread{'s' if threads != '1' else ''}"
            axes.loglog(*zip(*points, strict=True), color=colour, marker=mark, ms=4, lw=1.5, label=label)
        axes.set(xlabel=size, ylabel=unit)
        return f"{unit} against {size}, one and two threads: {scene}".replace("`", "")

    return draw


def _roofline_chart(roofline: Mapping[str, float]) -> Callable[[Any], str]:
    peak, rate = 1e-9 * roofline["peak"], 1e-9 * roofline["flops"] / roofline["period"]

    def draw(axes: Any) -> str:
        left, right = 0.02, 1000.0
        for colour, kind, name in zip(LINES, ("cache", "memory"), ("first cache", "memory"), strict=True):
            bandwidth = roofline[kind]
            ridge, at = peak / (1e-9 * bandwidth), roofline["flops"] / roofline[f"{kind}_bytes"]
            label = f"{name}, {1e-9 * bandwidth:.0f} GB/s"
            axes.loglog([left, ridge, right], [left * 1e-9 * bandwidth, peak, peak], color=colour, lw=1.8, label=label)
            axes.plot(at, rate, "o", color=colour, ms=7)
            axes.annotate(f"kernel, {kind}", (at, rate), (9, -4), textcoords="offset points", color=INK, fontsize=9)
        axes.annotate(
            f"{peak:.0f} Gflop/s", (right, peak), (0, 5), textcoords="offset points", ha="right", color=INK, fontsize=9
        )
        axes.set(xlabel="operations per byte", ylabel="Gflop/s", xlim=(left, right), ylim=(0.3, 3.0 * peak))
        return f"Roofline of one core: the kernel reaches {rate:.1f} of {peak:.0f} Gflop/s"

    return draw


def _drawn(name: str, draw: Callable[[Any], str]) -> str:
    """Return a chart as an HTML figure. ``draw`` fills axes and returns the alternative text."""
    import matplotlib as mpl
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator

    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": name, "text.color": INK, "font.size": 10}):
        figure = Figure(figsize=(7.0, 3.6), layout="constrained")
        axes = figure.subplots()
        described = draw(axes)
        axes.tick_params(colors=INK, which="both", labelcolor=INK)
        for side, spine in axes.spines.items():
            spine.set(visible=side in ("left", "bottom"), color=INK)
        for axis in (axes.xaxis, axes.yaxis):
            low, high = axis.get_view_interval()
            axis.set_major_locator(LogLocator(subs=(1.0,) if high > 300.0 * low else (1.0, 2.0, 5.0)))
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter("")
            axis.label.set_color(INK)
        axes.grid(color="#808080", alpha=0.3, lw=0.6)
        axes.legend(frameon=False, labelcolor=INK)
        file = io.StringIO()
        figure.savefig(file, format="svg", transparent=True, metadata={"Date": None})
    text = file.getvalue()
    text = re.sub(r"<metadata>.*?</metadata>", "", text[text.index("<svg") :], flags=re.DOTALL)
    text = re.sub(r'(id="|href="#|url\(#)', rf"\g<1>{name}-", text).replace(INK, "currentColor")
    text = re.sub(
        r'<svg ([^>]*?)width="[^"]*"([^>]*)>', rf'<svg role="img" aria-label="{described}" \1\2>', text, count=1
    )
    text = re.sub(r'(<svg [^>]*?)height="[^"]*" ', r"\1", text, count=1)
    text = re.sub(r"\s*\n\s*", " ", text)  # an empty line would end the block of HTML
    return f'<figure class="chart">{text}</figure>'
