"""Pictures of environments: of a batch, of zones, in a window, of copies, and from the side with ``model="tilting"``."""

import copy
import pickle

import numpy as np
import pytest

from tests.envs.helpers import batch, single

pytest.importorskip("pygame")

from vibgym.rendering.side import HEIGHT, MAGNIFIED

COPIES = [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))]


def test_a_batch_has_one_picture_a_world():
    """Equal to those of single environments; nothing returned is overwritten."""
    settings = {"action": "field", "render_mode": "rgb_array", "max_episode_steps": 4}
    env, ones = batch("Rotate", 3, **settings), [single("Rotate", **settings) for _ in range(3)]
    env.reset(seed=4)
    for k, one in enumerate(ones):
        one.reset(seed=4 + k)
    action, before = np.random.default_rng(0).uniform(-1, 1, (3, 1, 6)).astype(np.float32), None
    for _ in range(3):
        env.step(action)
        pictures = env.render()
        assert isinstance(pictures, tuple) and len(pictures) == 3
        for k, one in enumerate(ones):
            one.step(action[k])
            assert (pictures[k] == one.render()).all()
        height, width, channels = pictures[0].shape
        assert pictures[0].dtype == np.uint8 and channels == 3 and width > 300 and height > 80
        if before is not None:
            assert (before[0] == before[1]).all() and (before[0] != pictures[0]).any()
        before = pictures[0], pictures[0].copy()


@pytest.mark.parametrize("action", ["element", "phasor", "patch", "field"])
def test_pictures_show_the_step_even_if_the_caller_reuses_the_action_array(action):
    one = single("Align", action=action, render_mode="rgb_array")
    many = batch("Align", 2, action=action, render_mode="rgb_array")
    for env, render in ((one, one.render), (many, lambda: many.render()[0])):
        env.reset(seed=0)
        values = np.full(env.action_space.shape, 0.5, dtype=np.float32)
        env.step(values)
        before = render()
        values[:] = -0.5
        assert (render() == before).all()
        env.step(values)
        assert (render() != before).any()


def test_pictures_show_zones_and_present_parts():
    pictures = {}
    for count in (1, 6):
        env = single("Sort", action="phasor", render_mode="rgb_array", randomize={"parts": [count, count]})
        env.reset(seed=0)
        env.step(np.zeros(env.action_space.shape))
        scenery = env.unwrapped._viewer._sceneries[0]
        assert env.unwrapped.truth.present[0].sum() == count
        pictures[count] = env.render()
    assert [(zone.kind, zone.label) for zone in scenery.zones] == [(0, "steel block"), (1, "aluminium block")]
    assert scenery.zones[1].low == pytest.approx((0.676, 0.0))
    assert scenery.zones[1].high == pytest.approx((0.832, 0.208))
    dark = [(picture.sum(axis=2) < 250).sum() for picture in pictures.values()]
    assert dark[1] > 1.3 * dark[0]  # six parts cover more than one


@pytest.mark.parametrize("copied", COPIES, ids=["deepcopy", "pickle"])
def test_a_window_on_the_screen_stays_with_the_original(monkeypatch, copied):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    env = single("Align", action="field", render_mode="human")
    env.reset(seed=3)
    env.step(np.zeros(6, dtype=np.float32))
    assert env.render() is None
    again = copied(env)
    assert env.unwrapped._viewer.window.is_open and not again.unwrapped._viewer.window.is_open
    env.close()
    env.close()
    assert not env.unwrapped._viewer.window.is_open
    again.step(np.zeros(6, dtype=np.float32))
    assert again.unwrapped._viewer.window.is_open
    again.close()


@pytest.mark.parametrize("copied", COPIES, ids=["deepcopy", "pickle"])
def test_a_copy_has_pictures_of_its_own(copied):
    env = single("Sort", action="field", render_mode="rgb_array")
    env.reset(seed=3)
    push = np.full(env.action_space.shape, 0.5, dtype=np.float32)
    env.step(push)
    again = copied(env)
    np.testing.assert_array_equal(again.render(), env.render())
    env.step(-push), again.step(-push)
    before = env.render()
    np.testing.assert_array_equal(again.render(), before)
    again.step(push)
    np.testing.assert_array_equal(env.render(), before)
    assert (again.render() != before).any()


def tilting(model="tilting"):
    env = single("Align", model=model, action="wrench", render_mode="rgb_array")
    env.reset(seed=1)
    return env


def test_only_tilting_has_a_view_from_the_side():
    flat, above = tilting("planar").render(), tilting().render()
    assert above.shape == (flat.shape[0] + HEIGHT, *flat.shape[1:])
    assert np.array_equal(above[: flat.shape[0]], flat)


def test_a_tilted_part_is_drawn_with_its_height():
    """The drawn height is that of its bottom, magnified."""
    env = tilting()
    before, simulator = env.render()[-HEIGHT:], env.unwrapped.core.simulator
    (flat,) = simulator.bottoms(0)
    assert not flat[:, 2].any() and np.allclose(flat[:, :2].mean(axis=0), simulator.pose[0, 0, :2], atol=1e-12)
    state = simulator.get_state()
    state["mode"][:], state["lean"][0, 0] = 1, [0.05, 0.03]
    state["height"][:] = simulator.parts[0].centre_height + 5e-4
    simulator.set_state(state)
    rows = np.flatnonzero((before != env.render()[-HEIGHT:]).any(axis=(1, 2)))
    (bottom,) = simulator.bottoms(0)
    extent = MAGNIFIED * np.ptp(bottom[:, 2]) * env.unwrapped._viewer._painters[0]._table[3]
    assert abs(np.ptp(rows) - extent) < 12 and np.ptp(rows) > 30
