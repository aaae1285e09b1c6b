"""A small evaluation that runs once for all tests of this folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents import evaluation

STATE_ERROR = slice(8, 10)  # tanh of goal minus centre in 50 mm, see the environment's table


class Pusher:
    """Pushes towards the goal, with all it has."""

    action, observation = "field", "state"
    name = "pusher"

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> Any:
        seen = np.asarray(observation)
        action = np.zeros((*seen.shape[:-1], 1, 6), dtype=np.float32)
        action[..., 0, 0:2] = seen[..., STATE_ERROR] - 0.8 * seen[..., 15:17]
        return action, state


class Counting(Pusher):
    """Pushes in a direction that turns with every step, counted in its state; starts over with each episode."""

    name = "counting"

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> Any:
        seen = np.asarray(observation)
        count = np.zeros(len(seen)) if state is None else state.copy()
        count[episode_start] = 0.0
        action = np.zeros((len(seen), 1, 6), dtype=np.float32)
        action[:, 0, 0], action[:, 0, 1] = np.cos(0.1 * count), np.sin(0.1 * count)
        return action, count + 1.0


class Still(Pusher):
    """Does <nothing> & says so."""

    name = "still <&>"

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> Any:
        return np.zeros((len(observation), 1, 6), dtype=np.float32), state


@pytest.fixture(scope="session")
def found(tmp_path_factory: pytest.TempPathFactory) -> evaluation.Results:
    """Results of three policies on two tasks."""
    directory: Path = tmp_path_factory.mktemp("evaluation") / "new" / "report"
    settings = evaluation.settings_from(
        {
            "tasks": ["Transport", "Align"],
            "policies": [Still(), Pusher(), Counting()],
            "episodes": 8,
            "first_seed": 300,
            "resamples": 200,
            "output": str(directory),
        }
    )
    return evaluation.evaluate(evaluation.prepare(settings), quiet=True)


@pytest.fixture(scope="session")
def written(found: evaluation.Results) -> Path:
    """Directory with the files of these results."""
    return evaluation.write(found, quiet=True).parent
