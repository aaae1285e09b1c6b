"""Ctrl-C ends a command with exit code 130 and one line."""

import io
import signal
import subprocess
import sys

import pytest

from agents import command_line


def program(work):
    return command_line.run("program", "", command_line.Command(lambda parser: None, lambda arguments: work()), [])


@pytest.mark.usefixtures("interruptible")
def test_interruption_is_one_line_and_exit_code_130(capsys):
    def work():
        signal.raise_signal(signal.SIGINT)
        return 0

    assert program(work) == 130
    assert capsys.readouterr().err == "interrupted\n"
    assert program(lambda: 7) == 7


def test_interruption_reports_what_a_command_has_saved(capsys):
    def work():
        raise KeyboardInterrupt("4096 steps are saved in runs/mine")

    assert program(work) == 130
    assert capsys.readouterr().err == "interrupted: 4096 steps are saved in runs/mine\n"


def test_characters_that_the_terminal_lacks_are_escaped(monkeypatch):
    poor = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    monkeypatch.setattr(sys, "stdout", poor)

    def work():
        print("success \u2013, 0.6 \u00b5m")
        return 0

    assert program(work) == 0
    poor.flush()
    assert poor.buffer.getvalue() == b"success \\u2013, 0.6 \\xb5m\n"


@pytest.mark.parametrize("modules", ["vibgym", "vibgym.__main__, agents.__main__, studies.accuracy.__main__"])
def test_import_registers_environments_and_leaves_signals_alone(modules):
    more = "import gymnasium; print(signal.getsignal(signal.SIGINT) is before, 'vibgym/Align-v0' in gymnasium.registry)"
    code = f"import signal; before = signal.getsignal(signal.SIGINT); import {modules}; {more}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True", "True"]
