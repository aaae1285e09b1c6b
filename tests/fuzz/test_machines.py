"""Random hardware: bitwise equality of single, batch and restored environments, and finite values."""

import pickle
import warnings
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from hypothesis import given
from hypothesis import strategies as st

from tests.envs.helpers import assert_same, batch, single
from tests.fuzz.campaign import count, fuzz

WORLDS, STEPS = 3, 10

PROTOTYPE = st.fixed_dictionaries(
    {"kind": st.just("prototype"), "latency": st.sampled_from([0, 1, 2, 3, 5, 8])},
    optional={
        "bandwidth": st.sampled_from([0.5, 5.0, 100.0]),
        "seed": st.just(3),
        "dead": st.just(0.1),
        "stuck": st.just(0.05),
        "resolution": st.just(1e-5),
        "dead_zone_form": st.sampled_from(["soft", "cubic"]),
    },
)
OF_ACTUATORS = {
    "latency": st.sampled_from([[0, 1], [0, 3], [2, 6]]),
    "dead_zone": st.just([0.0, 2e-4]),
    "bandwidth": st.just([1.0, 30.0]),
    "stuck": st.just([0.0, 0.1]),
}
OF_WORLDS = {
    "friction": st.just([0.9, 1.1]),
    "mass": st.just([0.5, 1.5]),
    "incline": st.just(0.005),
    "patches": st.just([0.8, 1.1]),
}
ESTIMATORS = ["none", "kalman", "model", {"kind": "model", "model": "auto"}]


@st.composite
def machines(draw):
    """A task, and arguments of its environment."""
    task = draw(st.sampled_from(["Align", "Rotate", "Transport", "Follow", "Sort", "SortCrowded", "Singulate"]))
    several = task not in ("Align", "Rotate", "Transport", "Follow")
    many, periods = several or task == "Follow", draw(st.integers(1, 4))
    settings: dict[str, Any] = {
        "action": draw(st.sampled_from(["element", "phasor", "patch", "field"])),
        "observation": draw(st.sampled_from(["state", "image"] if many else ["state", "image", "goal"])),
        "model": draw(st.sampled_from(["planar", "auto"] if many else ["planar", "auto", "averaged"])),
        "periods_per_step": periods,
        "max_episode_steps": draw(st.integers(2, 7)),
        "actuators": draw(st.just("ideal") | PROTOTYPE | PROTOTYPE),
    }
    ranges = OF_WORLDS if settings["actuators"] == "ideal" else {**OF_WORLDS, **OF_ACTUATORS}
    ranges = {**ranges, "parts": st.just([2, 6])} if several else ranges
    settings["randomize"] = draw(st.fixed_dictionaries({}, optional=ranges))
    if task == "Follow":
        settings["parts"] = draw(st.sampled_from([["steel_block"], ["steel_block", "aluminium_block"]]))
        settings["paths"] = {"heading": draw(st.sampled_from(["kept", "along"]))}
    sensor: dict[str, Any] = {"kind": draw(st.sampled_from(["ideal", "pose", "pose"]))}
    if sensor["kind"] == "pose":
        sensor["delay"], sensor["rate"] = draw(st.sampled_from([0, 1, 2, 5])), 25.0 / periods / draw(st.integers(1, 3))
        sensor["dropout"], sensor["bias"] = draw(st.sampled_from([0.0, 0.3])), draw(st.sampled_from([0.0, 1e-3]))
    sensor["estimator"] = draw(st.sampled_from(ESTIMATORS))
    sensor["report"] = draw(st.sampled_from([[], ["age", "sigma"]]))
    settings["sensor"] = sensor
    return task, settings


def assert_finite(got):
    """Yield all numbers of nested values."""
    if isinstance(got, dict | tuple | list):
        for value in got.values() if isinstance(got, dict) else got:
            assert_finite(value)
    elif isinstance(got, np.ndarray) and got.dtype == object:
        assert_finite(got.tolist())
    elif isinstance(got, float | np.ndarray):
        assert np.isfinite(got).all()


@fuzz(examples=2, seconds_share=1.0)
@given(machines(), st.sampled_from(list(AutoresetMode)), st.integers(1, STEPS - 2), st.integers(0, 2**32 - 1))
def test_single_batch_and_restored_alike(machine, mode, when, seed):
    task, settings = machine
    with warnings.catch_warnings():  # Gymnasium's, of limits in steps that are several periods
        warnings.simplefilter("ignore")
        envs = [batch(task, WORLDS, autoreset_mode=mode, **settings)]
        envs.append(SyncVectorEnv([lambda: single(task, **settings)] * WORLDS, autoreset_mode=mode))
        restored = batch(task, WORLDS, autoreset_mode=mode, **settings)
    begun = [env.reset(seed=seed % 2**31) for env in envs]
    assert_same(*begun)
    random = np.random.default_rng(seed)
    for step in range(STEPS):
        if step == when:
            envs.append(pickle.loads(pickle.dumps(envs[0])))
            restored.set_state(envs[0].get_state())
            envs.append(restored)
        action = random.uniform(-1.5, 1.5, envs[0].action_space.shape).astype(np.float32)
        got, *others = [env.step(action) for env in envs]
        assert_finite(got)
        for other in others:
            assert_same(other, got, f"step {step}")
        done = got[2] | got[3]
        if mode is AutoresetMode.DISABLED and done.any():
            got, *others = [env.reset(options={"reset_mask": done.copy()}) for env in envs]
            for other in others:
                assert_same(other, got, f"reset after step {step}")
    count("machines")
