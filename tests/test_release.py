"""What is released says the same of itself everywhere, and the workflows call commands that there are."""

import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest
import yaml

import vibgym
from studies.release import __main__ as release
from studies.release import built, checked, tried

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))


def test_all_places_tell_the_same_version(capsys):
    rows = []
    assert built.versions_agree(f"v{vibgym.__version__}", rows.append) == PROJECT["version"] == vibgym.__version__
    assert "5 places" in rows[0].found
    with pytest.raises(checked.Failed, match=r"^tag: v9, where pyproject.toml has "):
        built.versions_agree("v9", rows.append)


def test_the_citation_has_what_its_format_requires():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert {"cff-version", "message", "title", "authors"} <= citation.keys()  # by the schema of 1.2.0
    assert (
        citation["cff-version"] == "1.2.0" and citation["type"] == "software" and citation["title"] == PROJECT["name"]
    )
    assert str(citation["version"]) == PROJECT["version"] and citation["license"] == PROJECT["license"]
    assert citation["authors"] == PROJECT["authors"]
    dated = f"## [{citation['version']}] - {citation['date-released'].isoformat()}"
    assert dated in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_the_changelog_is_in_order():
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    versions = re.findall(r"^## \[(\d+\.\d+\.\d+)\] - \d{4}-\d\d-\d\d$", text, re.M)
    assert versions[0] == PROJECT["version"] and len(set(versions)) == len(versions)
    assert versions == sorted(versions, key=lambda each: [int(number) for number in each.split(".")], reverse=True)
    for section in re.split(r"^## \[", text, flags=re.M)[1:]:
        kinds = re.findall(r"^### (.+)$", section, re.M)
        allowed = ["Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"]
        assert kinds == [kind for kind in allowed if kind in kinds]


def test_pythons_are_the_same_everywhere():
    minors = [line.rpartition(" ")[2] for line in PROJECT["classifiers"] if re.search(r":: 3\.\d+$", line)]
    test = yaml.safe_load((ROOT / ".github" / "workflows" / "test.yml").read_text())
    assert tuple(minors) == tried.MINORS == tuple(test["jobs"]["test"]["strategy"]["matrix"]["python"])
    last = int(minors[-1].split(".")[1])
    assert PROJECT["requires-python"] == f">={minors[0]},<3.{last + 1}"


def test_extras_hold_what_they_need_for_what_they_are_for():
    extras = PROJECT["optional-dependencies"]
    assert "vibgym[policies,render]" in extras["play"]
    named = set(re.search(r"\[(.+)\]", extras["dev"][0])[1].split(","))
    assert extras.keys() - named <= {"dev", "policies"}  # policies comes with learn


def commands(workflow):
    """What its steps run."""
    return [step["run"] for job in workflow["jobs"].values() for step in job["steps"] if "run" in step]


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_a_workflow_calls_commands_that_there_are(path):
    workflow = yaml.safe_load(path.read_text(encoding="utf-8"))
    assert workflow["name"] == path.stem and workflow[True] and workflow["permissions"] == {"contents": "read"}
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M))
    run = [line for command in commands(workflow) for line in command.splitlines()]
    for line in run:
        words = line.split()
        assert words[1] in targets if words[0] == "make" else os.access(ROOT / words[0], os.X_OK)
    assert any(line.startswith(f"make {path.stem}") for line in run)
    for job in workflow["jobs"].values():
        assert job["timeout-minutes"] <= 120 if path.stem != "release" or "needs" not in job else job["environment"]
        for uses in (step["uses"] for step in job["steps"] if "uses" in step):
            assert re.fullmatch(r"[\w-]+/[\w-]+@(release/)?v\d+", uses), uses


def test_there_are_workflows_for_tests_documentation_and_release():
    assert [path.stem for path in WORKFLOWS] == ["docs", "release", "test"]


