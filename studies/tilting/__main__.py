"""``python -m studies.tilting NAME``: prints a study's table."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from vibgym import interrupts

interrupts.start_command()

from studies.tilting import (  # noqa: E402 - imports take seconds in which Ctrl-C is in hand already
    cost,
    endurance,
    energy,
    fields,
    hold,
    housner,
    kick,
    landing,
    means,
    transport,
)
from vibgym import checks  # noqa: E402

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


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study that is named; returns the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    if len(words) != 1 or words[0] not in STUDIES:
        print(checks.refuse("NAME", " ".join(words), f"one of {', '.join(STUDIES)}"), file=sys.stderr)
        return 2

    def work() -> int:
        STUDIES[words[0]]()
        return 0

    return interrupts.run(work)


if __name__ == "__main__":
    interrupts.leave(main())
