"""Control of hidden machines with identified parameters: ``python -m studies.benchmarks.identified_control``.

The machines and recordings are those of :mod:`studies.benchmarks.identification`. Each machine is simulated with its true
parameters, elements and camera by :class:`vibgym.hardware.SimulatedDriver`. A :class:`vibgym.hardware.ControlLoop` controls it
in lockstep, with policy, estimator, compensation of the elements and correction of the camera made for a set of parameters: the
identified ones, the true ones, or the nominal ones (with the table's frequency, which its clock shows). Success is that of the
true poses. Results are stored in ``--output`` and reused, so several processes can share the work.
"""

from __future__ import annotations

import math
import pickle
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from studies import common
from studies.benchmarks.identification import NOMINAL, PARTS, Machine, drawn, recorded
from studies.kept import show
from vibgym.files import output_directory, write_atomically
from vibgym.hardware import ControlLoop, MachineError, SimulatedDriver
from vibgym.hardware.driver import PoseMeasurement
from vibgym.identification import Camera, Fitted, fit
from vibgym.scene.parts import shipped_part
from vibgym.seeds import RANGES

LIMIT = 10.0
"""s, longest episode."""

TARGET = 5.0
"""Percent by which the time with identified parameters may exceed that with the true ones."""

TASKS = ("Align", "Transport")
POLICIES = ("pose", "local_field", "learned")


class Known(NamedTuple):
    """What the control loop knows of a machine: arguments of its environment, and the camera that it corrects."""

    settings: dict[str, Any]
    camera: Camera


def known_of(surface: Any, parts: Sequence[Any], actuators: dict[str, Any], camera: Camera) -> Known:
    """Return what a control loop knows that has these parameters."""
    noise = {"position": camera.noise_position, "heading": camera.noise_heading}
    sensor = {"kind": "pose", "noise": noise, "estimator": "model"}
    settings = {
        "surface": surface,
        "parts": list(parts),
        "actuators": {**actuators, "compensate": True},
        "sensor": sensor,
    }
    return Known(settings, camera)


def camera_of(fitted: Fitted) -> Camera:
    """Return the identified camera."""
    values = fitted.values
    mapped = {name: values[f"camera_{name}"] for name in ("scale", "turn", "x", "y")}
    return Camera(**mapped, noise_position=values["noise_position"], noise_heading=values["noise_heading"])


def knowledge(machine: Machine, fitted: Fitted) -> dict[str, Known]:
    """Return the sets of parameters that are compared, by name."""
    surface = replace(NOMINAL, frequency=machine.surface.frequency)
    parts = [shipped_part(name) for name in PARTS]
    usual = Camera(noise_position=1e-4, noise_heading=math.radians(0.2))
    camera = camera_of(fitted)
    return {
        "identified": known_of(fitted.surface, fitted.parts, fitted.actuators, camera),
        "true": known_of(machine.surface, machine.parts, machine.actuators, machine.camera),
        "nominal": known_of(surface, parts, {"kind": "prototype"}, usual),
        "nominal, identified camera": known_of(surface, parts, {"kind": "prototype"}, camera),
    }


class HiddenMachine(SimulatedDriver):
    """A hidden machine, whose poses are seen by its camera and corrected by the one that the control loop knows."""

    def __init__(self, task: str, machine: Machine, known: Camera) -> None:
        camera = self.camera = machine.camera
        self.known = known
        noise = {"position": camera.noise_position / camera.scale, "heading": camera.noise_heading}
        sensor = {"kind": "pose", "noise": noise, "dropout": camera.dropout}
        super().__init__(
            task, surface=machine.surface, parts=machine.parts, actuators=machine.actuators, sensor=sensor, seed=0
        )

    def receive(self) -> PoseMeasurement:
        measured = super().receive()
        assert measured.pose is not None
        seen = self.camera.measured(measured.pose, self.surface)
        return measured._replace(pose=self.known.corrected(seen, self.surface))


