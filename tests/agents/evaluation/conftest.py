"""Two small evaluations that run once for all tests of this folder: of one part, and of several and other hardware."""

import numpy as np
import pytest

from agents.evaluation import EvaluationSettings, evaluate, prepare, report
from agents.evaluation.films import Log
from agents.evaluation.table import REPORT
from vibgym.policies.rollout import rollout

STATE_ERROR = slice(8, 10)  # tanh of goal minus centre in 50 mm, see the environment's table


class Pusher:
    """Pushes towards the goal, with all it has."""

    action, observation = "field", "state"
    name = "pusher"

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        seen = np.asarray(observation)
        action = np.zeros((*seen.shape[:-1], 1, 6), dtype=np.float32)
        action[..., 0, 0:2] = seen[..., STATE_ERROR] - 0.8 * seen[..., 15:17]
        return action, state


class Counting(Pusher):
    """Pushes in a direction that turns with every step, counted in its state; starts over with each episode."""

    name = "counting"

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        seen = np.asarray(observation)
        count = np.zeros(len(seen)) if state is None else state.copy()
        count[episode_start] = 0.0
        action = np.zeros((len(seen), 1, 6), dtype=np.float32)
        action[:, 0, 0], action[:, 0, 1] = np.cos(0.1 * count), np.sin(0.1 * count)
        return action, count + 1.0


class Still(Pusher):
    """Does <nothing> & says so."""

    name = "still <&>"

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.zeros((len(observation), 1, 6), dtype=np.float32), state


LATE = {"kind": "prototype", "dead_zone": 0.0, "gain_spread": 0.0, "phase_spread": 0.0, "latency": 3}
BROKEN = {"kind": "prototype", "dead": 1.0, "latency": 0}
SENSOR = {"kind": "pose", "noise": 0.0, "delay": 5}
CASES = {"none": {}, "latency": {"actuators": {**LATE, "latency": 4}}, "all dead": {"actuators": {**LATE, "dead": 1.0}}}

PLAIN = {
    "tasks": ["Transport", "Align"],
    "policies": [Still(), Pusher(), Counting()],
    "episodes": 8,
    "first_seed": 300,
    "resamples": 200,
}
SEVERAL = {
    "tasks": ["Transport", "Sort", "Singulate"],
    "policies": [
        {"name": "still", "policy": Still(), "tasks": ["Transport"], "hardware": ["ideal"]},
        {"name": "pusher", "policy": Pusher(), "tasks": ["Transport"]},
        {"kind": "local_field", "tasks": ["Sort", "Singulate"]},
        {"kind": "zero", "tasks": ["Sort", "Singulate"]},
    ],
    "episodes": 5,
    "task_episodes": {"Sort": 6},
    "first_seed": 300,
    "resamples": 200,
    "hardware": {
        "ideal": {},
        "broken": {"actuators": BROKEN, "tasks": ["Transport"], "episodes": 4},
        "late": {"actuators": LATE, "tasks": ["Transport"]},
    },
    "effects": {
        "task": "Transport",
        "policies": ["pusher", {"policy": "pusher", "name": "late <eyes>", "sensor": SENSOR}],
        "episodes": 4,
        "cases": CASES,
    },
}


def evaluated(data, output, kind=EvaluationSettings):
    """Return the results of settings."""
    return evaluate(prepare(kind.checked(data, output=str(output))), quiet=True)


def rollouts(results):
    """Return records of the same episodes with all poses, by task, hardware and policy."""
    return {
        case.place[1:]: rollout(case.policy, case.task, seeds=case.seeds, keep=Log, **case.environment)
        for case in results.cases
        if case.place.study == REPORT
    }


@pytest.fixture(scope="session")
def basic(tmp_path_factory):
    """Results of three policies on two tasks."""
    return evaluated(PLAIN, tmp_path_factory.mktemp("evaluation") / "new" / "report")


@pytest.fixture(scope="session")
def played(basic):
    """Its episodes with all poses."""
    return rollouts(basic)


@pytest.fixture(scope="session")
def written(basic):
    """Directory with its files."""
    return report.write(basic, quiet=True)[0].parent


@pytest.fixture(scope="session")
def several(tmp_path_factory):
    """Results on tasks for several parts, and on one for one part with three hardware models and a study of effects."""
    return evaluated(SEVERAL, tmp_path_factory.mktemp("several") / "report")


@pytest.fixture(scope="session")
def played_several(several):
    """Its episodes with all poses."""
    return rollouts(several)


@pytest.fixture(scope="session")
def written_several(several):
    """Directory with its files."""
    return report.write(several, quiet=True)[0].parent
