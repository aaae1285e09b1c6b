"""PID, state space and LQR as laws: on free bodies, and in episodes on the table."""

import dataclasses
import math

import control
import numpy as np
import pytest

from agents.control.laws import LAWS
from agents.control.measured import Measured, wrap
from agents.control.plant import plant_of
from agents.registry import make_policy
from tests.agents.helpers import episodes, info_of

T = 0.04
NAMES = ("lqr", "pid", "state_space")


def law_for(name, task="Align", **settings):
    info = info_of(task)
    return LAWS.choose("law", name)(info, **settings), info


def seen(info, place, velocity):
    """What is measured of parts at (batch, parts, 3) with velocities likewise; headings modulo the part's symmetry."""
    symmetry = np.array([part.symmetry for part in info.parts])
    return dataclasses.replace(
        Measured.of(np.zeros((len(place), info.layout.size)), info), centre=place[..., :2], velocity=velocity[..., :2],
        heading=wrap(place[..., 2], symmetry), spin=velocity[..., 2], present=np.ones(place.shape[:2], dtype=bool),
    )  # fmt: skip


def drive(law, info, place, velocity, target, steps, heading=True):
    """Free bodies that get what the law wants: places (steps, batch, parts, 3)."""
    memory, places = law.initial(len(place)), []
    for _ in range(steps):
        measured, way = seen(info, place, velocity), target - place
        wanted, memory = law.wanted(measured, way[..., :2], way[..., 2] if heading else 0.0 * way[..., 2], memory)
        memory = law.applied(measured, wanted, memory)
        place = place + T * velocity + 0.5 * T**2 * wanted
        velocity = velocity + T * wanted
        places.append(place)
    return np.array(places)


@pytest.mark.parametrize("name", NAMES)
def test_free_bodies_come_to_their_targets(name):
    """Positions and headings, parts from rest and in motion, turns across the seam of a block's heading."""
    law, info = law_for(name)
    rng = np.random.default_rng(0)
    place, velocity, target = (rng.uniform(-1.0, 1.0, (20, 1, 3)) * scale for scale in (0.3, 0.1, 0.3))
    place[..., 2] = 1.5 * math.pi * rng.uniform(-1.0, 1.0, (20, 1))
    target[..., 2] = place[..., 2] + rng.uniform(-1.0, 1.0, (20, 1))
    places = drive(law, info, place, velocity, target, 300)
    assert np.abs(places[-1] - target).max() < 1e-4
    assert np.abs(places - target).max() < 2.0  # no jump at the seam


def test_the_state_space_law_is_the_judges_loop():
    """Observer, gain and double integrator as python-control closes the loop of fig. 5.23, for a step of x alone."""
    law, info = law_for("state_space", poles=[-2.0, -3.0], observer_poles=[-6.0, -7.0])
    a, b, c = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]])
    gains = control.acker(a, b, [-2.0, -3.0]).ravel()
    seeing = control.acker(a.T, c.T, [-6.0, -7.0]).reshape(2, 1)
    plant = control.c2d(control.ss(a, b, c, 0), T)
    observer = control.c2d(control.ss(a - seeing @ c, np.hstack([b, seeing]), np.eye(2), 0), T)
    x, estimate, judged = np.zeros(2), np.zeros(2), []
    for _ in range(100):
        u = gains @ (np.array([0.2, 0.0]) - estimate)
        estimate = observer.A @ estimate + observer.B @ [u, x[0]]
        x = plant.A @ x + plant.B[:, 0] * u
        judged.append(x[0])
    none = np.zeros((1, 1, 3))
    places = drive(law, info, none, none, np.array([[[0.2, 0.0, 0.0]]]), 100)
    assert places[:, 0, 0, 0] == pytest.approx(judged, abs=1e-12) and not places[..., 1:].any()


def test_lqr_counts_on_friction_and_knows_its_lead():
    law, info = law_for("lqr", task="Sort")
    drag = plant_of(info).drag
    plant = control.c2d(control.ss([[0.0, 1.0], [0.0, -drag[0]]], [[0.0], [1.0]], np.eye(2), 0), T)
    assert law.gains[0, 1] == pytest.approx(control.dlqr(plant, np.diag([30000.0, 1.0]), 1.0)[0].ravel(), rel=1e-6)
    velocity = np.zeros((1, len(info.parts), 3))
    velocity[..., 0] = 0.1
    wanted, _ = law.wanted(seen(info, 0.0 * velocity, velocity), law.lead * velocity[..., :2], velocity[..., 2], ())
    assert np.abs(wanted).max() == pytest.approx(0.0, abs=0.1 * 0.1 * drag.max())  # kinds differ a little
    assert len({*drag.tolist()}) == 2


@pytest.mark.parametrize("name", NAMES)
def test_spin_is_braked_where_headings_do_not_count(name):
    law, info = law_for(name, task="Transport")
    place, velocity = np.zeros((1, 1, 3)), np.array([[[0.0, 0.0, 3.0]]])
    places = drive(law, info, place, velocity, place, 250, heading=False)
    assert abs(places[-1, 0, 0, 2] - places[-25, 0, 0, 2]) < 1e-3


@pytest.mark.parametrize("name", NAMES)
def test_parts_and_worlds_do_not_see_one_another(name):
    law, info = law_for(name, task="Sort")
    rng = np.random.default_rng(1)
    place, velocity, target = rng.uniform(-0.3, 0.3, (3, 4, len(info.parts), 3))
    whole = drive(law, info, place, velocity, target, 5)
    alone = drive(law, info, place[2:3], velocity[2:3], target[2:3], 5)
    assert (alone[:, 0] == whole[:, 2]).all()


@pytest.mark.parametrize("task, name, seconds", [
    ("Transport", "lqr", 1.5), ("Align", "lqr", 1.7), ("Rotate", "lqr", 1.0),
    ("Transport", "state_space", 4.0), ("Align", "state_space", 4.5), ("Align", "pid", 5.5),
])  # fmt: skip
def test_on_the_table(task, name, seconds):
    """Every goal is reached; the thesis's poles at -2 rad/s take their time."""
    settings = {"anti_windup": True} if name == "pid" else {}
    policy = make_policy({"kind": "local_field", "law": name, **settings}, info_of(task))
    found = episodes(policy, task, worlds=30)
    assert found.success == 30 and found.time < seconds


@pytest.mark.parametrize(
    "settings, told",
    [
        ({"law": "pid", "poles": [-2.0, -2.0, 2.0]}, "poles: got .*3 poles with negative real parts"),
        ({"law": "state_space", "poles": [-2.0, [-1.0, 1.0]]}, "poles: got .*conjugate pairs"),
        ({"law": "state_space", "observer_gains": [0.0, 1.0]}, r"observer gains\[0\]: got 0.0"),
        ({"law": "lqr", "state_weights": [1.0, 0.0]}, r"state_weights\[1\]: got 0.0; allowed: a finite number > 0"),
        ({"law": "lqr", "control_weight": -1.0}, "control_weight: got -1.0"),
        ({"law": "lqr", "heading_weights": [1.0, -1.0]}, r"heading_weights\[1\]: got -1.0"),
    ],
)
def test_bad_settings_are_refused_by_name(settings, told):
    with pytest.raises(ValueError, match=told):
        make_policy({"kind": "local_field", **settings}, info_of("Align"))
