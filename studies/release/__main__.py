"""Command line: ``python -m studies.release`` builds sdist and wheel and tests them on every available Python."""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from agents import command_line
from studies.release import distributions, installation
from studies.release.results import ROOT, Failed, Row, table
from vibgym import checks, files


def requested_versions(arguments: argparse.Namespace) -> list[str]:
    """Return the versions of Python to test.

    Raises:
        Refused: unsupported version or unknown extra.
    """
    minors = list(filter(None, arguments.pythons.split(",")))
    for minor in minors:
        checks.choice("--pythons", minor, installation.MINORS)
    for extra in arguments.extras.split(","):
        checks.choice("--extras", extra, distributions.project()["optional-dependencies"])
    return minors


def run(arguments: argparse.Namespace) -> int:
    """Build, inspect and install; copy distributions that pass to the output directory. Return the exit code."""
    minors = requested_versions(arguments)
    output = files.output_directory(arguments.output or ROOT / "dist")
    rows: list[Row] = []

    def report(row: Row) -> None:
        rows.append(row)
        if not arguments.quiet:
            print(f"{row.check}, {row.subject}: {row.result}", file=sys.stderr, flush=True)

    failure = None
    with tempfile.TemporaryDirectory(prefix="vibgym-release-") as name:
        folder = Path(name)
        try:
            version = distributions.versions_agree(arguments.tag, report)
            built = sdist, wheel = distributions.build(folder, report)
            distributions.inspect_sdist(sdist, report)
            distributions.inspect_wheel(wheel, version, report)
            for minor in minors:
                for distribution in (wheel, sdist):
                    installation.install(minor, distribution, version, arguments.extras, folder, report)
            for path in built:
                shutil.copy(path, output)
        except Failed as error:
            failure = error
    print(table(rows))
    if failure is not None:
        print(failure, file=sys.stderr)
        return 1
    print(f"\nreleased: {', '.join(str(output / path.name) for path in built)}")
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    program = "python -m studies.release"
    parser = argparse.ArgumentParser(program, description=__doc__)
    parser.add_argument("--tag", help="tag of the release, v and the version, to be checked")
    parser.add_argument("--extras", default="play", help="extras to install (default: play); play,learn also runs SAC")
    parser.add_argument(
        "--pythons", default=",".join(installation.MINORS), help="versions to test, such as 3.11,3.12; empty: none"
    )
    parser.add_argument("--output", type=Path, metavar="DIR", help="directory of sdist and wheel (default: dist)")
    parser.add_argument("--quiet", action="store_true", help="no progress")
    arguments = parser.parse_args(argv)
    return command_line.guarded(program, lambda: run(arguments), extra="dev")


if __name__ == "__main__":
    sys.exit(main())
