"""Parts of random outlines, and runs that train on them."""

import json

import gymnasium as gym
import numpy as np
import pytest

from agents import outlines
from agents.imitation import Imitation, experts
from agents.ppo import PPO
from agents.training_file import load_settings, settings_from
from vibgym.config import part_from
from vibgym.scene.outlines import is_convex

EVERY = (*outlines.TRAINING, *outlines.UNSEEN)


def across(part):
    return np.hypot(*(part.outline[:, None] - part.outline[None]).transpose(2, 0, 1)).max()


def parts(*arguments, **more):
    return [part_from(scene["parts"][0]) for scene in outlines.scenes(*arguments, **more)]


@pytest.mark.parametrize("family", EVERY)
def test_families_give_simple_outlines_of_the_wanted_size_and_friction(family):
    drawn = parts(40, 3, [family], (0.03, 0.05), (0.4, 0.6))  # part_from rejects outlines that cross themselves
    size = np.array([across(part) for part in drawn])
    slack = 1e-3 if family == outlines.DISC else 1e-8  # a disc's outline is a polygon of its area
    assert (size >= 0.03 * (1 - slack) - 1e-8).all() and (size <= 0.05 * (1 + slack) + 1e-8).all()
    assert np.ptp(size) > 0.018  # spread over the whole range
    friction = np.array([part.friction for part in drawn])
    assert friction.min() >= 0.4 and friction.max() <= 0.6 and np.ptp(friction) > 0.18
    assert {part.name for part in drawn} == {family}
    assert len({part.area for part in drawn}) == len(drawn)


def test_families_have_the_forms_that_they_are_named_for():
    convex = {family: [is_convex(part.outline) for part in parts(20, 0, [family])] for family in EVERY}
    assert all(all(convex[family]) for family in ("disc", "rectangle", "regular", "convex"))
    assert not any(any(convex[family]) for family in ("ell", "tee", "you", "star", "cross"))
    assert np.mean(convex["wavy"]) < 0.2
    # Symmetry survives that an outline is written down.
    assert {part.symmetry for part in parts(60, 0, ["regular"])} == set(range(3, 9))
    assert {part.symmetry for part in parts(60, 0, ["star"])} == {4, 5, 6, 7}
    assert {part.symmetry for part in parts(20, 0, ["cross"])} == {2}
    assert not set(outlines.TRAINING) & set(outlines.UNSEEN)
    assert set(EVERY) == {*outlines.FAMILIES, outlines.DISC}


def test_scenes_are_the_same_for_a_seed_and_take_every_family_in_turn():
    drawn = outlines.scenes(14, 5)
    assert json.loads(json.dumps(drawn)) == drawn == outlines.scenes(14, 5) != outlines.scenes(14, 6)
    assert [scene["parts"][0]["name"] for scene in drawn] == [*outlines.TRAINING] * 2


@pytest.mark.parametrize(("changed", "named"), [
    ({"count": 0}, "outlines.count"),
    ({"seed": -1}, "outlines.seed"),
    ({"families": ["hexagon"]}, "hexagon"),
    ({"families": []}, "outlines.families"),
    ({"size": (0.08, 0.02)}, "outlines.size"),
    ({"size": (0.001, 0.02)}, "outlines.size"),
    ({"friction": (0.3, 30.0)}, "outlines.friction"),
])  # fmt: skip
def test_bad_arguments_are_refused(changed, named):
    with pytest.raises(ValueError, match=named):
        outlines.scenes(**{"count": 3, "seed": 0, **changed})


def write(tmp_path, **settings):
    path = tmp_path / "run.yaml"
    path.write_text(json.dumps({"task": "Align", "steps": 10, "environment": {"action": "wrench"}, **settings}))
    return path


def test_a_run_deals_its_worlds_out_to_drawn_parts(tmp_path):
    settings = load_settings(write(tmp_path, worlds=7, outlines={"count": 3, "seed": 2, "size_mm": [30, 40]}))
    env = PPO(settings).env
    assert [each.num_envs for each in env.envs] == [3, 2, 2]
    expected = parts(3, 2, size=(0.03, 0.04))
    assert all(each.parts[0].same_as(part) for each, part in zip(env.envs, expected, strict=True))
    seen = env.reset()["parts"][:, 0]
    columns = {row.name: row.start for row in env.env.parts_layout}
    assert len(set(seen[:, columns["friction"]].tolist())) == 3  # a policy observes which part it has
    env.close()


def test_scenes_are_given_or_drawn():
    assert settings_from({"task": "Align", "steps": 1}).all_scenes == [{}]
    both = settings_from({"task": "Align", "steps": 1, "scenes": [{"walls": ["left"]}], "outlines": {"count": 2}})
    with pytest.raises(ValueError, match="outlines"):
        _ = both.all_scenes


def test_parts_of_all_families_can_be_played_with():
    for scene in outlines.scenes(len(EVERY), 1, EVERY):
        env = gym.make("vibgym/Align-v0", action="wrench", observation="parts", **scene)
        env.reset(seed=0)
        assert env.observation_space.contains(env.step(np.ones(3, dtype=np.float32))[0])
        env.close()


def test_the_critic_learns_alone_after_imitation(tmp_path):
    imitation = {"expert": {"kind": "pose", "action": "wrench"}, "rounds": 2, "steps": 3}
    path = write(tmp_path, worlds=4, outlines={"count": 2}, imitation=imitation, ppo={"critic_steps": 50})
    settings = load_settings(path)
    model = PPO(settings)
    env = model.env
    own = settings.imitation
    found = Imitation(model.policy, experts(own, settings.action, 0, env), own, seed=0)
    list(found.rounds())
    assert model.critic_steps == found.steps + 50
    env.close()
