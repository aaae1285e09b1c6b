"""Apron: elements around a part continue the field under it."""

import numpy as np
import pytest

from vibgym import Part, Surface
from vibgym.actuators import DataSheet
from vibgym.allocation import Allocator
from vibgym.envs.vector import batch_of
from vibgym.policies import make_policy
from vibgym.policies.task_info import TaskInfo

SURFACE = Surface()
BLOCK = Part.rectangle(0.050, 0.035, friction=0.58)
SHEET = DataSheet(SURFACE.max_amplitude)
APRON = 0.006
ONE = np.ones((1, 1), dtype=bool)


def pushes(pose, wanted, apron, parts=(BLOCK,), sheet=SHEET, **settings):
    pose, wanted = np.array(pose, dtype=float), np.array(wanted, dtype=float)
    allocator = Allocator(SURFACE, parts, sheet, apron=apron, **settings)
    return allocator.pushes(pose, np.ones(pose.shape[:2], dtype=bool), wanted)


def test_the_apron_continues_a_push_and_keeps_elements_under_the_part():
    pose = [[[0.4131, 0.1027, 0.3]]]
    plain, wide = (pushes(pose, [[[0.3, 0.2, 0.0]]], apron) for apron in (0.0, APRON))
    under = plain.any(axis=-1)
    assert (wide[under] == plain[under]).all()
    more = wide.any(axis=-1) & ~under
    assert 3 <= more.sum() <= 12
    assert wide[more] == pytest.approx(np.tile(wide[under].mean(axis=0), (more.sum(), 1)), rel=0.02)
    rows, columns = np.nonzero(more[0])
    size = SURFACE.element_size
    assert (np.abs((columns + 0.5) * size - 0.4131) < BLOCK.radius + APRON + 0.71 * size).all()
    assert (np.abs((rows + 0.5) * size - 0.1027) < BLOCK.radius + APRON + 0.71 * size).all()


def test_the_apron_continues_a_rotation():
    """Pushes of the apron are perpendicular to the offset from the centre, and longer than those under the part."""
    centre = np.array([0.416, 0.104])
    plain, wide = (pushes([[[*centre, 0.0]]], [[[0.0, 0.0, 0.3]]], apron)[0] for apron in (0.0, APRON))
    under = plain.any(axis=-1)
    rows, columns = np.nonzero(wide.any(axis=-1) & ~under)
    assert len(rows) > 3
    way = (np.stack([columns, rows], axis=1) + 0.5) * SURFACE.element_size - centre
    found = wide[rows, columns]
    turned = way[:, 0] * found[:, 1] - way[:, 1] * found[:, 0]
    assert (turned > 0.8 * np.hypot(*way.T) * np.hypot(*found.T)).all()
    assert np.hypot(*found.T).max() > np.hypot(*plain[under].T).max()


def test_aprons_do_not_cover_other_parts_and_worlds_are_independent():
    rng = np.random.default_rng(0)
    pose = np.array([[[0.40, 0.10, 0.2], [0.458, 0.10, -0.1]], [[0.2, 0.1, 0.0], [0.6, 0.1, 0.4]]])
    wanted = rng.uniform(-0.5, 0.5, (2, 2, 3))
    plain, wide = (pushes(pose, wanted, apron, (BLOCK, BLOCK)) for apron in (0.0, APRON))
    allocator = Allocator(SURFACE, (BLOCK, BLOCK), SHEET)
    for world in range(2):
        got = [
            allocator.effect(pose[world : world + 1], np.ones((1, 2), bool), each[world : world + 1])
            for each in (plain, wide)
        ]
        assert (got[0] == got[1]).all()  # an apron does not extend under other parts
        alone = pushes(pose[world : world + 1], wanted[world : world + 1], APRON, (BLOCK, BLOCK), threads=1)
        assert (alone[0] == wide[world]).all()


def test_elements_with_a_dead_zone_move_enough_or_rest():
    sheet = DataSheet(SURFACE.max_amplitude, dead_zone=0.3 * SURFACE.max_amplitude)
    wide = pushes([[[0.4131, 0.1027, 0.3]]], [[[0.35, 0.0, 0.2]]], APRON, sheet=sheet)
    size = np.hypot(wide[..., 0], wide[..., 1])
    least = Allocator(SURFACE, [BLOCK], sheet).least
    assert ((size == 0.0) | ((size >= least * (1 - 1e-12)) & (size <= 1.0 + 1e-12))).all()


@pytest.mark.parametrize("bad", [-1e-3, 0.03, "wide", np.nan])
def test_bad_aprons_are_one_error(bad):
    with pytest.raises(ValueError, match="apron"):
        Allocator(SURFACE, [BLOCK], SHEET, apron=bad)


def test_controllers_use_it_if_they_allocate():
    env = batch_of("vibgym/Align-v0", num_envs=1, action="phasor")
    assert make_policy({"kind": "lqr", "apron": 0.006}, TaskInfo.of(env)).predict is not None
    with pytest.raises(ValueError, match="apron"):
        make_policy({"kind": "lqr", "apron": 0.006, "action": "wrench"}, TaskInfo.of(env))
    env.close()
