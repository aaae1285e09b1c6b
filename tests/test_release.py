"""Releases: versions and metadata agree, and broken distributions are rejected."""

import re
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest
import yaml

import vibgym
from studies.release import __main__ as release
from studies.release import distributions, installation, results

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def test_all_files_have_the_same_version():
    rows = []
    assert (
        distributions.versions_agree(f"v{vibgym.__version__}", rows.append) == PROJECT["version"] == vibgym.__version__
    )
    with pytest.raises(results.Failed, match="v9"):
        distributions.versions_agree("v9", rows.append)


def test_the_citation_has_the_required_fields():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert {"cff-version", "message", "title", "authors"} <= citation.keys()  # by the schema of 1.2.0
    assert (
        citation["cff-version"] == "1.2.0" and citation["type"] == "software" and citation["title"] == PROJECT["name"]
    )
    assert str(citation["version"]) == PROJECT["version"] and citation["license"] == PROJECT["license"]
    assert citation["authors"] == PROJECT["authors"]


def test_supported_pythons_agree():
    minors = [line.rpartition(" ")[2] for line in PROJECT["classifiers"] if re.search(r":: 3\.\d+$", line)]
    assert tuple(minors) == installation.MINORS
    last = int(minors[-1].split(".")[1])
    assert PROJECT["requires-python"] == f">={minors[0]},<3.{last + 1}"


def test_missing_interpreters_are_reported_as_not_tested(tmp_path, monkeypatch):
    running = f"{sys.version_info[0]}.{sys.version_info[1]}"
    assert installation.interpreter(running) and installation.interpreter("2.1") is None
    rows = []
    monkeypatch.setattr(installation, "interpreter", lambda minor: None)
    installation.install("3.12", tmp_path / "vibgym-1-py3-none-any.whl", "1", "play", tmp_path, rows.append)
    assert rows == [results.Row("installation", "Python 3.12, wheel", "not tested: this Python is not installed")]


def test_every_example_is_run_or_requires_another_extra():
    assert {
        path.stem for path in (ROOT / "examples").glob("*.py")
    } == installation.EXAMPLES.keys() | installation.FROM_CHECKOUT
    able, others = installation.examples_of("play")
    assert others == ["custom_reward_sac", "train_ppo"] and installation.examples_of("play,learn") == (
        [*able, *others],
        [],
    )


def test_missing_and_unexpected_files_of_a_distribution_fail(tmp_path):
    sdist = tmp_path / "vibgym.tar.gz"
    with tarfile.open(sdist, "w:gz") as packed:
        for name in (*(each for each in distributions.SOURCES if each != "tests"), *distributions.FILES):
            packed.add(ROOT / "pyproject.toml", f"vibgym-1/{name}")
    with pytest.raises(results.Failed, match=r"\['tests'\]"):
        distributions.inspect_sdist(sdist, print)
    wheel = tmp_path / "vibgym.whl"
    with zipfile.ZipFile(wheel, "w") as packed:
        packed.writestr("vibgym-1.dist-info/METADATA", "")
        packed.writestr("tests/a.py", "")
    with pytest.raises(results.Failed, match=r"\['gym_vibgym', 'vibgym'\].*\['tests'\]"):
        distributions.inspect_wheel(wheel, "1", print)
    for metadata in (b"Metadata-Version: 2.4\nName: vibgym\n", b"Metadata-Version: 2.4\nName: vibgym\nVersion: one\n"):
        with pytest.raises(results.Failed, match="ersion"):
            distributions.inspect_metadata(metadata, print)


def test_the_command_stops_at_the_first_failure_and_leaves_no_files(capsys, tmp_path, monkeypatch):
    def fails(folder, report):
        results.run_command(
            "sdist", [sys.executable, "-c", "import sys; print('a'); sys.exit('no room\\nleft')"], folder
        )

    monkeypatch.setattr(distributions, "build", fails)
    assert release.main(["--quiet", "--output", str(tmp_path / "dist")]) == 1
    caught = capsys.readouterr()
    assert caught.err.startswith("sdist: exit code 1") and caught.err.count("\n") == 1
    assert list((tmp_path / "dist").iterdir()) == []
    for arguments in (["--pythons", "3.9"], ["--extras", "playing"]):
        assert release.main(arguments) == 2
        assert arguments[1] in capsys.readouterr().err
