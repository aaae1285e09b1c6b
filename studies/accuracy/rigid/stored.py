"""The stored figures of the reference: read by the accuracy report, written by ``python -m studies.accuracy.rigid``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

PLACE = Path(__file__).with_name("figures.json")


def load(place: Path = PLACE) -> dict[str, Any]:
    """All figures, by study; empty if there are none yet."""
    return json.loads(place.read_text()) if place.exists() else {}


def largest_gap(figures: dict[str, Any]) -> dict[str, Any]:
    """The line of random fields in which the planar model is farthest from the rigid part."""
    return max(figures["random_fields"]["rows"], key=lambda row: row["gap_mm"])
