"""Registered names, and the scenes in which the contracts try each."""

from __future__ import annotations

import functools
import re
from collections.abc import Mapping
from typing import Any, NamedTuple

import gymnasium as gym

from tests.actuators.test_actuators import Weak
from tests.sensing.test_effects import Drift, Jitter
from tests.sensing.test_sensors import Shifted
from tests.tasks.test_tasks_reward import Gentle, Quiet
from vibgym.actuators import ACTUATORS
from vibgym.envs import ACTIONS, OBSERVATIONS
from vibgym.envs.costs import COSTS
from vibgym.scene.friction_laws import FRICTION_LAWS
from vibgym.sensing import EFFECTS, ESTIMATORS, SENSORS
from vibgym.simulation.contacts import CONTACTS
from vibgym.simulation.models import MODELS
from vibgym.tasks import TASKS
from vibgym.tasks.paths import SHAPES as PATHS
from vibgym.tasks.starts import STARTS

IDS = tuple(name for name in gym.registry if name.startswith("vibgym/"))
OWN = (
    (SENSORS, {"shifted": Shifted}),
    (ACTUATORS, {"weak": Weak}),
    (EFFECTS, {"drift": Drift, "jitter": Jitter}),
    (TASKS, {"Quiet": Quiet, "Gentle": Gentle}),
)
"""Example user-defined entries, registered while a contract runs."""

LIMIT = 6
"""Steps of an episode; short, so that many begin."""

MACHINE = {"kind": "prototype", "latency": 2, "dead": 0.05, "stuck": 0.05}
SENSOR = {"kind": "pose", "bias": 1e-4, "dropout": 0.2, "delay": 2}
MODELLED = {"kind": "pose", "estimator": "model"}
DRAWN = {"friction": [0.9, 1.1], "dead_zone": [5e-5, 1.5e-4], "latency": [0, 3], "gain_spread": [0.0, 0.1]}


PATTERN = [[0.1, 0.1, 0.0], [0.3, 0.1, 0.5], [0.5, 0.1, 1.0]]


class Scene(NamedTuple):
    """Arguments of ``gym.make`` and ``gym.make_vec``."""

    id: str
    settings: dict[str, Any]

    def single(self, **more: Any) -> Any:
        """One environment, with Gymnasium's wrappers."""
        return gym.make(self.id, **{"max_episode_steps": LIMIT, **self.settings, **more})

    def batch(self, worlds: int, **more: Any) -> Any:
        """The native batch."""
        return gym.make_vec(self.id, num_envs=worlds, **{"max_episode_steps": LIMIT, **self.settings, **more})


class Entry(NamedTuple):
    """A registered name, and the registry it belongs to."""

    of: str
    name: str

    @property
    def scenes(self) -> list[Scene]:
        """Scenes to try it in; some of them may refuse it."""
        return [Scene(name, {"action": "field", **settings}) for name, settings in PLACES[self.of](self.name)]


ONE, SEVERAL, MOVING, FED, DRAWN_ONE, DRAWN_SEVERAL, DRAWN_PUSHED = (
    f"vibgym/{task}-v0" for task in ("Align", "Sort", "Follow", "Feed", "AlignShapes", "SortShapes", "PushShapes")
)

