"""Registration, saved specifications, keyword arguments good and bad, rendering."""

import inspect
import json
import subprocess
import sys

import numpy as np
import pytest

import vibgym
from tests.envs.helpers import TASKS, batch, put, single
from vibgym.envs import Options, VibgymEnv, VibgymVectorEnv
from vibgym.tasks import TASKS as TASKS_OF_ALL
from vibgym.tasks import ArrangedTask

FULL = {
    "surface": {"rows": 6, "columns": 20, "element_size_mm": 30.0, "horizontal_amplitude": 0.003, "max_amplitude": 3e-4},
    "parts": [
        {"shape": "polygon", "vertices_mm": [[0, 0], [50, 0], [50, 30], [30, 30], [30, 50], [0, 50]], "friction": 0.5,
         "static_friction": 0.55, "height_mm": 10, "mass_g": 150, "name": "bracket"},
    ],
}  # fmt: skip


def test_settings_take_effect():
    core = single("Align", **FULL).unwrapped.core
    assert (core.surface.rows, core.surface.columns, core.surface.element_size) == (6, 20, 0.03)
    assert core.surface.max_amplitude == 3e-4
    (part,) = core.parts
    assert part.name == "bracket" and part.mass == pytest.approx(0.15) and part.height == 0.01
    assert part.area == pytest.approx(0.05**2 - 0.02**2) and part.static_friction == 0.55
    default = single("Align").unwrapped.core
    assert (default.surface.rows, default.surface.columns, default.parts[0].name) == (8, 32, "aluminium_block")
    assert single("Align", parts=["steel_block"]).unwrapped.core.parts[0].friction == 0.64
    assert single("Align", surface=vibgym.Surface(rows=5)).unwrapped.core.surface.rows == 5
    disc = vibgym.Part.disc(0.02, friction=0.3)
    assert single("Align", parts=[disc]).unwrapped.core.parts[0] is disc


def test_make_imports_the_package_in_a_fresh_process():
    code = (
        "import gymnasium as gym; env = gym.make('vibgym:vibgym/Rotate-v0'); env.reset(seed=0);"
        "vec = gym.make_vec('vibgym:vibgym/Rotate-v0', num_envs=2); vec.reset(seed=0); print(type(vec.unwrapped).__name__)"
    )
    result = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    assert result.stdout.strip() == "VibgymVectorEnv"


STICKY = {"horizontal_amplitude": 4e-4}
BAD = [  # fields of surface and part: see tests/test_config.py; unknown names: see tests/contracts
    ({"surface": "table"}, "surface"),
    ({"surface": {"rows": 2, "columns": 2}}, "parts"),  # too small for the part
    ({"surface": STICKY, "model": "averaged"}, "model"),  # covers permanent sliding only
    ({"parts": []}, "parts"),
    ({"parts": ["aluminium_block", "steel_block"]}, "parts"),
    ({"parts": ["gold_block"]}, "parts"),
    ({"observation": "camera"}, "observation"),
    ({"randomize": {"dead_zone": [0.0, 1e-4]}}, "randomize"),
    ({"randomize": {"parts": [1, 1]}}, "randomize"),
    ({"periods_per_step": 1.5}, "periods_per_step"),
]
BAD_OF_SEVERAL = [
    ({"parts": ["steel_block", {"shape": "disc", "friction": 0.5}]}, r"parts\[1\]\.radius"),
    ({"surface": {"rows": 2, "columns": 2}}, "parts"),
    ({"surface": {"columns": 8}}, "zones"),
    ({"zones": {"steel_block": [0, 0, 0.1, 0.1]}}, "zones"),
    ({"start": "stacked"}, "start"),
    ({"slots": 2}, "slots"),
    ({"walls": ["left", "left"]}, "walls"),
    ({"walls": ["north"]}, "walls"),
    ({"model": "averaged"}, "model"),
    ({"colour": "red"}, r"keyword argument"),
]
OF_OTHER_TASKS = [
    ("Align", {"walls": ["left"]}), ("Align", {"slots": 3}), ("Align", {"start": "crowded"}), ("Align", {"zones": {}}),
    ("Singulate", {"start": "crowded"}), ("Singulate", {"zones": {}}), ("Align", {"paths": {"speed": 0.1}}),
]  # fmt: skip
FAULTS = [
    *(("Align", *each) for each in BAD),
    *(("Sort", *each) for each in BAD_OF_SEVERAL),
    *((task, settings, next(iter(settings))) for task, settings in OF_OTHER_TASKS),
]


@pytest.mark.parametrize("task, settings, name", FAULTS, ids=lambda each: str(each)[:50])
def test_bad_settings_are_one_error_that_names_them(task, settings, name):
    for make in (lambda: single(task, **settings), lambda: batch(task, 2, **settings)):
        with pytest.raises(ValueError, match=name) as error:
            make()
        assert "\n" not in str(error.value)


def test_sticking_parts_are_allowed():
    """On a slow table friction holds the part for every command; it circles with the table."""
    env = single("Align", surface={"horizontal_amplitude": 1.5e-4, "max_amplitude": 5e-5})
    env.reset(seed=0)
    simulator = env.unwrapped.core.simulator
    start = simulator.pose
    for _ in range(20):
        env.step(np.full(env.action_space.shape, -1.0, dtype=np.float32))
    assert simulator.sticking.all() and np.abs(simulator.pose - start).max() < 2e-3


