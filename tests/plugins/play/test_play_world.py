"""Interactive world: physics of the environment, and interventions."""

import gymnasium as gym
import numpy as np
import pytest

import vibgym
from vibgym.plugins.play.choices import settings_of
from vibgym.plugins.play.picture import frame_of, scene_of
from vibgym.plugins.play.world import World
from vibgym.policies import TaskInfo
from vibgym.policies.applicable import policies_of
from vibgym.policies.task_info import POLICIES


def poses(world):
    return world.core.simulator.pose[0]


def stepped(world, count):
    """Step a world so many times, and return it."""
    for _ in range(count):
        world.step()
    return world


@pytest.mark.parametrize(("task", "policy", "hardware"), [
    ("Align", "pose", "ideal"), ("Align", "learned", "ideal"), ("Sort", "planner", "ideal"), ("Feed", "lanes", "ideal"),
    *(("Sort", {"kind": "planner", "action": action}, hardware)
      for action in ("velocity", "target") for hardware in ("ideal", "prototype")),
])  # fmt: skip
def test_a_world_without_interventions_equals_the_environment(task, policy, hardware, monkeypatch):
    """Up to float32 phasors, which the world computes with a memory of its own; undo restores it."""
    if not isinstance(policy, str):
        settings = policy
        monkeypatch.setitem(POLICIES._items, "mine", lambda info: vibgym.make_policy(settings, info))
        policy = "mine"
    world = World(settings_of(task, policy=policy, hardware=hardware), seed=3)
    arguments = {**world.settings.arguments(), "action": "phasor"}
    acting = vibgym.make_policy(policy, TaskInfo.of(gym.make(f"vibgym/{task}-v0", **arguments)))
    arguments |= {"action": acting.action, "observation": acting.observation}
    env = gym.make(f"vibgym/{task}-v0", **arguments).unwrapped
    (seen, _), state = env.reset(seed=3), None
    for step in range(30):
        if step == 15:
            kept = world.get_state()
        world.step()
        action, state = acting.predict(seen, state)
        seen, *_ = env.step(action)
    np.testing.assert_allclose(poses(world), env.truth.pose[0], atol=1e-6 if policy == "mine" else 2e-5)
    there = poses(world)
    world.set_state(kept)
    assert np.array_equal(poses(stepped(world, 15)), there)


@pytest.mark.parametrize("task", ["Align", "Sort", "Follow", "Feed", "Pack", "Push"])
def test_a_snapshot_goes_on_bit_for_bit(task):
    world = stepped(World(settings_of(task, hardware="ideal" if task == "Push" else "prototype"), seed=1), 10)
    kept = world.get_state()
    stepped(world, 10)
    first, field = poses(world), world.wanted.copy()
    world.set_state(kept)
    stepped(world, 10)
    assert np.array_equal(first, poses(world)) and np.array_equal(field, world.wanted)


def test_a_lifted_part_is_moved_and_brought_back_by_the_controller():
    world = stepped(World(settings_of("Align"), seed=0), 1)
    world.lift(0)
    world.carry(0, np.array([0.7, 0.15, 1.0]))
    stepped(world, 5)
    assert poses(world)[0].tolist() == [0.7, 0.15, 1.0]
    assert world.room(0) == ""
    world.place(0)
    assert not world.core.simulator.fallen.any()
    stepped(world, 200)
    assert world.info["is_success"] and world.info["position_error"] < 2e-3


def test_there_is_no_room_on_another_part():
    world = World(settings_of("Sort"), seed=0)
    world.lift(0)
    world.carry(0, poses(world)[1] + [0.005, 0.0, 0.0])
    assert world.room(0)
    with pytest.raises(ValueError, match="pose"):
        world.place(0)
    assert list(world.held) == [0], "it stays in the hand"
    world.carry(0, np.array([2.0, 0.1, 0.0]))
    assert world.room(0)


def test_the_controller_follows_a_moved_goal():
    world = stepped(World(settings_of("Align", hardware="prototype"), seed=0), 1)
    world.aim(0, np.array([0.6, 0.12, 0.5]))
    stepped(world, 150)
    assert np.hypot(*(poses(world)[0, :2] - [0.6, 0.12])) < 2e-3


@pytest.mark.parametrize("task", ["Sort", "Follow", "Feed"])
def test_tasks_without_fixed_goals_refuse_moved_goals(task):
    world = World(settings_of(task))
    with pytest.raises(ValueError, match="goal"):
        world.aim(0, np.array([0.4, 0.1, 0.0]))


def test_a_brush_alone_drives_a_part_along_its_stroke():
    """An element pushes towards (-S, -C): here to the right."""
    world = World(settings_of("Transport", policy="zero"), seed=2)
    before = poses(world)[0, 0]
    rows, columns = world.paint.shape[:2]
    world.draw(np.argwhere(np.ones((rows, columns))), np.array([0.0, -1.0]))
    stepped(world, 12)
    assert poses(world)[0, 0] > before + 0.03


@pytest.mark.parametrize(
    "change", [{"hardware": "prototype"}, {"hardware": "camera"}, {"model": "tilting"}, {"rate": 1.0}]
)
def test_a_switch_changes_the_hardware_and_keeps_the_parts(change):
    world = stepped(World(settings_of("Sort"), seed=0), 10)
    before, moving, goal = poses(world), world.core.simulator.mean_velocity[0], world.core.episode.goal.copy()
    world.switch(settings_of(**{**vars(world.settings), **change}))
    assert np.array_equal(poses(world), before) and np.array_equal(world.core.simulator.mean_velocity[0], moving)
    assert np.array_equal(world.core.episode.goal, goal)
    stepped(world, 10)
    assert np.isfinite(poses(world)).all()


def test_a_switch_that_does_not_fit_changes_nothing():
    world = World(settings_of("Push"), seed=0)
    world.step()
    env, before = world.env, poses(world)
    with pytest.raises(ValueError, match="parts"):
        world.switch(settings_of(**{**vars(world.settings), "model": "tilting"}))
    with pytest.raises(ValueError, match="policy"):
        world.switch(settings_of(**{**vars(world.settings), "policy": "open_loop"}))
    assert world.env is env and np.array_equal(poses(world), before)


@pytest.mark.parametrize(("bad", "names"), [
    ({"id": "Alin"}, "id"), ({"id": "CartPole-v1"}, "id"), ({"id": "Align", "model": "exact"}, "model"),
    ({"id": "Align", "rate": 1e9}, "rate"), ({"id": "Align", "tilt": 0.0}, "tilt"),
])  # fmt: skip
def test_bad_settings_are_named(bad, names):
    with pytest.raises(ValueError, match=names):
        World(settings_of(**bad))


def test_every_registered_environment_can_be_played():
    for name in sorted(registered for registered in gym.registry if registered.startswith("vibgym/")):
        world = World(settings_of(name))
        world.step()
        scene, frame = scene_of(world), frame_of(world)
        assert scene["policy"] in scene["policies"] and len(frame["pose"]) == len(scene["outlines"])
        assert "zero" in policies_of(TaskInfo.of(world.env))
