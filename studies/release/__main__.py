"""Command line: ``python -m studies.release`` builds what is released, and tries it on every Python that there is."""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from agents import command_line
from agents.command_line import Command
from studies.release import built, tried
from studies.release.checked import ROOT, Failed, Row, table
from vibgym import checks, files


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    parser.add_argument("--tag", metavar="TAG", help="of the release, which must be v and the version")
    parser.add_argument(
        "--extras", default="play", metavar="NAMES", help="installed with it (default: play); play,learn for SAC, too"
    )
    parser.add_argument(
        "--pythons", default=",".join(tried.MINORS), metavar="LIST", help="those to try, such as 3.11,3.12; empty: none"
    )


def asked_for(asked: argparse.Namespace) -> list[str]:
    """The versions of Python to try.

    Raises:
        Refused: a version or an extra that is none of ours.
    """
    minors = list(filter(None, asked.pythons.split(",")))
    for minor in minors:
        if minor not in tried.MINORS:
            raise checks.refuse("--pythons", minor, f"some of {', '.join(tried.MINORS)}")
    known = built.project()["optional-dependencies"]
    for extra in asked.extras.split(","):
        if extra not in known:
            raise checks.refuse("--extras", extra, f"some of {', '.join(known)}")
    return minors


def run(asked: argparse.Namespace) -> int:
    """Build, look, try; what passes is put into the directory for it. Returns the exit code."""
    minors = asked_for(asked)
    output = files.output_directory(asked.output or ROOT / "dist")
    rows: list[Row] = []

    def tell(row: Row) -> None:
        rows.append(row)
        if not asked.quiet:
            print(f"{row.what}, {row.where}: {row.found}", file=sys.stderr, flush=True)

    failure = None
    with tempfile.TemporaryDirectory(prefix="vibgym-release-") as name:
        folder = Path(name)
        try:
            version = built.versions_agree(asked.tag, tell)
            made = built.build(folder, tell)
            built.look_into_sdist(made[0], tell)
            built.look_into_wheel(made[1], version, tell)
            for minor in minors:
                for distribution in reversed(made):  # kernels of the wheel first, from an empty cache
                    tried.try_on(minor, distribution, version, asked.extras, folder, tell)
            for path in made:
                shutil.copy(path, output)
        except Failed as error:
            failure = error
    print(table(rows))
    if failure is not None:
        print(failure, file=sys.stderr)
        return 1
    print(f"\nreleased: {', '.join(str(output / path.name) for path in made)}")
    return 0


COMMAND = Command(arguments, run, "directory for sdist and wheel, instead of dist")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    description = "Builds sdist and wheel, looks into both, and runs the examples with each on every Python."
    return command_line.run("python -m studies.release", description, COMMAND, argv, extra="dev")


if __name__ == "__main__":
    sys.exit(main())
