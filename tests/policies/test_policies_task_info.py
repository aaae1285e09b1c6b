"""Task info for policies."""

import dataclasses
import math

import gymnasium as gym
import pytest

from tests.envs.helpers import batch, single
from tests.policies.helpers import info_of
from vibgym.envs import VibgymEnv, VibgymVectorEnv
from vibgym.policies.task_info import TaskInfo


def test_it_agrees_with_the_environments_properties():
    env = single("SortThreeKinds", slots=8, walls=["left", "top"])
    info = TaskInfo.of(env)
    assert info.name == "SortThreeKinds" and info.summary.startswith("Every present part's centre inside its")
    assert info.surface is env.unwrapped.surface and info.parts == env.unwrapped.parts and len(info.parts) == 6
    assert info.kinds == ("steel_block", "aluminium_block", "disc") and info.kind == (0, 1, 2, 0, 1, 2)
    assert info.walls == ("left", "top") and info.zones.shape == (3, 4)
    assert (info.has_goal, info.has_heading, info.apart) == (False, False, None)
    assert info.layout.size == 160 and info.layout.rows == env.unwrapped.observation_layout
    apart = info_of("Singulate")
    assert apart.zones is None and apart.apart == pytest.approx(math.sqrt(2) * 0.026) and apart.layout.size == 120


@pytest.mark.parametrize("task, heading, wraps, tolerances", [
    ("Transport", False, True, (0.005, math.inf)), ("Align", True, True, (0.002, math.radians(3))),
    ("Rotate", True, False, (0.005, math.radians(2))),
])  # fmt: skip
def test_goals_and_tolerances(task, heading, wraps, tolerances):
    info = info_of(task)
    assert info.has_goal and (info.has_heading, info.wraps) == (heading, wraps)
    assert (info.position_tolerance, info.heading_tolerance) == pytest.approx(tolerances)
    assert info.layout.size == 18 and info.zones is None and info.apart is None


@pytest.mark.parametrize("settings, steps, time", [({}, 250, 0.04), ({"periods_per_step": 4}, 63, 0.16)])
def test_step_time_is_that_of_the_environment(settings, steps, time):
    for env in (single("Align", **settings), batch("Align", 2, **settings)):
        info = TaskInfo.of(env)
        assert (info.step_limit, info.periods_per_step) == (steps, settings.get("periods_per_step", 1))
        assert info.step_time == pytest.approx(time)
    assert TaskInfo.of(single("Align", max_episode_steps=30, **settings)).step_limit == 30


def test_single_vector_wrapped_and_plain_environments_have_the_same_info():
    plain = {"task": "Sort", "slots": 7}
    infos = [TaskInfo.of(env) for env in (
        single("Sort", slots=7), batch("Sort", 3, slots=7), gym.wrappers.ClipAction(single("Sort", slots=7)),
        VibgymEnv(**plain), VibgymVectorEnv(num_envs=2, **plain),
    )]  # fmt: skip
    for field in dataclasses.fields(TaskInfo):
        if field.name not in ("surface", "parts", "layout", "zones", "step_limit", "scene", "observation_space"):
            assert len({getattr(info, field.name) for info in infos}) == 1, field.name
    assert {tuple(part.name for part in info.parts) for info in infos} == {("steel_block", "aluminium_block") * 3}
    assert {info.layout.rows for info in infos} == {infos[0].layout.rows}
    assert all(info.scene == infos[0].scene for info in infos) and infos[0].scene["slots"] == 7
    assert [info.step_limit for info in infos] == [750] * 3 + [None] * 2
    assert TaskInfo.of(single("Align"), "mine").name == "mine"


def test_it_is_read_only_and_independent_of_the_episode():
    env = single("Sort")
    info, zones = TaskInfo.of(env), env.unwrapped.task.zones.copy()
    with pytest.raises(ValueError, match="read-only"):
        info.zones[0, 0] = 1.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        info.name = "other"
    assert (env.unwrapped.task.zones == zones).all() and info.zones is not env.unwrapped.task.zones
    held = {id(value) for value in vars(info).values()}
    core = env.unwrapped.core
    assert not held & {id(owner) for owner in (core, core.task, core.episode, core.simulator, core.observation.layout)}
