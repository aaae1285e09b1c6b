"""``python -m studies.tilting NAME``: prints a study's table."""

from __future__ import annotations

import sys

from studies.tilting import cost, endurance, energy, fields, hold, housner, kick, landing, means, transport
from vibgym import checks

STUDIES = {
    "kick": kick.main,
    "landing": landing.main,
    "fields": fields.main,
    "means": means.main,
    "hold": hold.main,
    "endurance": endurance.main,
    "energy": energy.main,
    "cost": cost.main,
    "housner": housner.main,
    "transport": transport.main,
}
"""By name."""


def main() -> None:
    """Run the study that is named."""
    if len(sys.argv) != 2 or sys.argv[1] not in STUDIES:
        raise SystemExit(str(checks.refuse("NAME", " ".join(sys.argv[1:]), f"one of {', '.join(STUDIES)}")))
    STUDIES[sys.argv[1]]()


if __name__ == "__main__":
    main()
