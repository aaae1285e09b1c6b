"""Parts above the plane against closed forms: Housner's block, free tilt, transport, energy."""

import json
import math
import os
import subprocess
import sys

import numpy as np
import pytest

from studies.tilting import closed_forms
from studies.tilting.closed_forms import STILL, energy
from studies.tilting.energy import PLAIN
from tests.plugins.tilting.rigid import ALUMINIUM, LARGE, PARTS, STEEL, in_the_middle, leans
from vibgym import Part, Simulator

# -- Housner's block ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("width", "height"), closed_forms.BLOCKS)
def test_energy_of_a_rocking_block_after_an_impact(width, height):
    """Angular momentum about the new edge is kept: ``r = (1 - m R^2 / I (1 - cos 2 alpha))^2``, at 200 steps within 2 %."""
    ratios = closed_forms.measured(width, height, np.radians(np.linspace(*closed_forms.TILTS, 12)))
    kept = closed_forms.kept(width, height)
    assert np.mean(ratios) == pytest.approx(kept, rel=0.02)
    assert np.abs(ratios / kept - 1.0).max() < 0.03  # an impact may come anywhere in a step


def test_a_block_on_its_edge_begins_to_fall_as_a_pendulum():
    """About a fixed edge: ``I_edge theta'' = -g (R sin(alpha - theta))``, before the first impact."""
    block, theta, spin = Part.rectangle(0.05, 0.2, friction=5.0, height=0.15), math.radians(4.0), 0.0
    half, height = 0.025, 0.075
    to_edge, alpha = half**2 + height**2, math.atan2(0.025, 0.075)
    inertia = block.inertia[1] + to_edge
    step = STILL.period / 4000
    for _ in range(4000):  # semi-implicit, far finer than what is checked
        spin -= step * STILL.gravity * math.sqrt(to_edge) * math.sin(alpha - theta) / inertia
        theta += step * spin
    simulator = Simulator(STILL, block, model="tilting")
    simulator.reset([[[0.52, 0.52, 0.0]]])
    simulator.tip(0, [[[0.0, math.radians(4.0)]]])
    simulator.advance(0.0, 0.0)
    assert simulator.tilt[0, 0] == pytest.approx(theta, rel=1e-3)
    assert simulator.get_state()["rocking"][0, 0, 1] == pytest.approx(spin, rel=2e-3)


# -- The drive ---------------------------------------------------------------------------------------------------------


def test_uniform_transport_is_that_of_the_plane():
    """A rigid part on level ground moves like a flat one: within 0.02 %, with second order."""
    away, way = closed_forms.errors("steel_block")
    assert away[closed_forms.STEPS.index(200)] < 2e-4 * way
    assert (np.log2(away[:-1] / away[1:]) > 1.7).all()


# -- Energy ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("restitution", [0.0, 0.2, 1.0])
@pytest.mark.parametrize("part", PARTS, ids=lambda part: part.name)
def test_a_still_table_gives_no_energy(part, restitution):
    """Up to the delay of an impact within a step: a fall of a tenth of a millimetre."""
    rng, worlds = np.random.default_rng(1), 32
    simulator = Simulator(STILL, part, worlds=worlds, model="tilting", restitution=restitution)
    in_the_middle(simulator, 1)
    simulator.tip(slice(None), leans(rng.uniform(0.01, 0.12, worlds)), rocking=rng.normal(0, 1, (worlds, 1, 2)))
    before = np.full(worlds, np.inf)
    for _ in range(25):
        simulator.advance(0.0, 0.0)
        flat, now = simulator.get_state()["mode"][:, 0] == 0, energy(simulator)
        assert (now <= before + STILL.gravity * 1e-4)[~flat].all()
        before = np.where(flat, np.inf, now)


WATCH = """
import json, math, sys
from studies.tilting.energy import balance
cases = [("steel_block", 1.0, 5.0, 0.0), ("steel_block", 0.5, 3.0, 1.0), ("disc", 1.0, 5.0, 1.0), ("disc", 0.25, 1.0, 0.2)]
print(json.dumps([balance(name, share, math.radians(tilt), e, 2)._asdict() for name, share, tilt, e in cases]))
"""


def test_energy_grows_by_no_more_than_the_work_of_table_and_plates():
    """On random fields, tilted, at any restitution, the excess energy over any sequence of steps lifts the part by less
    than ten micrometres; step by step, in a process with plain Python kernels."""
    command = [sys.executable, "-W", "ignore", "-c", WATCH]
    done = subprocess.run(command, env={**os.environ, **PLAIN}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    balances = json.loads(done.stdout)
    assert len(balances) == 4
    for balance in balances:
        assert balance["given"] > 0.1 and balance["lost"] > 0.1
        assert balance["most"] < 9.81 * 1e-5, balance


def test_blocks_land_and_their_headings_are_lost():
    """Friction under one corner turns a tipped part (thesis, section 8.2). Squat parts land within two periods."""
    for part in (STEEL, ALUMINIUM):
        simulator = Simulator(LARGE, part, worlds=64, model="tilting")
        in_the_middle(simulator)
        start = simulator.pose[:, 0, 2]
        simulator.tip(slice(None), leans(np.full(64, math.radians(3.0))))
        simulator.advance(0.0, 0.0, 2)
        assert (simulator.tilt == 0.0).all()
        assert (simulator.time_tilted > 0.015).all() and (simulator.time_tilted < 0.045).all()
        simulator.advance(0.0, 0.0, 23)
        assert math.radians(3.0) < (simulator.pose[:, 0, 2] - start).std() < math.radians(15.0)


def test_a_slender_part_tips_by_itself():
    """From ``mu h_C`` = distance to the edge on, friction alone tips it; below it does not."""
    for height, falls in ((0.030, False), (0.045, True)):
        part = Part.disc(0.01, friction=0.6, height=height)
        assert (part.tipping_ratio > 1.0) == falls
        simulator = Simulator(LARGE, part, worlds=4, model="tilting")
        in_the_middle(simulator)
        simulator.advance(0.0, 0.0, 25)
        assert (simulator.tilt > math.radians(0.05)).any() == falls
