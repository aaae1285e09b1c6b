"""Cost and error of each model in a custom scene: ``python examples/speed_against_error.py [WORLDS]`` (20 s).

An L-shape of 60 mm on random fields for one second. The reference is the planar model with ten times the steps.
"""

import sys
import time

import numpy as np

from vibgym import Part, Simulator, Surface

worlds = int(sys.argv[1]) if len(sys.argv) > 1 else 256
surface = Surface()
part = Part.polygon([[0, 0], [0.06, 0], [0.06, 0.02], [0.02, 0.02], [0.02, 0.06], [0, 0.06]], friction=0.5)

random = np.random.default_rng(0)
shape = worlds, surface.rows, surface.columns
amplitude = 0.3 * surface.max_amplitude * random.uniform(0, 1, shape)
phase = random.uniform(-np.pi, np.pi, shape)
pose = random.uniform([0.3, 0.08, -np.pi], [0.5, 0.13, np.pi], (worlds, 1, 3))


def played(model, **knobs):
    """Return poses after 25 periods, and microseconds per period and world."""
    simulator = Simulator(surface, part, worlds=worlds, model=model, **knobs)
    for _ in range(2):  # the first time compiles
        simulator.reset(pose)
        began = time.perf_counter()
        for _ in range(25):
            simulator.advance(amplitude, phase)
        taken = time.perf_counter() - began
    return simulator.pose[:, 0], 1e6 * taken / worlds / 25


truth, _ = played("planar", steps=50, substeps=8)
cases = [("planar", {"steps": steps}) for steps in (4, 5, 10, 20)]
cases += [("averaged", {"order": order}) for order in (1, 2)]
cases += [("auto", {"tolerance": 1e-4}), ("auto", {"tolerance": 1e-3})]
print("model, knobs: us a period and world; error of position, median and 95 %, mm")
for model, knobs in cases:
    reached, cost = played(model, **knobs)
    error = 1e3 * np.hypot(*(reached - truth)[:, :2].T)
    print(f"{model:9} {knobs!s:22} {cost:6.2f}   {np.median(error):.4f} {np.quantile(error, 0.95):.4f}")
