"""Contracts of every environment with every registered name: see :mod:`tests.contracts.entries`."""

import copy
import itertools
import math
import pickle
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils import performance
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from tests.contracts.entries import DISC, ENTRIES, LIMIT, REGISTRIES, Entry, Scene, is_one_line, refusal, served
from tests.envs.helpers import assert_same, batch
from vibgym.simulation import threads as workers

WORLDS, STEPS = 3, 2 * LIMIT + 2  # the third episode has begun
REPRESENTATIVE = (
    Entry("id", "vibgym/Align-v0"),
    Entry("id", "vibgym/Sort-v0"),
    Entry("id", "vibgym/Follow-v0"),
    Entry("id", "vibgym/AlignShapes-v0"),
    Entry("other", "everything at once"),
    Entry("other", "every effect"),
    Entry("other", "success"),
    Entry("other", "a fall"),
    Entry("other", "a fall of one of several"),
    Entry("other", "drawn shapes, randomized"),
    Entry("actuators", "prototype"),
)
"""Tried in every autoreset mode; the others in one."""

ENDS = {"success": "is_success", "a fall": "fallen", "a fall of one of several": "fallen"}
"""Entries whose episodes end before their limit, and the reason."""

OF_SPACES = ("id", "other", "task", "action", "observation", "actuators", "sensor", "estimator")
"""Kinds of entries that may change spaces, features or the reading of actions."""

everywhere = pytest.mark.parametrize("entry", ENTRIES, ids="-".join)
in_spaces = pytest.mark.parametrize("entry", [entry for entry in ENTRIES if entry.of in OF_SPACES], ids="-".join)


def actions_for(env, steps=STEPS, seed=5, most=1.0):
    return np.random.default_rng(seed).uniform(-most, most, (steps, *env.action_space.shape)).astype(np.float32)


def played(env, actions):
    """Everything that comes out of steps, and of the resets that a single environment needs."""
    record = []
    for action in actions:
        record.append(env.step(action))
        if np.ndim(record[-1][2]) == 0 and (record[-1][2] or record[-1][3]):
            record.append(env.reset())
    return record


@everywhere
def test_scenes_are_served_or_refused_in_one_line(entry):
    refusals = [refusal(entry, place) for place in range(len(entry.scenes))]
    assert None in refusals
    for text in refusals:
        assert text is None or is_one_line(text, entry.name if entry.of == "observation" else ""), text


