"""Exit codes: bad input and a missing extra are one line, a fault of the program keeps its traceback."""

from __future__ import annotations

import logging
import sys
import tomllib
from pathlib import Path

import pytest
from tqdm import tqdm

from agents import __main__ as command
from agents import command_line
from vibgym import checks

ROOT = Path(__file__).parents[2]


def program(work):
    return command_line.run("program", "", command_line.Command(lambda parser: None, lambda arguments: work()), [])


def refused():
    raise checks.refuse("seed", -1, "a whole number >= 0")


def faulty():
    raise ValueError("operands could not be broadcast together")


def broken():
    raise ModuleNotFoundError("No module named 'nonsense'", name="nonsense")


def named():
    with checks.within("mine.yaml"):
        faulty()


@pytest.mark.parametrize("work, line", [
    (refused, "seed must be a whole number >= 0, got -1"),
    (named, "mine.yaml: operands could not be broadcast together"),
])  # fmt: skip
def test_bad_input_is_one_line(capsys, work, line):
    assert program(work) == 2
    assert capsys.readouterr().err == f"{line}\n"


@pytest.mark.parametrize("work", [faulty, broken])
def test_a_fault_keeps_its_traceback(work):
    with pytest.raises((ValueError, ModuleNotFoundError)) as found, checks.within("mine.yaml", kind=checks.Refused):
        program(work)
    assert found.traceback[-1].name == work.__name__


def test_messages_of_the_library_do_not_break_progress_bars(capsys):
    def work():
        with tqdm(total=9) as bar:
            bar.update(4)
            logging.getLogger("vibgym").warning("compiling")
        return 0

    assert program(work) == 0
    assert "compiling" in [line.rpartition("\r")[2] for line in capsys.readouterr().err.splitlines()]


@pytest.mark.parametrize("package, extra, arguments", [
    ("minari", "data", ["record", "configs/recordings/align.yaml"]),
    ("optuna", "tune", ["tune", "configs/tuning/align.yaml"]),
    ("ray", "cluster", ["evaluate", "configs/evaluations/quick.yaml", "--ray", "local", "--quiet"]),
])  # fmt: skip
def test_a_package_that_is_missing_is_named_with_its_extra(monkeypatch, capsys, package, extra, arguments):
    for name in [
        each for each in sys.modules if each.startswith(("agents.recording", "agents.tune", "agents.parallel"))
    ]:
        monkeypatch.delitem(sys.modules, name)
    for name in [each for each in sys.modules if each.partition(".")[0] == package]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.chdir(ROOT)
    assert command.main(arguments) == 1
    message = capsys.readouterr().err.strip().splitlines()[-1]
    assert message == f"{arguments[0]}: {package} is not installed: pip install 'vibgym[{extra}]'"


def test_extras_are_those_of_the_project():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    names = {"h5py": "minari[hdf5]"}  # which brings it
    for package, extra in command_line.EXTRAS.items():
        name = names.get(package, package.replace("_", "-"))
        brought = extras[extra] + (extras["policies"] if "vibgym[policies]" in extras[extra] else [])
        assert any(each.startswith(name) for each in brought), package
