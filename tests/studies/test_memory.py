"""Study of memory: number of steps, and a small run of the command."""

import sys

import numpy as np
import pytest

from studies.benchmarks import memory
from studies.benchmarks.memory import CONDITIONS, IDEAL, MEMORIES, Condition
from tests.envs.helpers import batch


@pytest.mark.parametrize("condition", CONDITIONS[1:], ids=str)
def test_the_number_of_steps_covers_the_age_of_readings(condition):
    """The last reading is older by ``missed`` samples in a row with a probability of at most 1 %, by one less with more."""
    worlds, steps = 128, 150
    env = batch("Align", worlds, action="field", sensor=condition.sensor(), max_episode_steps=steps + 1)
    env.reset(seed=0)
    ages = np.array([env.step(np.zeros(env.action_space.shape))[4]["measured"]["age"] for _ in range(steps)])[20:]
    assert ages.min() == condition.delay
    missed = condition.steps - condition.delay - 1
    if not missed:
        assert ages.max() == condition.delay and condition.steps == condition.delay + 1
        return
    share = [(ages >= condition.delay + number).mean() for number in (missed, missed - 1)]
    assert share[0] == pytest.approx(condition.dropout**missed, rel=0.25) and share[0] < 0.0115 < share[1]


def test_a_small_run_prints_both_tables(monkeypatch, capsys):
    monkeypatch.setattr(memory, "CONDITIONS", (IDEAL, Condition(2, 0.5)))
    monkeypatch.setattr(memory, "HARDEST", ())
    monkeypatch.setattr(memory, "LEARNING", {**memory.LEARNING, "net": [8], "critic_net": [8]})
    monkeypatch.setattr(sys, "argv", ["memory", "--episodes", "2", "--steps", "1024", "--seeds", "2"])
    memory.main()
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("| ")]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    assert cells[0] == ["hardware", "n", *MEMORIES] and cells[2][2:] == [cells[2][2], "–", "–", "–"]
    assert cells[3][:2] == ["delay 2, dropout 50 %", "10"] and cells[3][-1] == "–" and "–" not in cells[3][2:5:4]
    assert all("%" in cell and "mm" in cell for cell in (cells[2][2], *cells[3][2:5], *cells[6][1:]))
    assert [memory.memory(name, Condition(2, 0.3))["history"] for name in MEMORIES] == [0, 1, 7, 7]
    assert cells[6][0] == cells[3][0] and cells[6][3].startswith("100.0 %")  # the controller with the model


@pytest.mark.full
def test_memory_solves_align_under_a_delay_that_an_agent_without_does_not():
    """A fifth of a minute for each training on an idle core; the seed is none of the table's."""
    delayed = Condition(2, 0.3)
    success = {
        name: memory.learn(delayed, name, 1, 300_000, 50)[delayed, "none"].success.mean()
        for name in (MEMORIES[0], MEMORIES[2])
    }
    assert success[MEMORIES[0]] < 0.4 and success[MEMORIES[2]] > 0.8