@everywhere
def test_the_env_checker_of_gymnasium(entry, monkeypatch):
    """With warnings as errors; every id is rendered, also in a window."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    for scene in served(entry):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            check_env(scene.single().unwrapped, skip_render_check=entry.of != "id")


@in_spaces
def test_the_env_checker_of_stable_baselines(entry):
    """With warnings as errors."""
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    for scene in served(entry):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            space = scene.single().observation_space
            shapes = [part.shape for part in getattr(space, "spaces", {"": space}).values()]
            # Stable-Baselines3 warns of spaces other than vectors and images of at least 36 pixels.
            known = all(len(shape) == 1 or (len(shape) == 3 and min(shape[:2]) >= 36) for shape in shapes)
            checker.check_env(scene.single().unwrapped, warn=known, skip_render_check=True)


@pytest.mark.parametrize(
    "entry, mode",
    [
        *((entry, AutoresetMode.SAME_STEP) for entry in ENTRIES if entry not in REPRESENTATIVE),
        *((entry, mode) for entry in REPRESENTATIVE for mode in AutoresetMode),
    ],
    ids=lambda value: getattr(value, "value", "-".join(value) if isinstance(value, Entry) else None),
)
def test_batch_equals_single_environments_and_keeps_returned_arrays(entry, mode):
    """Bit for bit, world k with seed s + k, across ends of episodes; returned arrays are never overwritten."""
    for scene in served(entry):
        native = scene.batch(WORLDS, autoreset_mode=mode)
        sync = SyncVectorEnv([scene.single] * WORLDS, autoreset_mode=mode)
        returned = [native.reset(seed=11)]
        kept = copy.deepcopy(returned)
        assert_same(kept[0], sync.reset(seed=11), "reset")
        ended, reasons = 0, 0
        for step, action in enumerate(actions_for(native, most=1.5)):
            returned.append(native.step(action))
            kept.append(copy.deepcopy(returned[-1]))
            assert_same(kept[-1], sync.step(action), f"{scene}, step {step}")
            done = returned[-1][2] | returned[-1][3]
            ended += done.sum()
            final = returned[-1][4].get("final_info", returned[-1][4])
            reasons += final[ENDS.get(entry.name, "is_success")][done].sum()
            for world in np.flatnonzero(done) if mode is AutoresetMode.DISABLED else ():  # one after the other
                mask = np.arange(WORLDS) == world
                returned.append(native.reset(options={"reset_mask": mask}))
                kept.append(copy.deepcopy(returned[-1]))
                # SyncVectorEnv takes the mask out of the mapping it is given.
                assert_same(kept[-1], sync.reset(options={"reset_mask": mask.copy()}), f"{scene}, after step {step}")
        assert_same(returned, kept)
        assert ended >= WORLDS and (entry.name not in ENDS or reasons >= WORLDS)


@in_spaces
def test_spaces_hold_what_is_returned(entry):
    """Gymnasium's passive checks, which it lacks for native batches; the reward is the sum of its terms."""
    for scene in served(entry):
        one, env = scene.single(), scene.batch(WORLDS)
        assert env.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
        assert env.single_action_space == one.action_space and env.single_observation_space == one.observation_space
        assert env.action_space == gym.vector.utils.batch_space(one.action_space, WORLDS)
        assert env.observation_space == gym.vector.utils.batch_space(one.observation_space, WORLDS)
        seen, info = env.reset(seed=1)
        assert env.observation_space.contains(seen) and isinstance(info, dict)
        for action in actions_for(env):
            seen, reward, terminated, truncated, info = env.step(action)
            assert env.observation_space.contains(seen)
            assert (
                reward.dtype == np.float64 and terminated.dtype == truncated.dtype == info["is_success"].dtype == bool
            )
            assert reward.shape == terminated.shape == truncated.shape == info["is_success"].shape == (WORLDS,)
            terms = [term for name, term in info["reward_terms"].items() if not name.startswith("_")]
            assert reward == pytest.approx(np.sum(terms, axis=0), abs=1e-12)
        env.close()


@everywhere
def test_snapshots_and_copies_continue_bit_for_bit(entry):
    """From a random step: in another environment, in the same one, through pickle, and as a pickled copy."""
    instants = np.random.default_rng([ord(letter) for letter in entry.name])
    for scene in served(entry):
        for make in (scene.single, lambda scene=scene: scene.batch(WORLDS, autoreset_mode="SameStep")):
            env, other = make().unwrapped, make().unwrapped
            actions, instant = actions_for(env), int(instants.integers(1, STEPS - LIMIT))
            env.reset(seed=4)
            played(env, actions[:instant])
            state, twin = env.get_state(), pickle.loads(pickle.dumps(env))
            kept = copy.deepcopy(state)
            rest = played(env, actions[instant:])
            assert_same(state, kept)  # a snapshot holds copies
            other.set_state(state)  # without a reset before
            assert_same(played(other, actions[instant:]), rest)
            env.set_state(pickle.loads(pickle.dumps(state)))
            assert_same(played(env, actions[instant:]), rest)
            assert_same(played(twin, actions[instant:]), rest)
            assert_same(state, kept)
            assert_same(env.reset(), other.reset())  # generators too


@everywhere
def test_a_specification_survives_json_and_seeds_reproduce(entry):
    for scene in served(entry):
        before = copy.deepcopy(scene)
        for make, again in (
            (scene.single, gym.make),
            (lambda scene=scene: scene.batch(2), lambda spec: gym.make_vec(spec, num_envs=2)),
        ):
            env = make()
            spec = EnvSpec.from_json(env.spec.to_json())
            assert spec == env.spec
            actions, (one, two) = actions_for(env, 4), (env, again(spec))
            start = one.reset(seed=3)
            assert_same(two.reset(seed=3), start)
            returned = played(one, actions)
            kept = copy.deepcopy(returned)
            assert_same(played(two, actions), returned)
            played(one, actions)
            assert_same(returned, kept)  # nothing that was returned is overwritten
            assert_same(one.reset(seed=3), start)  # nothing is left of the episode before
            assert_same(played(one, actions), returned)
        assert_same(scene, before)  # settings that are given are not changed