def ci(folder, apt_get, *more):
    """What `.ci/run browser` does on a machine that has these programs and no others."""
    for name in ("bash", "dirname", "env", "id", "mktemp", "rm", "chmod"):
        (folder / name).symlink_to(shutil.which(name))
    for name, code in {"apt-get": apt_get, "sudo": '[ "$1" = -n ] && shift; exec "$@"', **dict(more)}.items():
        (folder / name).write_text(f"#!{shutil.which('bash')}\n{code}\n")
        (folder / name).chmod(0o755)
    bash = shutil.which("bash")
    return subprocess.run(
        [bash, ROOT / ".ci" / "run", "browser"], env={"PATH": str(folder)}, capture_output=True, text=True
    )


def test_ci_installs_a_browser_where_there_is_none(tmp_path):
    browser = tmp_path / "chromium"
    install = f'case "$*" in *install*chromium) echo "#!/bin/sh" >{browser}; chmod +x {browser};; esac; echo noise'
    done = ci(tmp_path, install)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert browser.exists()


@pytest.mark.parametrize("name", ["chromium", "chromium-browser", "google-chrome"])
def test_ci_takes_the_browser_that_there_is(name, tmp_path):
    done = ci(tmp_path, "echo must not be called >&2; exit 1", (name, "exit 0"))
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_ci_says_in_one_line_that_there_is_no_browser(tmp_path):
    done = ci(tmp_path, "echo E: Unable to fetch >&2; exit 100")
    assert done.returncode == 1 and done.stdout == ""
    assert done.stderr.count("\n") == 1 and done.stderr.startswith("no browser: chromium could not be installed")


def test_interpreters_are_found_or_listed_as_not_tried(tmp_path, monkeypatch):
    own = f"{sys.version_info[0]}.{sys.version_info[1]}"
    assert tried.interpreter(own) and tried.interpreter("2.1") is None
    rows = []
    monkeypatch.setattr(tried, "interpreter", lambda minor: None)
    tried.try_on("3.12", tmp_path / "vibgym.whl", "1", "play", tmp_path, rows.append)
    assert rows == [checked.Row("installation", "Python 3.12, wheel", "not tried: no such Python")]


def test_every_example_is_tried_or_said_not_to_be():
    assert {path.stem for path in (ROOT / "examples").glob("*.py")} == tried.EXAMPLES.keys()
    able, others = tried.examples_of("play")
    assert others == ["own_reward_sac"] and tried.examples_of("play,learn") == ([*able, *others], [])


def test_what_a_distribution_lacks_or_has_too_much_fails_in_one_line(tmp_path):
    sdist = tmp_path / "vibgym.tar.gz"
    with tarfile.open(sdist, "w:gz") as packed:
        for name in (*(each for each in built.SOURCES if each != "tests"), *built.BESIDE):
            packed.add(ROOT / "pyproject.toml", f"vibgym-1/{name}")
    with pytest.raises(checked.Failed, match=r"^sdist's folders: missing \['tests'\], too many \[\]$"):
        built.look_into_sdist(sdist, print)
    wheel = tmp_path / "vibgym.whl"
    with zipfile.ZipFile(wheel, "w") as packed:
        packed.writestr("vibgym-1.dist-info/METADATA", "")
        packed.writestr("tests/a.py", "")
    with pytest.raises(checked.Failed, match=r"missing \['vibgym'\], too many \['tests'\]$"):
        built.look_into_wheel(wheel, "1", print)
    for metadata in (b"Metadata-Version: 2.4\nName: vibgym\n", b"Metadata-Version: 2.4\nName: vibgym\nVersion: one\n"):
        with pytest.raises(checked.Failed, match="^metadata: .*ersion"):
            built.look_into_metadata(metadata, print)


def test_the_command_stops_at_the_first_failure_and_keeps_nothing(capsys, tmp_path, monkeypatch):
    def fails(folder, tell):
        checked.ran("sdist", [sys.executable, "-c", "import sys; print('a'); sys.exit('no room\\nleft')"], folder)

    monkeypatch.setattr(built, "build", fails)
    assert release.main(["--quiet", "--output", str(tmp_path / "dist")]) == 1
    caught = capsys.readouterr()
    assert caught.err == "sdist: exit code 1, left\n" and "version" in caught.out
    assert list((tmp_path / "dist").iterdir()) == []
    for arguments, said in ((["--pythons", "3.9"], "3.9"), (["--extras", "playing"], "playing")):
        assert release.main(arguments) == 2
        assert said in capsys.readouterr().err
