"""Commands: exit codes, one line for bad input, interrupts and missing packages, and tracebacks of faults."""

import io
import logging
import signal
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from tqdm import tqdm

from agents import __main__ as command
from agents import command_line
from vibgym import checks

ROOT = Path(__file__).parents[1]


def program(work):
    return command_line.run("program", "", command_line.Command(lambda parser: None, lambda arguments: work()), [])


def refused():
    raise checks.refuse("seed", -1, "a whole number >= 0")


def faulty():
    raise ValueError("operands could not be broadcast together")


def broken():
    raise ModuleNotFoundError("No module named 'nonsense'", name="nonsense")


def in_a_file():
    with checks.within("mine.yaml"):
        faulty()


def interrupted():
    signal.raise_signal(signal.SIGINT)


def interrupted_when_saved():
    raise KeyboardInterrupt("4096 steps are saved in runs/mine")


@pytest.mark.usefixtures("interruptible")
@pytest.mark.parametrize("work, code, line", [
    (refused, 2, "seed must be a whole number >= 0, got -1\n"),
    (in_a_file, 2, "mine.yaml: operands could not be broadcast together\n"),
    (interrupted, 130, "interrupted\n"),
    (interrupted_when_saved, 130, "interrupted: 4096 steps are saved in runs/mine\n"),
    (lambda: 7, 7, ""),
])  # fmt: skip
def test_exit_codes_and_errors(capsys, work, code, line):
    assert program(work) == code
    assert capsys.readouterr() == ("", line)


@pytest.mark.parametrize("work", [faulty, broken])
def test_a_fault_keeps_its_traceback(work):
    with pytest.raises((ValueError, ModuleNotFoundError)) as error, checks.within("mine.yaml", kind=checks.Refused):
        program(work)
    assert error.traceback[-1].name == work.__name__


def test_messages_of_the_library_do_not_break_progress_bars(capsys):
    def work():
        with tqdm(total=9) as bar:
            bar.update(4)
            logging.getLogger("vibgym").warning("compiling")
        return 0

    assert program(work) == 0
    assert "compiling" in [line.rpartition("\r")[2] for line in capsys.readouterr().err.splitlines()]


def test_characters_that_the_terminal_lacks_are_escaped(monkeypatch):
    poor = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    monkeypatch.setattr(sys, "stdout", poor)
    assert program(lambda: print("success \u2013, 0.6 \u00b5m")) == 0
    poor.flush()
    assert poor.buffer.getvalue() == b"success \\u2013, 0.6 \\xb5m\n"


@pytest.mark.parametrize("arguments", [[], ["fly"], ["evaluate"], ["evaluate", "x.yaml", "--episodes", "many"]])
def test_wrong_arguments_end_with_exit_code_2(arguments):
    with pytest.raises(SystemExit) as stop:
        command.main(arguments)
    assert stop.value.code == 2


def test_import_registers_environments_and_leaves_signals_alone():
    code = """
import signal
before = signal.getsignal(signal.SIGINT)
import vibgym.__main__, agents.__main__, studies.accuracy.__main__, gymnasium
print(signal.getsignal(signal.SIGINT) is before, "vibgym/Align-v0" in gymnasium.registry)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True", "True"]


@pytest.mark.full
@pytest.mark.parametrize("package, extra, arguments", [
    ("minari", "data", ["record", "configs/recordings/align.yaml"]),
    ("optuna", "tune", ["tune", "configs/tuning/align.yaml"]),
    ("ray", "cluster", ["evaluate", "configs/evaluations/quick.yaml", "--ray", "local", "--quiet"]),
])  # fmt: skip
def test_a_missing_package_is_named_with_its_extra(monkeypatch, capsys, package, extra, arguments):
    importers = ("agents.recording", "agents.tune", "agents.parallel")
    for name in [name for name in sys.modules if name.startswith(importers) or name.partition(".")[0] == package]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.chdir(ROOT)
    assert command.main(arguments) == 1
    message = capsys.readouterr().err.strip().splitlines()[-1]
    assert message == f"{arguments[0]}: {package} is not installed: pip install 'vibgym[{extra}]'"


def test_extras_provide_their_packages():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    names = {"h5py": "minari[hdf5]"}  # which requires it
    for package, extra in command_line.EXTRAS.items():
        name = names.get(package, package.replace("_", "-"))
        provided = extras[extra] + (extras["policies"] if "vibgym[policies]" in extras[extra] else [])
        assert any(requirement.startswith(name) for requirement in provided), package
