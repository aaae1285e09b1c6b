"""Results of the checks of a release, and commands run by them."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]

HIDDEN = ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "VIBGYM_CACHE", "VIBGYM_PLAIN_NUMBA")
"""Environment variables through which an installation could use files of the checkout."""


class Row(NamedTuple):
    """A line of the table of results."""

    check: str
    subject: str
    result: str


Report = Callable[[Row], None]
"""Receives each result."""


class Failed(RuntimeError):
    """A check failed; the message is one line with the check and its result."""


def require(holds: object, check: str, result: object) -> None:
    """Raise :class:`Failed` with check and result unless ``holds``."""
    if not holds:
        raise Failed(" ".join(f"{check}: {result}".split()))


def require_names(check: str, names: Iterable[str], expected: Iterable[str]) -> None:
    """Raise :class:`Failed` with the first differences unless two sets of names are equal."""
    names, expected = set(names), set(expected)
    missing, unexpected = sorted(expected - names), sorted(names - expected)
    require(not missing and not unexpected, check, f"missing {missing[:3]}, unexpected {unexpected[:3]}")


def run_command(
    check: str, command: Sequence[object], cwd: Path, variables: Mapping[str, str] | None = None
) -> tuple[str, str]:
    """Run a command without the variables :data:`HIDDEN`; return its stdout and stderr.

    Args:
        check: name for errors.
        command: program and arguments.
        cwd: working directory.
        variables: additional environment variables.

    Raises:
        Failed: the command cannot be run, takes longer than half an hour, or returns a nonzero exit code.
    """
    environment = {name: value for name, value in os.environ.items() if name not in HIDDEN}
    words, variables = [str(word) for word in command], {**environment, **(variables or {})}
    try:
        done = subprocess.run(words, cwd=cwd, env=variables, capture_output=True, text=True, timeout=1800)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise Failed(f"{check}: {error}") from None
    last = (done.stderr.strip() or done.stdout.strip() or "no output").splitlines()[-1]
    require(done.returncode == 0, check, f"exit code {done.returncode}, {last}")
    return done.stdout, done.stderr


def table(rows: Sequence[Row]) -> str:
    """Return all rows as text in columns."""
    head = Row("check", "subject", "result")
    widths = [max(len(row[k]) for row in (head, *rows)) for k in range(2)]
    lines = (f"{row.check:{widths[0]}}  {row.subject:{widths[1]}}  {row.result}".rstrip() for row in (head, *rows))
    return "\n".join(lines)
