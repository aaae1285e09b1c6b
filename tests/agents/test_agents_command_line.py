"""Exit codes: bad input is one line, a fault of the program keeps its traceback."""

from __future__ import annotations

import logging

import pytest
from tqdm import tqdm

from agents import command_line
from vibgym import checks


def program(work):
    return command_line.run("program", "", command_line.Command(lambda parser: None, lambda arguments: work()), [])


def refused():
    raise checks.refuse("seed", -1, "a whole number >= 0")


def faulty():
    raise ValueError("operands could not be broadcast together")


def test_bad_input_is_one_line(capsys):
    assert program(refused) == 2
    assert capsys.readouterr().err == "seed must be a whole number >= 0, got -1\n"


def test_a_fault_keeps_its_traceback():
    with pytest.raises(ValueError, match="operands") as found:
        program(faulty)
    assert found.traceback[-1].name == "faulty"


def test_what_a_user_s_class_does_not_take_is_bad_input_of_the_file(capsys):
    def work():
        with checks.within("mine.yaml"):
            faulty()

    assert program(work) == 2
    assert capsys.readouterr().err == "mine.yaml: operands could not be broadcast together\n"
    with pytest.raises(ValueError, match="^operands"), checks.within("mine.yaml", kind=checks.Refused):
        faulty()


def test_messages_of_the_library_do_not_break_progress_bars(capsys):
    def work():
        with tqdm(total=9) as bar:
            bar.update(4)
            logging.getLogger("vibgym").warning("compiling")
        return 0

    assert program(work) == 0
    assert "compiling" in [line.rpartition("\r")[2] for line in capsys.readouterr().err.splitlines()]
