"""An independent reference for parts that rock and tilt: a rigid body on many stiff compliant contact points.

It shares no code with the models of :mod:`vibgym.physics`. ``python -m studies.accuracy.rigid`` measures and stores its
figures, which the accuracy report shows.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

PLACE = Path(__file__).with_name("figures.json")


def stored(place: Path = PLACE) -> dict[str, Any]:
    """Return all stored figures, by study; empty if there are none yet."""
    return json.loads(place.read_text(encoding="utf-8")) if place.exists() else {}
