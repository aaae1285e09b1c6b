"""Other machines of Table 1.1, compared with the segmented surface."""

import math
from pathlib import Path

import numpy as np
import pytest

from studies.rivals import figures
from studies.rivals.__main__ import main
from studies.rivals.by_turns import ByTurnsPolicy
from studies.rivals.figures import OWN_SPEED, played, policy_of, row_of, scene_of, strength_of
from studies.rivals.film import FILM, Sweep, frames
from studies.rivals.film import played as seen
from studies.rivals.machines import MACHINES, register
from studies.rivals.policies import OUTPUTS
from studies.rivals.reach import rows
from tests.commands import refusal
from vibgym import Part, Simulator, Surface
from vibgym.envs import ACTIONS
from vibgym.envs.vector import batch_of, environment_id
from vibgym.fields import uniform
from vibgym.policies.task_info import TaskInfo

SURFACE = Surface()
BLOCK = Part.rectangle(0.050, 0.035, friction=0.58)
ROOT = Path(__file__).parents[3]


@pytest.fixture(autouse=True)
def registered(monkeypatch):
    """Register the machines for one test, since other tests use all registered actions."""
    monkeypatch.setattr(ACTIONS, "_items", dict(ACTIONS))
    register()


def machine(name):
    return MACHINES[name](SURFACE, (BLOCK,))


def uniform_values(shape, seed=1):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, shape)


def test_a_stroke_pushes_around_its_centre_with_uniform_strength():
    plate, centre = machine("plate"), np.array([0.2, 0.05])
    stroke = np.array([centre[1] - 0.5 * SURFACE.depth, 0.5 * SURFACE.width - centre[0], plate.half])
    push = plate.pushes(stroke[None] / np.linalg.norm(stroke))[0]
    away = np.stack(SURFACE.element_centres(), axis=-1) - centre
    distance = np.hypot(away[..., 0], away[..., 1])
    assert np.abs((push * away).sum(axis=-1)).max() < 1e-12
    assert np.hypot(push[..., 0], push[..., 1]) == pytest.approx(np.minimum(distance / plate.core, 1.0))


def test_proportional_pushes_are_those_of_a_rigid_body():
    push = machine("plain-plate").pushes(uniform_values((20, 3)))
    place = np.stack(SURFACE.element_centres(), axis=-1).reshape(-1, 2)
    push = push.reshape(20, -1, 2)
    apart, differ = place[:, None] - place, push[:, :, None] - push[:, None]
    assert np.abs((apart * differ).sum(axis=-1)).max() < 1e-12  # distances between points are constant


@pytest.mark.parametrize("name", ["conveyor", "one-way"])
def test_cells_push_along_their_own_axis(name):
    tested, values = machine(name), uniform_values((10, 256))
    push = tested.pushes(values)
    along = (push * tested.axis).sum(axis=-1)
    assert np.abs(push - along[..., None] * tested.axis).max() == 0.0
    least = -1.0 if name == "conveyor" else 0.0
    assert along == pytest.approx(np.maximum(values.reshape(10, 8, 32), least))


@pytest.mark.parametrize("name", MACHINES)
def test_elements_move_as_commanded_within_the_limit(name):
    tested = machine(name)
    push = tested.pushes(uniform_values((50, tested.size)))
    assert push.shape == (50, 8, 32, 2) and np.hypot(push[..., 0], push[..., 1]).max() <= 1.0 + 1e-12
    assert (tested.pushes(np.zeros((1, tested.size))) == 0.0).all()
    env = batch_of(environment_id("Transport"), num_envs=3, action=name)
    env.reset(seed=[1, 2, 3])
    action = uniform_values((3, env.unwrapped.core.action.size)).astype(np.float32)
    env.step(action)
    push = env.unwrapped.core.action.pushes(action.astype(np.float64))
    done = np.stack([env.unwrapped.core.phasors(world) for world in range(3)])
    assert done == pytest.approx(-push[..., ::-1], abs=1e-6)
    env.close()


