"""What a simulator refuses: one error of one line that names the argument, and nothing has changed."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely import affinity
from shapely.geometry import Polygon

from tests.simulation.helpers import ALUMINIUM, DISC, STEEL, STILL, SURFACE, same, snapshot
from vibgym import Part, Simulator, Surface
from vibgym.physics.core.records import State
from vibgym.scene.hulls import WALLS
from vibgym.scene.kinds import Kinds

NAN, INF = math.nan, math.inf


def refused(call, *facts):
    """Assert that ``call`` raises a ValueError of one line that contains all facts."""
    with pytest.raises(ValueError) as error:
        call()
    message = str(error.value)
    assert "\n" not in message and all(fact in message for fact in facts), message


# -- construction ------------------------------------------------------------------------------------------------------

ONE = Surface(rows=1, columns=1, element_size=1.0)
ROUGH = {"kind": "stribeck", "rise": 0.5, "speed": 0.3}
PEA, ANVIL = (Part.disc(0.01, friction=0.5, mass=mass, name=name) for mass, name in ((1e-3, "pea"), (3.0, "anvil")))
FOIL = Part.rectangle(0.05, 0.05e-3, friction=0.5, name="foil")
WEDGE = Part.polygon([[0, 0], [0.05, 0], [0.05, 1e-5]], friction=0.5, name="edge")
TALL = Part.rectangle(0.02, 0.02, friction=0.6, height=0.06, name="tall")
BOUNCING = [Part.disc(0.01, friction=0.6, restitution=0.01 * k) for k in range(32)]
TWO, AVERAGED, PYMUNK, FAST, AUTO = (
    {"parts": [STEEL, DISC]}, {"model": "averaged"}, {"contacts": "pymunk"}, {"contacts": "fast"}, {"model": "auto"},
)  # fmt: skip

CONSTRUCTION = [
    *(({"surface": value}, "surface") for value in (None, "prototype", STEEL)),
    *(({"parts": value}, "parts") for value in (None, "block", [], [STEEL, None], {STEEL: 1}, Part.disc(2.2, friction=0.1))),
    *(({"worlds": value}, "worlds") for value in (0, -1, 1.0, "1", None, True, NAN)),
    *(({"model": value}, "model") for value in ("", "Planar", None, 3, ["planar"])),
    *(({"threads": value}, "threads") for value in (0, -1, 1.0, "2", True)),
    *(({"walls": value}, "walls") for value in (["north"], [0], ["left", "left"], "left", None, {"left": True})),
    ({"parts": Kinds([STEEL, DISC], np.zeros((3, 1), dtype=int), [range(2)]), "worlds": 2}, "3 worlds"),
    # Too coarse: errors of millimetres in a second.
    *(({"steps": steps, "substeps": 20}, "steps") for steps in (1, 2, 3)),
    ({"surface": ONE, "steps": 1, "substeps": 3}, "substeps"),
    # Contacts.
    ({**FAST, **TWO, "contact_overlap": 1e-5}, "contact_overlap requires contacts='certified'"),
    *(({"contacts": name}, "contacts requires several parts or walls") for name in ("fast", "pymunk")),
    ({"parts": [PEA, ANVIL]}, "parts"),
    *(({"parts": part, "walls": ["left"]}, "parts") for part in (FOIL, WEDGE)),
    ({**PYMUNK, "parts": [Part.rectangle(0.05, 9e-5, friction=0.6), STEEL]}, "0.09 mm wide"),
    ({**PYMUNK, "parts": [Part.disc(0.01, friction=0.6, mass=1e-4), ANVIL]}, "ratio of at most 2000"),
    ({**PYMUNK, "parts": BOUNCING}, "at most 31 such pairs"),
    # Scenes that a model does not cover; each has an alternative.
    ({**AVERAGED, **TWO}, "model"),
    ({**AVERAGED, "walls": ["left"]}, "model"),
    ({**AVERAGED, "surface": STILL}, "model='planar'"),
    ({**AVERAGED, "surface": Surface(horizontal_amplitude=0.4e-3)}, "model='planar'"),
    ({**AVERAGED, "parts": Part.disc(0.02, friction=0.6, static_friction=5.0)}, "model='planar'"),
    *(
        ({"model": model, "parts": Part.disc(0.02, friction=0.3, friction_law=ROUGH)}, "constant coefficient")
        for model in ("averaged", "tilting")
    ),
    ({"parts": TALL}, "model='tilting'"),
    ({"model": "tilting", "ramp_mm": 13.5}, "ramp"),
    ({**AUTO, "parts": Part.disc(1e-5, friction=0.5)}, "model"),
    ({**AUTO, "tolerance": 1e-12}, "tolerance"),
    ({"tolerance": 1e-3}, "tolerance"),
]  # fmt: skip


@pytest.mark.parametrize("arguments, named", CONSTRUCTION)
def test_construction_is_refused(arguments, named):
    refused(lambda: Simulator(**{"surface": SURFACE, "parts": STEEL, **arguments}), named)


@pytest.mark.parametrize("arguments", [
    {"surface": ONE, "steps": 1, "substeps": 20},  # nothing to cut
    {"surface": STILL, "steps": 1, "substeps": 1},  # nothing that varies
    {"surface": STILL, "parts": ANVIL, "walls": WALLS},  # a wall has no mass
    {"parts": FOIL},  # nothing touches it
    {"parts": [Part.disc(0.005, friction=0.6, contact_friction=k / 100.0) for k in range(40)], "walls": WALLS},
    {"parts": TALL, "model": "tilting"},
    {"parts": Part.rectangle(0.002, 0.002, friction=0.6)},  # of unknown height
])  # fmt: skip
def test_similar_scenes_are_accepted(arguments):
    assert Simulator(**{"surface": SURFACE, "parts": STEEL, **arguments}).worlds == 1


def test_slender_parts_are_warned_of():
    with pytest.warns(UserWarning, match="model='tilting'"):
        Simulator(SURFACE, Part.disc(0.02, friction=0.6, height=0.02))


# -- calls -------------------------------------------------------------------------------------------------------------

APART = [[0.1, 0.1, 0.2], [0.3, 0.1, -0.4], [0.5, 0.1, 0.0]]
LIGHT = Part.disc(0.02, friction=0.6, mass=0.002, name="light")
CALLS = [
    *(("reset", {"pose": value}, "pose") for value in (
        [NAN, 0, 0], [0.1, INF, 0], [0.1, 0.1], np.zeros((2, 3, 3)), None, "text", [[1, 2], [3]], 1j,
        *([[x, y, 0], *APART[1:]] for x, y in ((-1e-9, 0.1), (0.8321, 0.1), (0.1, -1e-9), (0.1, 0.2081))),
    )),
    *(("reset", {"pose": APART, "velocity": value}, "velocity") for value in ([NAN, 0, 0], [0.1, 0.1], "text", 1j)),
    *(("advance", {"amplitude": value, "phase": 0.0}, "amplitude") for value in (
        NAN, INF, -1e-9, SURFACE.max_amplitude * 1.001, np.zeros(31), np.zeros((2, 8, 32)), None, "text",
    )),
    *(("advance", {"amplitude": 0.0, "phase": value}, "phase") for value in (NAN, np.zeros((32, 8)), None, 1j)),
    *(("advance", {"amplitude": 0.0, "phase": 0.0, "periods": value}, "periods") for value in (0, -1, 1.5, NAN, "1", True)),
    *(("set_state", {"state": value}, "state") for value in (None, {}, 3, "pose")),
    *(("set_conditions", {"worlds": [0], **conditions}, next(iter(conditions))) for conditions in (
        {"friction": 0.0}, {"friction": 101.0}, {"friction": NAN}, {"mass": [1.0, -1.0, 1.0]}, {"mass": [1.0, 2.0]},
        {"mass": [1.0, 1.0, 1e-2]}, {"incline": 8.0}, {"incline": [[0.0, 1.0, 2.0]]}, {"incline": "steep"},
        {"patches": 0.0}, {"patches": np.ones((3, 3))},
    )),
    *(("set_conditions", {"worlds": value, "friction": 0.5}, "worlds") for value in (
        [3], [-1], [True], "all", [0.5], [[0], [0, 1]],
    )),
]  # fmt: skip


def three(**arguments):
    """Return a simulator of three worlds with three parts, after a period."""
    simulator = Simulator(SURFACE, [STEEL, ALUMINIUM, LIGHT], worlds=3, **arguments)
    simulator.reset(APART, [0.01, 0.02, 0.3])
    simulator.advance(1e-4, 0.5)
    return simulator


@pytest.mark.parametrize("method, arguments, named", CALLS)
def test_a_refused_call_names_the_argument_and_changes_nothing(method, arguments, named):
    simulator = three()
    before = snapshot(simulator)
    refused(lambda: getattr(simulator, method)(**arguments), named)
    assert same(before, snapshot(simulator))


@pytest.mark.parametrize("name", [*State._fields, "periods"])
def test_damaged_states_are_refused(name):
    simulator = three()
    before, good = snapshot(simulator), three().get_state()
    bad = [np.zeros((7, 7)), "text", None, [[1], [1, 2]], -1.0]
    if name in ("pose", "velocity", "mean_velocity"):
        bad += [np.full((3, 3, 3), NAN), np.full((3, 3, 3), INF)]
    if name in ("friction", "mass", "patches", "incline"):
        bad.append(np.full_like(good[name], 0.0 if name != "incline" else 9.0))
    for value in bad:
        refused(lambda value=value: simulator.set_state({**good, name: value}), f"state['{name}']")
    refused(lambda: simulator.set_state({key: value for key, value in good.items() if key != name}), "state")
    refused(lambda: simulator.set_state({**good, "more": 1}), "state")
    assert same(before, snapshot(simulator))


def test_conditions_beyond_a_model():
    averaged = Simulator(SURFACE, Part.rectangle(0.05, 0.035, friction=0.6), worlds=2, model="averaged")
    averaged.set_conditions([0, 1], friction=[[1.0], [5.6]])  # a_h w^2 = 66.6 m/s^2, mu (g + a_v w^2) = 65.9
    for conditions, name in (
        ({"friction": 5.7}, "friction"), ({"friction": 5.6, "incline": [0.6, 0.6]}, "friction"), ({"patches": 5.7}, "patches"),
    ):  # fmt: skip
        refused(lambda conditions=conditions: averaged.set_conditions(1, **conditions), name)
    assert averaged.friction.tolist() == [[1.0], [5.6]] and (averaged.patches == 1.0).all()
    slow = Simulator(Surface(frequency=0.03, horizontal_amplitude=1e-4), [STEEL, STEEL])
    refused(lambda: slow.set_conditions(0, friction=50.0), "friction")
    tipping = Simulator(SURFACE, ALUMINIUM)
    refused(lambda: tipping.set_conditions(0, friction=4.0), "friction", "tips")
    pymunk = Simulator(SURFACE, [STEEL, STEEL], contacts="pymunk")
    refused(lambda: pymunk.set_conditions([0], mass=[[0.01, 100.0]]), "mass", "ratio of at most 2000")


# -- overlaps ----------------------------------------------------------------------------------------------------------

BY_WALL = {
    "left": [0.024, 0.1, 0.0],
    "right": [SURFACE.width - 0.024, 0.1, 0.0],
    "bottom": [0.7, 0.019, 0.0],
    "top": [0.7, SURFACE.depth - 0.019, 0.0],
}
"""Poses of the first part, 1 mm beyond each wall."""


def test_overlaps_of_parts_name_both_their_depth_and_the_world():
    simulator, pose = three(), np.tile(APART, (3, 1, 1))
    pose[:] = [[0.1, 0.1, 0.0], [0.15, 0.1, 0.0], [0.5, 0.1, 0.0]]
    simulator.reset(pose)  # touching
    pose[1, 1, 0] -= 0.9e-4
    simulator.reset(pose)  # up to 0.1 mm
    for second, half in ((1, 0.025), (2, 0.02)):
        for depth in (0.11e-3, 0.01):
            pose = np.tile(APART, (3, 1, 1))
            pose[2, 0] = [0.2, 0.1, 0.0]
            pose[2, second], pose[2, 3 - second] = [0.2 + 0.025 + half - depth, 0.1, 0.0], [0.6, 0.1, 0.0]
            names = f"part 0 ('steel') and part {second}", f"{1e3 * depth:.3g} mm", "world 2"
            before = snapshot(simulator)
            refused(lambda pose=pose: simulator.reset(pose), "pose", *names)
            assert same(before, snapshot(simulator))


@pytest.mark.parametrize("overlap, allowed", [(0.07e-3, True), (0.08e-3, False)])
def test_small_parts_overlap_by_at_most_a_quarter_of_their_radius(overlap, allowed):
    disc = Part.disc(0.3e-3, friction=0.6, mass=0.01)
    simulator, pose = Simulator(SURFACE, [disc, disc]), [[0.4, 0.1, 0.0], [0.4006 - overlap, 0.1, 0.0]]
    if allowed:
        simulator.reset(pose)
    else:
        refused(lambda: simulator.reset(pose), "pose", "0.08 mm")


@pytest.mark.parametrize("wall", BY_WALL)
def test_overlaps_with_walls(wall):
    simulator, pose = three(walls=[wall]), np.tile(APART, (3, 1, 1))
    pose[1, 0] = BY_WALL[wall]
    refused(lambda: simulator.reset(pose), "pose", "part 0 ('steel')", f"the {wall} wall", "1 mm", "world 1")
    other = three(walls=[name for name in BY_WALL if name != wall])  # parts may overhang borders without a wall
    other.reset(pose)
    assert (other.pose == pose).all()


@given(st.integers(0, 2**32 - 1))
def test_shapely_and_reset_agree(seed):
    """Any poses: accepted exactly where no two outlines overlap by more than 0.1 mm."""
    rng = np.random.default_rng(seed)
    simulator = Simulator(SURFACE, [STEEL, ALUMINIUM])
    pose = np.array([[0.4, 0.1, 0.0], [0.4, 0.1, 0.0]]) + rng.uniform([-0.04, -0.04, -4], [0.04, 0.04, 4], (2, 3))
    one, other = (
        affinity.translate(affinity.rotate(Polygon(part.outline), turn, origin=(0, 0), use_radians=True), x, y)
        for part, (x, y, turn) in zip(simulator.parts, pose)
    )
    if one.distance(other) > 0.0:
        simulator.reset(pose)
        assert (simulator.pose[0] == pose).all()
    elif one.intersection(other).area > 0.1e-3 * 0.1:  # deeper than 0.1 mm for any shape of the overlap
        refused(lambda: simulator.reset(pose), "part 0 ('steel')", "part 1 ('aluminium')")


def test_states_may_overlap_within_the_limit_of_contacts():
    simulator = three(walls=["left"])
    state = simulator.get_state()
    state["pose"][:] = [[0.1, 0.1, 0.0], [0.15 - 0.9e-3, 0.1, 0.0], [0.4, 0.1, 0.0]]
    simulator.set_state(state)
    state["pose"][1, 1, 0] -= 0.2e-3
    refused(lambda: simulator.set_state(state), "1.1 mm", "world 1")
    state["pose"][1] = [[0.0239, 0.1, 0.0], [0.3, 0.1, 0.0], [0.4, 0.1, 0.0]]
    refused(lambda: simulator.set_state(state), "1.1 mm", "the left wall", "world 1")
    # Fallen parts and diverged worlds have no contacts.
    state["fallen"][1, 0] = True
    simulator.set_state(state)
    state["pose"][1, 0] = state["pose"][1, 1]
    simulator.set_state(state)
    state["fallen"][1, 0], state["diverged"][1] = False, True
    simulator.set_state(state)
