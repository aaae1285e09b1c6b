"""``python -m studies.tilting NAME`` prints a study's table."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from agents import command_line
from studies.tilting import against_planar, closed_forms, energy, releases
from vibgym import checks

STUDIES = {
    "impulse": releases.impulse,
    "landing": releases.landing,
    "fields": against_planar.fields,
    "means": against_planar.means,
    "hold": against_planar.hold,
    "energy": energy.main,
    "cost": against_planar.cost,
    "housner": closed_forms.housner,
    "transport": closed_forms.transport,
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run one study; return the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    if len(words) != 1 or words[0] not in STUDIES:
        print(checks.refuse("NAME", " ".join(words), f"one of {', '.join(STUDIES)}"), file=sys.stderr)
        return 2
    return command_line.guarded("python -m studies.tilting", lambda: STUDIES[words[0]]() or 0)


if __name__ == "__main__":
    sys.exit(main())