OTHERS: dict[str, tuple[str, dict[str, Any]]] = {
    "averaged, long steps": (ONE, {"model": "averaged", "periods_per_step": 3}),
    "averaged, latencies drawn": (
        ONE, {"model": "averaged", "periods_per_step": 4, "actuators": "prototype", "randomize": {"latency": [0, 6]}},
    ),
    "auto, latencies drawn": (
        ONE, {"model": "auto", "periods_per_step": 4, "actuators": "prototype", "randomize": {"latency": [0, 6]}},
    ),
    "costs": (
        SEVERAL, {"start": "crowded", "costs": {"impulse": 2.0, "fallen": 10.0, "clearance": {"weight": 0.1, "below_mm": 8},
                                                "effort": 0.5}},
    ),
    "friction, mass and incline drawn": (ONE, {"randomize": {"friction": [0.5, 1.5], "mass": [0.25, 4], "incline": 0.03}}),
    "patches drawn": (ONE, {"randomize": {"patches": [0.7, 1.3]}}),
    "parts drawn too": (SEVERAL, {"randomize": {"parts": [2, 6], "mass": [0.5, 2.0], "incline": 0.02, "patches": [0.8, 1.2]}}),
    "disturbances": (ONE, {"randomize": {"disturbance": {"rate": 5.0, "tilt_deg": [1, 3]}}}),
    "disturbances with tilt": (SEVERAL, {"model": "tilting", "randomize": {"disturbance": {"rate": 5.0, "tilt_deg": [1, 3]}}}),
    "contacts by pymunk": (
        "vibgym/SortCrowded-v0",
        {"model": {"kind": "planar", "contacts": "pymunk"}, "randomize": {"mass": [0.5, 2]}, "walls": ["top"]},
    ),
    "contacts reported": ("vibgym/PushAny-v0", {"sensor": {"kind": "ideal", "report": ["contacts"]}, "observation": "parts"}),
    "slots": (SEVERAL, {"slots": 7, "observation": "parts", "randomize": {"parts": [2, 6]}, "sensor": "pose"}),
    "a crowd in an image": ("vibgym/SortCrowded-v0", {"action": "patch", "observation": "image", "walls": ["top"]}),
    "off a small table": ("vibgym/Transport-v0", {"surface": {"rows": 3, "columns": 4}, "observation": "image"}),
    "a machine that is drawn": (ONE, {"actuators": {**MACHINE, "bandwidth": 5.0}, "randomize": DRAWN}),
    "wrenches by a model": (SEVERAL, {"action": "wrench", "actuators": "prototype", "sensor": MODELLED}),
    "everything at once": (
        SEVERAL, {
            "surface": {"rows": 8, "columns": 20, "element_size_mm": 30.0, "max_amplitude": 3e-4},
            "parts": ["steel_block", {"shape": "disc", "radius_mm": 20, "friction": 0.5, "name": "coin"}, "steel_block"],
            "action": "patch", "randomize": {"parts": [2, 3]}, "start": "crowded", "slots": 4, "walls": ["left", "right"],
            "zones": {"steel_block": [0.0, 0.0, 0.2, 0.24], "coin": [0.4, 0.0, 0.6, 0.24]}, "periods_per_step": 2,
        },
    ),
    "an interlaced camera": (
        ONE, {"sensor": {"kind": "camera", "lines": "interlaced", "edge": "threshold", "delay": 2}, "observation": "camera"},
    ),
    "a statistical camera": (ONE, {"sensor": {"kind": "camera", "statistical": True, "delay": 1}, "observation": "camera"}),
    "every effect": (
        ONE, {"sensor": {"kind": "shifted", "bias": 1e-4, "dropout": 0.2, "noise": 1e-4, "drift": 0.01, "jitter": 1e-4,
                         "delay": 2, "estimator": "kalman", "report": ["age", "sigma"]}},
    ),
    "three paths": (MOVING, {"action": "patch", "parts": ["steel_block", "aluminium_block", "steel_block"]}),
    "a path along": (MOVING, {"paths": {"heading": "along"}, "sensor": MODELLED, "actuators": "prototype"}),
    "a short path": (
        MOVING, {"paths": [{"shape": "polyline", "points_mm": [[100, 80], [100, 95]]}], "periods_per_step": 3},
    ),
    "parts and state by a model": (
        SEVERAL, {"observation": "parts_and_state", "action": "wrench", "actuators": "prototype", "sensor": MODELLED},
    ),
    "success": (
        "vibgym/Pack-v0", {
            "parts": ["steel_block"] * 3, "surface": {"max_amplitude": 1e-6}, "action": "phasor",
            "task_settings": {"pattern": PATTERN, "hold": 3}, "start": {"kind": "pattern", "pattern": PATTERN},
        },
    ),
    "a fall": ("vibgym/Transport-v0", {"surface": {"rows": 3, "columns": 4}, "periods_per_step": 12}),
    "a fall of one of several": (SEVERAL, {"action": "velocity", "periods_per_step": 20}),
    "continuous feed, drawn": (
        FED, {"action": "wrench", "actuators": "prototype", "sensor": MODELLED, "periods_per_step": 25,
              "parts": ["steel_block", "aluminium_block"] * 4,
              "task_settings": {"probabilities": [0.7, 0.3], "heap": 2, "most": 6}},
    ),
    "continuous feed, delayed": (FED, {"periods_per_step": 25, "sensor": {"kind": "pose", "delay": 2}}),
    "a drawn shape in an image": (DRAWN_ONE, {"action": "target", "observation": "image"}),
    "a drawn shape, modelled": (
        DRAWN_ONE, {"action": "patch", "sensor": {"kind": "pose", "noise": {"position_mm": 0.5}, "estimator": "model"}},
    ),
    "a drawn shape, disturbed": (
        DRAWN_ONE, {"action": "wrench", "randomize": {"disturbance": {"rate": 5.0, "tilt_deg": 3.0}}},
    ),
    "a drawn shape by a camera": (DRAWN_ONE, {"sensor": {"kind": "camera", "statistical": True}, "observation": "parts"}),
    "a drawn shape, averaged": (DRAWN_ONE, {"action": "velocity", "model": "averaged", "observation": "goal"}),
    "drawn shapes, randomized": (
        DRAWN_SEVERAL, {"randomize": {"friction": [0.9, 1.1], "mass": [0.5, 2.0]}, "observation": "parts"},
    ),
    "drawn shapes, fast": (DRAWN_SEVERAL, {"action": "velocity", "model": {"kind": "planar", "contacts": "fast"}}),
    "drawn shapes by pymunk": (
        "vibgym/PackShapes-v0", {"action": "velocity", "model": {"kind": "planar", "contacts": "pymunk"}},
    ),
    "drawn shapes, pushed": (
        DRAWN_PUSHED, {"action": "velocity", "costs": {"impulse": 1.0}, "sensor": {"kind": "pose", "estimator": "kalman"}},
    ),
}  # fmt: skip
"""Settings that change what an environment stores from step to step."""