@pytest.mark.parametrize("name", MACHINES)
def test_fitted_commands_are_better_than_random_ones(name):
    env = batch_of(environment_id("Sort"), num_envs=4, action=name)
    env.reset(seed=list(range(4)))
    info, pose = TaskInfo.of(env), env.unwrapped.truth.pose.copy()
    env.close()
    output = OUTPUTS[name](info, MACHINES[name](info.surface, info.parts))
    present, wanted = np.ones(pose.shape[:2], dtype=bool), uniform_values(pose.shape)
    if name == "plain-plate":  # so that no corner is at its limit, where strokes are scaled down
        wanted *= 0.02
    weight = np.broadcast_to(output.weight, pose.shape).copy()

    def error(action):
        effect = output.allocator.effect(pose, present, output.machine.pushes(action))
        return (weight * (effect - wanted) ** 2).sum(axis=(1, 2))

    command = output.fit(pose, present, wanted, weight)
    best = error(command)
    assert (best < error(np.zeros_like(command))).all()
    rng = np.random.default_rng(3)
    for size in (0.01, 0.1, 1.0):
        for _ in range(50):
            other = np.clip(command + size * rng.normal(size=command.shape), -1.0, 1.0)
            if name == "plate":  # searched on a lattice and refined
                other /= np.maximum(np.linalg.norm(other, axis=1), 1.0)[:, None]
                assert (best <= 1.03 * error(other) + 1e-3).all()
            else:  # up to the regularization
                assert (best <= error(other) + (1e-3 if "plate" not in name else 1e-9)).all()


def test_the_plate_at_its_own_speed_has_the_speed_of_table_1_1():
    strength = strength_of(SURFACE, OWN_SPEED)
    simulator = Simulator(SURFACE, (BLOCK,))
    simulator.reset([[[0.1, 0.104, 0.0]]])
    simulator.advance(*uniform(0.0, strength).drive(SURFACE), periods=60)
    assert math.hypot(*simulator.state.mean_velocity[0, 0, :2]) == pytest.approx(OWN_SPEED, rel=0.05)
    assert policy_of("plate-own-speed", "Transport").info.hardware.limit == pytest.approx(
        strength * SURFACE.max_amplitude
    )
    assert "actuators" not in scene_of("plate")


def test_shares_of_the_push_depend_on_degrees_of_freedom():
    cells = {(row["machine"], row["parts"]): row for row in rows(samples=2, counts=(1, 2))}
    assert cells["segmented", 2]["share"] > 0.9
    assert cells["plate", 1]["share"] > 0.99 and 0.1 < cells["plate", 2]["share"] < 1.0
    assert cells["plain-plate", 1]["share"] > 0.99 and cells["plain-plate", 2]["none"] == 1.0
    # Conveyors give half of a uniform push in a random direction, or more along a diagonal.
    assert 0.3 < cells["conveyor", 1]["share"] < 0.8 and cells["one-way", 1]["share"] < cells["conveyor", 1]["share"]


@pytest.mark.parametrize("name", ["plate", "conveyor", "one-way"])
def test_machines_solve_transport(name):
    results, first = (played(machine, "Transport", 6) for machine in (name, "segmented"))
    row = row_of(name, "Transport", results, first)
    assert row["success"] == 1.0 and row["success_low"] < 1.0 and not row["fallen"]
    ratio = results.time_to_goal / first.time_to_goal
    assert row["time_ratio"] == pytest.approx(np.exp(np.log(ratio).mean()))


def test_the_plate_sorts_and_requires_zones():
    assert played("plate", "Sort", 2).success.all()
    info = TaskInfo.of(batch_of(environment_id("Transport"), num_envs=1, action="plate"))
    with pytest.raises(ValueError, match="by turns"):
        ByTurnsPolicy(info, "plate")


def test_the_film_shows_the_line_and_the_parts():
    slow = Sweep(0.15, 0.1, 0.16, "slow")
    pictures, poses = frames((slow,)), [pose for pose, *_ in seen((slow,))]
    assert len(poses) == 4 and len(pictures) == 2 and pictures[0].shape[2] == 3
    assert (pictures[0] != pictures[1]).any() and (ROOT / FILM).stat().st_size < 1e6


def test_new_rows_replace_those_of_their_task(tmp_path):
    path = tmp_path / "results" / "rivals.csv"
    figures.store(
        path, [{"task": "Sort", "machine": "plate", "time": 1.5}, {"task": "Align", "machine": "plate", "time": 0.1}]
    )
    figures.store(path, [{"task": "Sort", "machine": "conveyor", "time": math.nan}])
    assert path.read_text() == "task,machine,time\nAlign,plate,0.1\nSort,conveyor,\n"


def test_unknown_tasks_are_rejected(capsys):
    assert "--task" in refusal(capsys, main, "figures", "--task", "Juggle")
