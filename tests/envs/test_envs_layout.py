"""The layout table against the observations that it describes."""

import numpy as np
import pytest

from tests.envs.helpers import batch
from vibgym.envs.features import Layout

CASES = [
    ("Rotate", {}), ("Align", {}), ("Transport", {}), ("Sort", {"slots": 8}), ("Singulate", {"randomize": {"parts": [2, 6]}}),
    ("Follow", {"parts": ["steel_block"] * 3}),
]  # fmt: skip


@pytest.mark.parametrize("task, settings", CASES)
def test_quantities_come_back_in_si_units(task, settings):
    env = batch(task, 30, action="field", **settings)
    env.reset(seed=1)
    env.action_space.seed(1)
    action = env.action_space.sample()
    for _ in range(3):
        seen, *_ = env.step(action)
    truth, layout = env.truth, Layout(env.surface, env.parts, env.task.features, env.task.slots)
    assert layout.rows == env.observation_layout
    there = truth.present

    def same(name, expected, tolerance):
        got = layout.quantity(seen, name)
        assert got[there] == pytest.approx(expected[there], abs=tolerance)

    same("position", truth.pose[..., :2], 1e-7)
    same("velocity", truth.mean_velocity[..., :2], 1e-6)
    same("spin", np.clip(truth.mean_velocity[..., 2:], -10, 10), 1e-5)
    symmetry = np.array([part.symmetry for part in env.parts])
    turned = layout.quantity(seen, "heading")[..., 0] - truth.pose[..., 2]
    assert np.sin(0.5 * symmetry * turned)[there] == pytest.approx(0.0, abs=1e-6)
    same("way", truth.error[..., :2], 1e-6)
    if "turn" in layout:
        same("turn", truth.error[..., 2:], 1e-5)
    if "gap" in layout:
        near = there & (truth.gap < 0.1)
        assert layout.quantity(seen, "gap")[near][:, 0] == pytest.approx(truth.gap[near], abs=1e-4)
        assert (layout.numbers(seen, "present")[..., 0] == there).all()
