"""A check of the release, and how one ends that fails."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]

HIDDEN = ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "VIBGYM_CACHE", "VIBGYM_PLAIN_NUMBA")
"""Environment variables by which an installation would show what is not its own."""


class Row(NamedTuple):
    """A line of the table of what was checked."""

    what: str
    where: str
    found: str


Tell = Callable[[Row], None]


class Failed(RuntimeError):
    """A check failed; the message is one line that says which, and what was found."""


def require(holds: object, what: str, found: object) -> None:
    """Raise an error unless a check holds.

    Raises:
        Failed: it does not.
    """
    if not holds:
        raise Failed(" ".join(f"{what}: {found}".split()))


def same(what: str, found: Iterable[str], expected: Iterable[str]) -> None:
    """Require that two sets of names are equal; an error lists the first differences."""
    found, expected = set(found), set(expected)
    missing, more = sorted(expected - found), sorted(found - expected)
    require(not missing and not more, what, f"missing {missing[:3]}, too many {more[:3]}")


def ran(what: str, command: Sequence[object], cwd: Path, more: Mapping[str, str] | None = None) -> tuple[str, str]:
    """What a command prints, on stdout and stderr, in an environment that does not show the checkout.

    Raises:
        Failed: it cannot be run, takes longer than half an hour, or ends with another exit code than 0.
    """
    own = {name: value for name, value in os.environ.items() if name not in HIDDEN}
    words = [str(word) for word in command]
    try:
        done = subprocess.run(words, cwd=cwd, env={**own, **(more or {})}, capture_output=True, text=True, timeout=1800)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise Failed(f"{what}: {error}") from None
    last = (done.stderr.strip() or done.stdout.strip() or "no output").splitlines()[-1]
    require(done.returncode == 0, what, f"exit code {done.returncode}, {last}")
    return done.stdout, done.stderr


def table(rows: Sequence[Row]) -> str:
    """All rows, in columns."""
    head = Row("checked", "where", "found")
    widths = [max(len(row[k]) for row in (head, *rows)) for k in range(2)]
    lines = (f"{row.what:{widths[0]}}  {row.where:{widths[1]}}  {row.found}".rstrip() for row in (head, *rows))
    return "\n".join(lines)
