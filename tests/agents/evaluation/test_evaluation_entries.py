"""Entries of a suite: written from a score, checked, played again, ranked."""

import csv
from pathlib import Path

import pytest

from agents.__main__ import main
from agents.evaluation.entries import load_entries
from agents.evaluation.score import SuiteSettings

SUITE = """
tasks: [Pack, Push]
policies: [zero]
first_seed: 300000
episodes: 2
hardware: {ideal: {}}
training_steps: 1000
processes: 1
"""
POLICY = "{kind: by_task, Pack: two_phases, Push: push, training_steps: 10}"


@pytest.fixture(scope="module")
def entered(tmp_path_factory):
    """Return a directory with a suite and an entry."""
    folder = tmp_path_factory.mktemp("entries")
    (folder / "suite.yaml").write_text(SUITE)
    (folder / "mine.yaml").write_text(POLICY)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert (
            main(["score", "suite.yaml", "--policy", "mine.yaml", "--enter", "me", "--output", "out", "--quiet"]) == 0
        )
    return folder


@pytest.fixture
def place(entered, tmp_path, monkeypatch):
    """Copy the directory, since tests change it."""
    for path in entered.rglob("*"):
        if path.is_file() and "out" not in path.relative_to(entered).parts:
            copy = tmp_path / path.relative_to(entered)
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_bytes(path.read_bytes())
    monkeypatch.chdir(tmp_path)
    return tmp_path


def verified(*more):
    try:
        return main(["score", "suite.yaml", "--entries", "entries", "--output", "found", "--quiet", *more])
    except SystemExit as end:
        return end.code


def ranking():
    with open("found/ranking.csv", newline="") as file:
        return list(csv.DictReader(file))


def test_an_entry_is_played_again_bit_for_bit(place, capsys):
    assert verified() == 0
    (row,) = ranking()
    assert row["entry"] == "mine" and row["verified"] == "True" and row["authors"] == "me"
    assert row["episodes_played"] == row["same"] == "4" and abs(float(row["difference"])) < 1e-9
    assert float(row["Pack"]) > 0.5 and row["training_steps"] == "10"
    assert "ranking.md" in capsys.readouterr().out


def test_a_sample_is_compared_with_its_claims(place):
    assert verified("--episodes", "1") == 0
    assert ranking()[0]["episodes_played"] == "2"


def test_claims_that_are_not_reached_are_not_verified(place, capsys):
    path = Path("entries/mine/episodes.csv")
    rows = list(csv.DictReader(path.open(newline="")))
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows({**row, "score": "1.0"} for row in rows)
    assert verified() == 1
    assert ranking()[0]["verified"] == "False" and "mine" in capsys.readouterr().err


def test_entries_are_ranked_by_score_and_custom_files_belong_to_them(place):
    other = Path("entries/still")
    other.mkdir()
    (other / "entry.yaml").write_text("{policy: zero, training_steps: 0, authors: another}")
    rows = Path("entries/mine/episodes.csv").read_text().splitlines()
    zeros = [",".join([*row.split(",")[:3], "0.0"]) for row in rows[1:]]
    (other / "episodes.csv").write_text("\n".join([rows[0], *zeros]) + "\n")
    assert verified() == 0
    assert [row["entry"] for row in ranking()] == ["mine", "still"]


@pytest.mark.parametrize(("change", "named"), [
    (lambda text: text.replace("training_steps: 10", "training_steps: 1001"), "training_steps"),
    (lambda text: text.replace("authors: me", ""), "authors"),
    (lambda text: text + "unknown: 1\n", "unknown"),
    (lambda text: text.replace("sha256: {}", "sha256: {policy.json: abc}"), "sha256"),
])  # fmt: skip
def test_a_bad_entry_is_one_error_before_anything_is_played(place, change, named, capsys):
    path = Path("entries/mine/entry.yaml")
    path.write_text(change(path.read_text()))
    assert verified() == 2
    error = capsys.readouterr().err
    assert named in error and "entries/mine" in error and error.count("\n") == 1
    assert not Path("found").exists()


def test_files_that_no_digest_names_are_refused(place, capsys):
    Path("entries/mine/extra.py").write_text("x = 1\n")
    assert verified() == 2 and "extra.py" in capsys.readouterr().err


@pytest.mark.parametrize("change", [
    lambda rows: rows[:-1],
    lambda rows: [row.replace("300001", "5") for row in rows],
    lambda rows: [row.replace("Pack", "Sort") for row in rows],
    lambda rows: [rows[0], *(row.rsplit(",", 1)[0] + ",2.0" for row in rows[1:])],
    lambda rows: ["nothing"],
])  # fmt: skip
def test_claims_for_other_episodes_are_refused(place, change, capsys):
    path = Path("entries/mine/episodes.csv")
    path.write_text("\n".join(change(path.read_text().splitlines())) + "\n")
    assert verified() == (1 if change(["a"]) == ["nothing"] else 2)  # no claims at all: nothing is verified


def test_an_empty_directory_and_conflicting_options_are_refused(place, capsys):
    Path("none").mkdir()
    for arguments in (["--entries", "none"], ["--entries", "entries", "--policy", "mine.yaml"], ["--enter", "me"]):
        assert main(["score", "suite.yaml", *arguments, "--output", "found"]) == 2
    again = ["score", "suite.yaml", "--policy", "mine.yaml", "--enter", "me", "--output", "o", "--quiet"]
    assert main(again) == 2 and not Path("o").exists()  # the entry exists: nothing is played
    assert main([*again, "--episodes", "1"]) == 2


def test_shipped_entries_are_valid():
    root = Path(__file__).parents[3]
    settings = SuiteSettings.load(root / "configs/suite/open.yaml", None, None)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(root)
        found = load_entries(root / "entries", settings)
    assert {"classical", "learned", "parallel_rollout"} <= {each.name for each in found}
    assert all(len(each.claims) == 16 for each in found)


@pytest.mark.full
def test_an_episode_of_each_shipped_entry_is_as_claimed(tmp_path, monkeypatch):
    root = Path(__file__).parents[3]
    monkeypatch.chdir(root)
    suite = "configs/suite/open.yaml"
    arguments = ["--entries", "entries", "--episodes", "1", "--output", str(tmp_path), "--quiet"]
    assert main(["score", suite, *arguments]) == 0