@in_spaces
def test_every_feature_has_one_name_unit_and_range(entry):
    """Also for observations other than the environment's, by ``observed``."""
    for scene in served(entry):
        env = scene.batch(WORLDS).unwrapped
        env.reset(seed=2)
        for action in actions_for(env, 3):
            env.step(action)
        state, parts = env.observed("state"), env.observed("parts")["parts"]
        for rows, numbers in ((env.observation_layout, state), (env.parts_layout, parts)):
            assert sum(row.width for row in rows) == numbers.shape[-1]
            assert [row.start for row in rows] == np.cumsum([0, *(row.width for row in rows)])[:-1].tolist()
            assert all(row.name and row.unit and row.meaning and len(row.scale) == row.width for row in rows)
            low, high = (np.concatenate([np.full(row.width, row.range[k]) for row in rows]) for k in range(2))
            assert (numbers >= low).all() and (numbers <= high).all()
        assert {row.part for row in env.observation_layout} - {None} == set(range(len(env.parts)))


@in_spaces
def test_actions_are_accepted_flat_or_shaped_and_clipped(entry):
    """Flat in C order, as lists and as arrays; finite values outside [-1, 1] are clipped."""
    for scene in served(entry):
        env = scene.single()
        shape = env.unwrapped.action_shape
        assert env.action_space == gym.spaces.Box(-1.0, 1.0, (math.prod(shape),), np.float32)
        unclipped = actions_for(env, 1, most=3.0)[0].reshape(shape)
        forms = [
            np.clip(unclipped, -1, 1).ravel(),
            np.clip(unclipped, -1, 1),
            unclipped.tolist(),
            1e3 * unclipped.astype(float) / 1e3,
        ]
        results = []
        for form in forms:
            env.reset(seed=3)
            results.append(env.step(form))
        for result in results[1:]:
            assert_same(result, results[0])
        env.reset(seed=3)
        ends = env.step(np.sign(unclipped))
        env.reset(seed=3)
        assert_same(env.step(unclipped.astype(np.float64) * 1e300), ends)
        many = scene.batch(2)
        many.reset(seed=3)
        actions = np.stack([unclipped, unclipped])
        together = many.step(actions)
        assert (actions == unclipped).all()  # the caller's array is left alone
        many.reset(seed=3)
        assert_same(many.step(actions.reshape(2, -1)), together)


def bad_actions(shape):
    """Yield invalid actions of one world, by name."""
    good = np.zeros(shape, dtype=np.float32)
    for value in (np.nan, np.inf, -np.inf):
        bad = good.copy()
        bad.flat[-1] = value
        yield str(value), bad
    yield "longer", np.zeros((*shape[:-1], shape[-1] + 1), dtype=np.float32)
    yield "longer, flat", np.zeros(math.prod(shape) + 1, dtype=np.float32)
    yield "a batch", good[None]
    yield from {
        "number": 0.0,
        "none": None,
        "text": "up",
        "mapping": {"action": 0},
        "ragged": [[0.0] * 6, [0.0]],
    }.items()
    yield from ((str(kind), good.astype(kind)) for kind in (str, bool, complex, object))


@in_spaces
def test_bad_actions_are_refused_and_no_world_moves(entry):
    for scene in served(entry):
        one, many = scene.single().unwrapped, scene.batch(2).unwrapped
        one.reset(seed=2), many.reset(seed=2)
        before = one.get_state(), many.get_state()
        good = np.zeros(one.action_shape, dtype=np.float32)
        for name, bad in bad_actions(good.shape):
            stacked = isinstance(bad, np.ndarray) and bad.shape == good.shape
            both = np.stack([good.astype(bad.dtype), bad]) if stacked else [good.tolist(), bad]
            for env, action in ((one, bad), (many, both)):
                with pytest.raises(ValueError, match="^action") as error:
                    env.step(action)
                assert is_one_line(str(error.value)), name
        assert_same((one.get_state(), many.get_state()), before)