DISC = {"shape": "disc", "radius_mm": 20, "friction": 0.5}
GIVEN_PATHS = {
    "circle": {"centre_mm": [400, 104], "radius_mm": 60},
    "square": {"centre_mm": [400, 104], "side_mm": 120},
    "polyline": {"points_mm": [[100, 50], [300, 50], [300, 150]]},
    "figure_eight": {"centre_mm": [400, 104], "radius_mm": 35},
}

PLACES = {
    "id": lambda name: [(name, {})],
    "other": lambda name: [OTHERS[name]],
    "task": lambda name: [(ONE, {"task": name})],
    "action": lambda name: [
        (ONE, {"action": name}),
        (SEVERAL, {"action": name, "actuators": MACHINE, "randomize": {"parts": [2, 4]}}),
    ],
    "observation": lambda name: [
        *((id, {"observation": name}) for id in (ONE, SEVERAL, MOVING)),
        (ONE, {"observation": name, "sensor": "camera"}),
    ],
    "actuators": lambda name: [
        (ONE, {"actuators": name}),
        (SEVERAL, {"actuators": {"kind": name, "latency": 3}, "periods_per_step": 2, "randomize": {"parts": [2, 6]}}),
    ],
    "sensor": lambda name: [
        (ONE, {"sensor": name}),
        (SEVERAL, {"sensor": {"kind": name, "delay": 3}, "periods_per_step": 2, "walls": ["left"]}),
    ],
    "estimator": lambda name: [
        (ONE, {"sensor": {**SENSOR, "estimator": name, "report": ["age", "sigma"]}, "actuators": MACHINE}),
        (SEVERAL, {"sensor": {**SENSOR, "estimator": name}, "actuators": MACHINE, "periods_per_step": 3}),
    ],
    "effect": lambda name: [
        (ONE, {"sensor": {"kind": "shifted", name: 1e-3, "delay": 2}}),
        (SEVERAL, {"sensor": {"kind": "camera", "statistical": True, "effects": {name: 1e-3}}, "periods_per_step": 2}),
    ],
    "start": lambda name: [
        (SEVERAL, {"start": name, "randomize": {"parts": [2, 6]}}),
        ("vibgym/Pack-v0", {"start": name}),
    ],
    "model": lambda name: [
        (ONE, {"model": name, "action": "velocity"}),
        (SEVERAL, {"model": name, "randomize": {"parts": [2, 6]}}),
    ],
    "contacts": lambda name: [
        (SEVERAL, {"model": {"kind": "planar", "contacts": name}, "start": "crowded", "walls": ["top"]})
    ],
    "friction law": lambda name: [(ONE, {"parts": [{**DISC, "friction_law": {"kind": name}}], "periods_per_step": 2})],
    "cost": lambda name: [
        (SEVERAL, {"costs": {name: 2.0}, "start": "crowded", "periods_per_step": 2}),
        (DRAWN_PUSHED, {"costs": {name: 2.0}}),
    ],
    "path": lambda name: [
        (MOVING, {"paths": [{"shape": name, **GIVEN_PATHS[name]}]}),
        (MOVING, {"paths": [{"shape": name, **GIVEN_PATHS[name], "heading": "along"}], "periods_per_step": 3}),
    ],
}
REGISTRIES: dict[str, Mapping[str, Any]] = {
    "action": ACTIONS,
    "observation": OBSERVATIONS,
    "actuators": ACTUATORS,
    "sensor": SENSORS,
    "estimator": ESTIMATORS,
    "effect": EFFECTS,
    "start": STARTS,
    "model": MODELS,
    "contacts": CONTACTS,
    "friction law": FRICTION_LAWS,
    "cost": COSTS,
    "path": PATHS,
}
IN_IDS = {gym.registry[name].kwargs["task"] for name in IDS}
ENTRIES = (
    *(Entry("id", name) for name in IDS),
    *(Entry("task", name) for name in TASKS if name not in IN_IDS),
    *(Entry("other", name) for name in OTHERS),
    *(Entry(of, name) for of, names in REGISTRIES.items() for name in names),
    Entry("sensor", "shifted"),
    Entry("effect", "drift"),
    Entry("effect", "jitter"),
    Entry("actuators", "weak"),
    Entry("task", "Quiet"),
    Entry("task", "Gentle"),
)


@functools.cache
def refusal(entry: Entry, place: int) -> str | None:
    """Return the error of an entry in one of its scenes, or None."""
    try:
        entry.scenes[place].single().close()
    except ValueError as error:
        return str(error)
    return None


def served(entry: Entry) -> list[Scene]:
    """Return the scenes that accept an entry."""
    return [scene for place, scene in enumerate(entry.scenes) if refusal(entry, place) is None]


def is_one_line(text: str, *named: str) -> bool:
    """Return whether an error is one line that contains all of ``named``."""
    return bool(re.fullmatch(r"[^\n]+", text)) and all(name in text for name in named)
