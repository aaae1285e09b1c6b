"""``python -m studies.tilting NAME``: prints a study's table."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from agents import command_line
from studies.tilting import (
    cost,
    energy,
    fields,
    hold,
    housner,
    kick,
    landing,
    means,
    transport,
)
from vibgym import checks

STUDIES = {
    "kick": kick.main,
    "landing": landing.main,
    "fields": fields.main,
    "means": means.main,
    "hold": hold.main,
    "energy": energy.main,
    "cost": cost.main,
    "housner": housner.main,
    "transport": transport.main,
}
"""By name."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study that is named; return the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    if len(words) != 1 or words[0] not in STUDIES:
        print(checks.refuse("NAME", " ".join(words), f"one of {', '.join(STUDIES)}"), file=sys.stderr)
        return 2

    def work() -> int:
        STUDIES[words[0]]()
        return 0

    return command_line.guarded("python -m studies.tilting", work)


if __name__ == "__main__":
    sys.exit(main())