SETTINGS_OF = {
    **{of: lambda value, of=of: {of: value} for of in ("task", "action", "observation", "actuators", "sensor")},
    **{of: lambda value, of=of: {of: value} for of in ("start", "model")},
    "estimator": lambda value: {"sensor": {"kind": "pose", "estimator": value}},
    "effect": lambda value: {"sensor": {"kind": "camera", "effects": value}},
    "contacts": lambda value: {"model": {"kind": "planar", "contacts": value}},
    "friction law": lambda value: {"parts": [{**DISC, "friction_law": value}]},
    "cost": lambda value: {"costs": value},
    "path": lambda value: {"paths": [value]},
}  # fmt: skip
"""Keyword arguments that choose a registered name."""
OPTIONAL = ("start", "friction law", "cost")
"""Those of them that may be None."""


@pytest.mark.parametrize("of", ["task", *REGISTRIES])
def test_bad_settings_are_refused_in_one_line(of):
    scene = served(next(entry for entry in ENTRIES if entry.of == of))[0]
    for bad in ({"colour": 1}, {"kind": "no such"}, "no such", 3, math.nan, [3], *([] if of in OPTIONAL else [None])):
        argument, value = next(iter(SETTINGS_OF[of](bad).items()))
        with pytest.raises(ValueError) as error:
            scene.single(**{argument: value})
        assert is_one_line(str(error.value), "friction_law" if of == "friction law" else argument)


# -- batches -------------------------------------------------------------------------------------------------------------


def rows(record, chosen):
    """Observation, reward and ends of the chosen worlds."""
    return [record[0][0][chosen], *([values[chosen] for values in results[:4]] for results in record[1:])]


@pytest.mark.parametrize("scene, worlds", [
    (Scene("vibgym/Rotate-v0", {"action": "patch"}), 250),
    *((Scene("vibgym/SortCrowded-v0", settings), 40) for settings in (
        {"action": "field", "randomize": {"parts": [2, 6]}}, {"action": "velocity"}, {"action": "target"},
    )),
    (Scene("vibgym/AlignShapes-v0", {"action": "velocity"}), 250),
])  # fmt: skip
def test_results_depend_neither_on_batch_size_nor_on_order_nor_on_threads(scene, worlds, monkeypatch):
    def trajectory(env, seeds, actions):
        return [env.reset(seed=seeds), *played(env, actions)]

    made = lambda count: scene.batch(count, max_episode_steps=4)  # noqa: E731
    seeds = list(range(300, 300 + worlds))
    actions = actions_for(made(worlds), 6, seed=8)
    whole = trajectory(made(worlds), seeds, actions)
    for chosen in ([0], [worlds - 1], [worlds - 7, 5], list(range(20))[::-1]):
        part = trajectory(made(len(chosen)), [seeds[k] for k in chosen], actions[:, np.array(chosen)])
        assert_same(rows(part, slice(None)), rows(whole, chosen))
    for threads in (1, 2, 5):
        monkeypatch.setattr(workers, "available_threads", lambda threads=threads: threads)
        env = made(worlds)
        assert (len(env.core.simulator.blocks.edges) > 1) == (threads > 1)
        assert_same(trajectory(env, seeds, actions), whole)


@pytest.mark.skipif(not hasattr(performance, "benchmark_vector_step"), reason="Gymnasium 1.4 brought it")
@pytest.mark.parametrize("task", ["Align", "AlignShapes", "Sort"])
@pytest.mark.parametrize("mode, resets", [("NextStep", 3), ("SameStep", 0), ("Disabled", 0)])
def test_the_benchmark_of_gymnasium_counts_steps(task, mode, resets, monkeypatch):
    """In NextStep mode, each of the three resets in 21 calls takes a call of its own."""
    envs = batch(task, WORLDS, action="velocity", autoreset_mode=mode, max_episode_steps=5)
    seconds = itertools.count()
    monkeypatch.setattr(performance.time, "time", lambda: float(next(seconds)))  # each call takes a second
    throughput = performance.benchmark_vector_step(envs, target_duration=20, seed=0)
    assert throughput == WORLDS * (21 - resets) / 21