def times(task: str, policy: str, machine: Machine, known: Known, seeds: Iterable[int]) -> np.ndarray:
    """Return the time to success of every episode, by the true poses, s; nan: none."""
    driver = HiddenMachine(task, machine, known.camera)
    loop, took = ControlLoop(driver, task, policy, **known.settings), []
    cycles = round(LIMIT / driver.step_time)
    for seed in seeds:
        driver.start(seed)
        took.append(_time(driver, loop, seed, cycles))
    driver.close()
    return np.array(took) * driver.step_time


def _time(driver: HiddenMachine, loop: ControlLoop, seed: int, cycles: int) -> float:
    """Return the cycles until success of one episode; nan: none, or the watchdog has stopped the elements."""
    try:
        observation, _ = loop.env.reset(seed=seed)
        state = None
        for cycle in range(1, cycles + 1):
            action, state = loop.policy.predict(observation, state, deterministic=True)
            observation = loop.env.step(action)[0]
            if driver.info["is_success"]:
                return cycle
    except MachineError:
        pass
    return math.nan


def identified(seed: int, asked: Any) -> Fitted:
    """Return the fit of a machine, from its file if there is one."""
    path = asked.output / f"fit-{seed}-{asked.seconds:g}.pickle"
    if not path.exists():
        write_atomically(path, pickle.dumps(fit(recorded(drawn(seed), seed, asked.seconds), force=True)))
    return pickle.loads(path.read_bytes())


def stored(seed: int, task: str, policy: str, asked: Any) -> dict[str, list[float]]:
    """Return the times to success of a policy on a machine by set of parameters, from their file if there is one."""
    name = f"{seed}-{task}-{policy}-{asked.seconds:g}-{asked.episodes}-{asked.nominal}-{asked.first_seed}.json"

    def compute() -> dict[str, list[float]]:
        machine, by_knowledge = drawn(seed), {}
        for known, parameters in knowledge(machine, identified(seed, asked)).items():
            episodes = asked.nominal if known.startswith("nominal") else asked.episodes
            seeds = range(asked.first_seed, asked.first_seed + episodes)
            by_knowledge[known] = times(task, policy, machine, parameters, seeds).tolist()
        return by_knowledge

    return common.stored(asked.output / name, compute)


def row(by_knowledge: dict[str, Sequence[float]]) -> list[str]:
    """Return the cells of a line: every set of parameters, and by how much identified ones change the median and the mean time
    of the episodes that both they and the true ones solve."""
    a, b = (np.array(by_knowledge[name]) for name in ("identified", "true"))
    both = np.isfinite(a) & np.isfinite(b)
    cells = [common.outcome(np.isfinite(took), np.array(took)) for took in by_knowledge.values()]
    if not both.any():
        return [*cells, "–", "–"]
    change = (100.0 * (of(a[both]) / of(b[both]) - 1.0) for of in (np.median, np.mean))
    return [*cells, *(f"{percent:+.1f} %" for percent in change)]


def main() -> None:
    """Identify machines, control them, and print the table; with ``--keep`` store it for the documentation."""
    parser = common.parser(__doc__)
    parser.add_argument("--machines", nargs="+", type=int, default=[0, 1, 2, 3], metavar="SEED")
    parser.add_argument("--tasks", nargs="+", default=list(TASKS), choices=list(TASKS))
    parser.add_argument("--policies", nargs="+", default=list(POLICIES))
    parser.add_argument("--seconds", type=float, default=120.0, help="length of the recordings")
    parser.add_argument("--episodes", type=int, default=200)
    parser.add_argument(
        "--nominal", type=int, default=20, help="episodes with nominal parameters, of which many fail slowly"
    )
    parser.add_argument("--first-seed", type=int, default=RANGES["held_out"].start, help="of the episodes")
    parser.add_argument("--output", type=Path, default=Path("runs/identified-control"), metavar="DIR")
    asked = parser.parse_args()
    output_directory(asked.output)
    lines, names = [], []
    for seed in asked.machines:
        for task in asked.tasks:
            for policy in asked.policies:
                by_knowledge = stored(seed, task, policy, asked)
                names = list(by_knowledge)
                lines.append([f"{seed}", task, f"`{policy}`", *row(by_knowledge)])
    heads = ("machine", "task", "policy", *names, f"median time, identified to true (target {TARGET:g} %)", "mean")
    show("identified-control", heads, lines, asked.keep)


if __name__ == "__main__":
    main()
