"""What is no longer as it was when results were published, each in one line."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from agents.evaluation.settings import load_settings
from agents.evaluation.verification.published import FIGURE_FILE, RECORD, Published, canonical, written_settings
from agents.evaluation.verification.published_figures import figure_rows, place_of
from agents.provenance import commit, digest, versions

MOST = 5
"""Lines on one file: where all its figures are others, a few will do."""


def differences(published: Published) -> list[str]:
    """Files, settings and figures that are not those that were published; nothing is run."""
    return [*_edited(published), *_figures(published), *_settings(published), *_policies(published)]


def versions_apart(published: Published) -> list[str]:
    """Versions and commit, where they differ: no fault, but the place to look if figures do."""
    then, now = dict(published.record["versions"]), versions()
    then["commit"], now["commit"] = published.record.get("commit"), commit()
    names = [name for name in {**then, **now} if then.get(name) != now.get(name)]
    return [f"{name} {then.get(name) or 'none'}, here {now.get(name) or 'none'}" for name in names]


def settings_apart(one: Mapping[str, Any], other: Mapping[str, Any]) -> list[str]:
    """Names of the settings that differ; of policies also which."""
    named = {}
    for key in {**one, **other}:
        if one.get(key) != other.get(key):
            named[key] = key
            if key == "policies":
                first, second = (_by_name(each.get(key)) for each in (one, other))
                apart = [name for name in {**first, **second} if first.get(name) != second.get(name)]
                named[key] = f"policies ({', '.join(apart) or 'their order'})"
    return list(named.values())


def _by_name(policies: Any) -> Mapping[str, Any]:
    return policies if isinstance(policies, Mapping) else {each["name"]: each for each in policies or ()}


def _edited(published: Published) -> list[str]:
    """Files whose digests are others than the record says."""
    said = published.record["digests"]
    found = [
        f"{published.directory / name}: edited since it was published"
        for name, now in published.digests.items()
        if said["files"].get(name) != now
    ]
    if digest(canonical(published.record["settings"])) != said["settings"]:
        found.append(f"{published.directory / RECORD}: settings: edited since they were published")
    return found


def _figures(published: Published) -> list[str]:
    """Figures that do not follow from the published episodes."""
    path, found = published.directory / FIGURE_FILE, []
    follow = {(place_of(row), row["figure"]): row["value"] for row in figure_rows(published.episodes)}
    for (place, name), value in follow.items():
        stands = published.figures.get((place, name))
        # The last digit of a sum depends on how a library adds up.
        if stands is None or not math.isclose(stands, value, rel_tol=1e-9, abs_tol=1e-12):
            says = "is missing" if stands is None else f"is {stands:g}"
            found.append(f"{path}: {place}: {name} {says}; {value:g} follows from the episodes")
    for place, name in published.figures:
        if (place, name) not in follow:
            found.append(f"{path}: {place}: {name} comes from no published episodes")
    return found if len(found) <= MOST else [*found[:MOST], f"{path}: {len(found) - MOST} further figures"]


def _settings(published: Published) -> list[str]:
    """Whether the file of settings still asks for what was published."""
    path = Path(str(published.record.get("config")))
    try:
        now = written_settings(load_settings(path))
    except ValueError as error:
        return [str(error)]
    apart = settings_apart(published.record["settings"], now)
    return [f"{path}: asks for other {each}" for each in apart]


def _policies(published: Published) -> list[str]:
    """Files of policies that are others now."""
    said = published.record["digests"]["policies"]
    found = []
    for path, before in said.items():
        try:
            now = digest(Path(path).read_bytes())
        except (OSError, ValueError):
            now = None
        if now != before:
            found.append(f"{path}: {'gone' if now is None else 'another file'} since results were published")
    return found