@pytest.mark.parametrize("name, value", [
    ("num_envs", 0), ("num_envs", 2.0), ("autoreset_mode", "Sometimes"), ("max_episode_steps", 0), ("render_mode", "human"),
])  # fmt: skip
def test_bad_settings_of_a_batch(name, value):
    with pytest.raises(ValueError, match=name):
        VibgymVectorEnv("Align", **{"num_envs": 2, name: value})
    with pytest.raises(ValueError, match="render_mode"):
        VibgymEnv("Align", render_mode="pixels")


def test_the_record_of_options():
    """Constructors have the options as keyword arguments; unknown options are refused, and values cannot be changed."""
    for cls in (VibgymEnv, VibgymVectorEnv):
        parameters = inspect.signature(cls).parameters
        assert all(parameters[name].default == Options.model_fields[name].default for name in Options.names())
    options = Options.of("Sort", {"slots": 8, "shapes": np.array([1, 2])})
    assert (options.slots, options.model, tuple(options.shapes)) == (8, "planar", (1, 2))
    with pytest.raises(ValueError, match="did you mean 'slots'.*word"):
        Options.of("Sort", {"slot": 1}, ("word",))
    with pytest.raises(ValueError, match="frozen"):
        options.slots = 3
    assert "max_episode_periods" not in json.loads(single("Align").unwrapped.core.identity)


class Two(ArrangedTask):
    """Every part has a goal pose, and no PoseTask's reward."""

    has_goal = True


def test_tasks_without_a_goal_observation_are_refused_with_alternatives(monkeypatch):
    monkeypatch.setitem(TASKS_OF_ALL._items, "Two", Two)
    for task in ("Two", "Sort", "Follow"):
        for make in (VibgymEnv, VibgymVectorEnv):
            with pytest.raises(ValueError, match="observation"):
                make(task, observation="goal")
        for each in ("state", "parts", "image"):
            VibgymEnv(task, observation=each)


# -- rendering ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("task", TASKS)
def test_rgb_array(task):
    env = single(task, action="field", render_mode="rgb_array")
    env.reset(seed=0)
    first = env.render()
    height, width, channels = first.shape
    assert first.dtype == np.uint8 and channels == 3 and width > 300 and height > 80
    put(env, [0.2, 0.1, 0.0])
    env.step(np.ones((1, 6), dtype=np.float32))
    second = env.render()
    assert second.shape == first.shape and (first != second).any()
    env.step(np.ones((1, 6), dtype=np.float32))
    third = second.copy()
    env.render()
    assert (second == third).all()  # nothing returned is overwritten
    env.close()


def test_rgb_array_of_a_batch_is_one_picture_a_world():
    env = batch("Rotate", 3, action="field", render_mode="rgb_array", max_episode_steps=4)
    ones = [single("Rotate", action="field", render_mode="rgb_array", max_episode_steps=4) for _ in range(3)]
    env.reset(seed=4)
    for k, one in enumerate(ones):
        one.reset(seed=4 + k)
    action = np.random.default_rng(0).uniform(-1, 1, (3, 1, 6)).astype(np.float32)
    for _ in range(3):
        env.step(action)
        pictures = env.render()
        assert isinstance(pictures, tuple) and len(pictures) == 3
        for k, one in enumerate(ones):
            one.step(action[k])
            assert (pictures[k] == one.render()).all()
    env.close()


def test_human_mode_opens_a_window(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    env = single("Align", action="field", render_mode="human")
    env.reset(seed=0)
    window = env.unwrapped._viewer.window
    assert window.is_open
    for _ in range(3):
        env.step(np.zeros((1, 6), dtype=np.float32))
        assert env.render() is None
    assert window.is_open
    env.close()
    assert not window.is_open
    env.close()


def test_pictures_show_zones_and_present_parts():
    pictures = {}
    for count in (1, 6):
        env = single("Sort", action="field", render_mode="rgb_array", randomize={"parts": [count, count]})
        env.reset(seed=0)
        env.action_space.seed(0)
        for _ in range(3):
            env.step(env.action_space.sample())
        scenery = env.unwrapped._viewer._sceneries[0]
        assert env.unwrapped.truth.present[0].sum() == count
        pictures[count] = env.render()
    assert [(zone.kind, zone.label) for zone in scenery.zones] == [(0, "steel block"), (1, "aluminium block")]
    assert scenery.zones[1].low == pytest.approx((0.676, 0.0))
    assert scenery.zones[1].high == pytest.approx((0.832, 0.208))
    assert (pictures[1] != pictures[6]).any()
    dark = [(picture.sum(axis=2) < 250).sum() for picture in pictures.values()]
    assert dark[1] > 1.5 * dark[0]  # six parts cover more than one


@pytest.mark.parametrize("action", ["element", "phasor", "patch", "field"])
def test_images_show_the_step_even_if_the_caller_reuses_the_action_array(action):
    one, many = (
        single("Align", action=action, render_mode="rgb_array"),
        batch("Align", 2, action=action, render_mode="rgb_array"),
    )
    for env, render in ((one, one.render), (many, lambda: many.render()[0])):
        env.reset(seed=0)
        values = np.full(env.action_space.shape, 0.5, dtype=np.float32)
        env.step(values)
        before = render()
        values[:] = -0.5
        assert (render() == before).all()
        env.step(values)
        assert (render() != before).any()
