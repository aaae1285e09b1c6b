"""``--import``: user modules take part in the command and its workers; one that cannot be imported is one line."""

import json
import sys
from typing import Any

import pytest

from agents import __main__ as command
from agents import parallel
from agents.evaluation.run import Case
from agents.evaluation.table import Place
from vibgym import imports

PACKAGE = """
import gymnasium as gym

from vibgym.tasks import TASKS
from vibgym.tasks.pose import Transport


class Park(Transport):
    name = "{name}"

    def __init__(self, *arguments, **settings):
        super().__init__(*arguments, **settings)
        self.position_tolerance = 0.02


TASKS.register("{name}", Park)
gym.register(
    id="mine/{name}-v0", entry_point="vibgym.envs:VibgymEnv", vector_entry_point="vibgym.envs:VibgymVectorEnv",
    max_episode_steps=20, kwargs={{"task": "{name}", "max_episode_periods": 20}},
)
"""

TRAINING = """
mine/{name}-v0:
  plain:
    environment: {{action: field}}
    worlds: 4
    steps: 64
    ppo: {{n_steps: 8, batch_size: 16, n_epochs: 1, net: [8], critic_net: [8]}}
    selection: {{episodes: 3, every: 32}}
"""


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Names of a task and of its package, which no other test has imported; the current directory."""
    name = f"Park{abs(hash(tmp_path)) % 10**8}"
    (tmp_path / f"package_{name.lower()}").mkdir()
    (tmp_path / f"package_{name.lower()}" / "__init__.py").write_text(PACKAGE.format(name=name))
    (tmp_path / "mine.yaml").write_text(TRAINING.format(name=name))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.path", list(sys.path))
    monkeypatch.setattr(imports, "_imported", [])
    return name, f"package_{name.lower()}"


def knows(name):
    from vibgym.tasks import TASKS

    return name in TASKS


def test_a_user_package_takes_part_in_trainings_workers_and_evaluations(package, tmp_path, monkeypatch):
    name, module = package
    arguments = ["train", "mine.yaml", "--agent", f"{name}/plain", "--output", "run", "--quiet", "--import", module]
    assert command.main(arguments) == 0
    record = json.loads((tmp_path / "run" / "policy.json").read_text())
    assert record["training"]["settings"]["task"] == f"mine/{name}-v0" and imports.user_modules() == (module,)
    assert (tmp_path / "run" / "curve.csv").read_text().count("\n") == 3
    monkeypatch.setattr(parallel, "available_threads", lambda: 2)
    assert parallel.run(knows, [(name,)] * 2, workers=2) == [True, True]
    info: Any = None  # is not used
    place = Place("report", "", "", "zero")
    mine, ours = (Case(place, None, task, info, [1], {}, "zero") for task in (f"mine/{name}-v0", "Align"))
    assert mine.plain and ours.plain
    monkeypatch.setattr(imports, "_imported", [])  # registered by the program itself, which workers do not know
    assert not mine.plain and ours.plain


TAKEN = "import vibgym\nvibgym.tasks.TASKS.register('Align', object)"


@pytest.mark.parametrize("text, message", [
    (None, "ModuleNotFoundError: No module named 'spoilt_"), ("1 / 0", "ZeroDivisionError: division by zero"),
    (TAKEN, "ValueError: task name"), ("x = (", "SyntaxError"),
])  # fmt: skip
def test_modules_that_cannot_be_imported_are_one_line(tmp_path, monkeypatch, capsys, text, message):
    name = f"spoilt_{abs(hash(tmp_path)) % 10**8}"
    if text is not None:
        (tmp_path / f"{name}.py").write_text(text)
    monkeypatch.chdir(tmp_path)
    assert command.main(["train", "none.yaml", "--import", name]) == 2
    line = capsys.readouterr().err
    assert line.startswith("--import") and message in line and line.count("\n") == 1
