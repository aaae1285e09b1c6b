"""A verification as text: a line for every policy in every place, and what is not as published."""

from __future__ import annotations

from agents.evaluation.quantities import BY_NAME
from agents.evaluation.tables import markdown, quantity
from agents.evaluation.verification.published_figures import Place
from agents.evaluation.verification.verify import ALPHA, VALUES, Checked, Verification
from vibgym.files import csv_text

FIRST = ("success_rate", "time_to_goal_median_s")
"""Figures with a column of their own; of the others the table says how many lie in their intervals."""


def report_of(found: Verification) -> str:
    """What is printed: the table, what differs, and the verdict."""
    record, outside = found.published.record, [each for each in found.checked if not each.inside]
    lines = [f"published {record.get('time')}, commit {record.get('commit')}"]
    if found.checked:
        lines += ["", table(found), ""]
    lines += [f"outside: {_sentence(each)}" for each in outside]
    lines += [f"different: {each}" for each in found.different]
    lines += [f"version: {each}" for each in found.versions]
    same, played = (sum(each[k] for each in found.again.values()) for k in (0, 1))
    if played:
        lines.append(f"{same} of {played} published episodes came out the same when played again")
    lines.append(f"{len(found.checked) - len(outside)} of {len(found.checked)} figures lie in their intervals")
    lines[-1] += f" (by chance all do with {100 * (1 - ALPHA):g} %, each with 1 - {found.alpha:.1e})"
    lines.append("verified" if found.holds else "not verified")
    return "\n".join(lines)


def figures_csv(found: Verification) -> str:
    """All figures with their intervals; a header alone where nothing was played."""
    if not found.checked:
        return ",".join((*Place._fields, "figure", *VALUES)) + "\n"
    return csv_text([each.as_row() for each in found.checked])


def table(found: Verification) -> str:
    """In Markdown: each figure with the interval in which it should lie."""
    by_place: dict[Place, dict[str, Checked]] = {}
    for each in found.checked:
        by_place.setdefault(each.place, {})[each.figure.name] = each
    shown = [BY_NAME[name].label for name in FIRST]
    heads = ("task", "hardware", "policy", *shown, "figures inside", "again the same")
    lines = []
    for place, those in by_place.items():
        inside = sum(each.inside for each in those.values())
        same, played = found.again[place]
        cells = [_cell(those.get(name)) for name in FIRST]
        names = place.task, place.hardware, place.policy
        lines.append([*names, *cells, f"{inside} of {len(those)}", f"{same} of {played}"])
    return markdown(heads, lines)


def _cell(each: Checked | None) -> str:
    return "–" if each is None else f"{_written(each, each.found)} in {_between(each)}"


def _sentence(each: Checked) -> str:
    said = f"{_written(each, each.found)} of {each.episodes} episodes, published {_written(each, each.published)}"
    return f"{each.place}: {each.figure.label} {said}, should lie in {_between(each)}"


def _between(each: Checked) -> str:
    return f"{_written(each, each.low, False)} to {_written(each, each.high)}"


def _written(each: Checked, value: float, unit: bool = True) -> str:
    figure = each.figure
    return quantity(value, figure.factor, figure.digits, figure.unit if unit else "").rstrip()
