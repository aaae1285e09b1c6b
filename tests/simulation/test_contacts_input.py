"""Bad input to simulators with several parts or walls: one clear error, and nothing has changed."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely import affinity
from shapely.geometry import Polygon

from tests.simulation.helpers import same, snapshot
from vibgym import Part, Simulator, Surface

SURFACE = Surface()
STEEL = Part.rectangle(0.05, 0.04, friction=0.64, height=0.004, name="steel")
ALUMINIUM = Part.rectangle(0.05, 0.035, friction=0.58, mass=0.0945, name="aluminium")
DISC = Part.disc(0.02, friction=0.6, name="disc")
PARTS = [STEEL, ALUMINIUM, DISC]
ALL_WALLS = ("left", "right", "bottom", "top")
APART = [[0.1, 0.1, 0.2], [0.3, 0.1, -0.4], [0.5, 0.1, 0.0]]


def simulator(worlds=3, **keywords):
    made = Simulator(SURFACE, PARTS, worlds=worlds, **keywords)
    made.reset(APART, [0.01, 0.02, 0.3])
    return made


def refused(made, action, *facts):
    """Assert that ``action`` raises a ValueError of one line with all ``facts``, without a change of the state."""
    before = snapshot(made)
    with pytest.raises(ValueError) as error:
        action()
    message = str(error.value)
    assert "\n" not in message and all(fact in message for fact in facts), message
    assert same(before, snapshot(made))


# -- where parts start -------------------------------------------------------------------------------------------------


@given(st.integers(0, 2), st.floats(0.11e-3, 0.03), st.booleans())
def test_overlap_names_both_parts_amount_and_world(world, depth, round_part):
    made = simulator()
    pose = np.tile(APART, (3, 1, 1))
    second = 2 if round_part else 1
    half = 0.02 if round_part else 0.025
    pose[world, 0] = [0.2, 0.1, 0.0]
    pose[world, second] = [0.2 + 0.025 + half - depth, 0.1, 0.0]
    pose[world, 3 - second] = [0.6, 0.1, 0.0]
    names = [f"part {k} ({PARTS[k].name!r})" for k in (0, second)]
    refused(made, lambda: made.reset(pose), "pose", *names, f"{1e3 * depth:.3g} mm", f"world {world}")


@given(st.integers(0, 2**32 - 1))
def test_shapely_and_reset_agree(seed):
    """Any poses: accepted exactly where no two outlines overlap by more than 0.1 mm."""
    rng = np.random.default_rng(seed)
    made = Simulator(SURFACE, [STEEL, ALUMINIUM])
    pose = np.array([[0.4, 0.1, 0.0], [0.4, 0.1, 0.0]]) + rng.uniform([-0.04, -0.04, -4], [0.04, 0.04, 4], (2, 3))
    one, other = (
        affinity.translate(affinity.rotate(Polygon(part.outline), turn, origin=(0, 0), use_radians=True), x, y)
        for part, (x, y, turn) in zip(made.parts, pose)
    )
    if one.distance(other) > 0.0:
        made.reset(pose)
        assert (made.pose[0] == pose).all()
    elif one.intersection(other).area > 0.1e-3 * 0.1:  # deeper than 0.1 mm for any shape of the overlap
        refused(made, lambda: made.reset(pose), "part 0 ('steel')", "part 1 ('aluminium')")


def test_touching_is_allowed():
    made = simulator()
    made.reset([[0.1, 0.1, 0.0], [0.15, 0.1, 0.0], [0.195, 0.1, 0.0]])
    made.reset([[0.1, 0.1, 0.0], [0.15 - 0.9e-4, 0.1, 0.0], [0.195, 0.1, 0.0]])
    refused(made, lambda: made.reset([[0.1, 0.1, 0.0], [0.15 - 1.1e-4, 0.1, 0.0], [0.195, 0.1, 0.0]]), "0.11 mm")


@pytest.mark.parametrize("wall", ALL_WALLS)
def test_overlap_with_a_wall(wall):
    inside = {
        "left": [0.024, 0.1, 0.0],
        "right": [SURFACE.width - 0.024, 0.1, 0.0],
        "bottom": [0.7, 0.019, 0.0],
        "top": [0.7, SURFACE.depth - 0.019, 0.0],
    }
    made = simulator(walls=[wall])
    pose = np.tile(APART, (3, 1, 1))
    pose[1, 0] = inside[wall]
    refused(made, lambda: made.reset(pose), "part 0 ('steel')", f"the {wall} wall", "1 mm", "world 1")
    # Parts may overhang borders without a wall.
    other = simulator(walls=[each for each in ALL_WALLS if each != wall])
    other.reset(pose)
    assert (other.pose == pose).all()


# -- states ------------------------------------------------------------------------------------------------------------


def test_states_may_overlap_within_the_limit_of_contacts():
    made = simulator(walls=["left"])
    state = made.get_state()
    state["pose"][:] = [[0.1, 0.1, 0.0], [0.15 - 0.9e-3, 0.1, 0.0], [0.4, 0.1, 0.0]]
    made.set_state(state)
    state["pose"][1, 1, 0] -= 0.2e-3
    refused(made, lambda: made.set_state(state), "1.1 mm", "world 1")
    state["pose"][1] = [[0.0239, 0.1, 0.0], [0.3, 0.1, 0.0], [0.4, 0.1, 0.0]]
    refused(made, lambda: made.set_state(state), "1.1 mm", "the left wall", "world 1")
    # Fallen parts and diverged worlds have no contacts.
    state["fallen"][1, 0] = True
    made.set_state(state)
    state["fallen"][1, 0], state["diverged"][1] = False, True
    made.set_state(state)


# -- construction ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("walls", [["north"], [0], ["left", "left"], "left", None, {"left": True}])
def test_walls(walls):
    with pytest.raises(ValueError, match="walls"):
        Simulator(SURFACE, PARTS, walls=walls)


def test_any_number_of_materials_meets_walls():
    parts = [Part.disc(0.005, friction=0.6, contact_friction=k / 100.0) for k in range(40)]
    assert len(Simulator(SURFACE, parts, walls=ALL_WALLS).parts) == 40


@pytest.mark.parametrize("keywords", [{"parts": PARTS}, {"parts": STEEL, "walls": ["left"]}])
def test_the_averaged_model_has_one_part_and_no_walls(keywords):
    with pytest.raises(ValueError, match="model"):
        Simulator(SURFACE, model="averaged", **keywords)
