"""Settings that conflict with one another or with the scene: one table of refusals for environments.

Wrong types, ranges and unknown names of each setting alone: see ``test_settings.py``.
"""

import math

import pytest

from tests.contracts.entries import is_one_line
from tests.envs.helpers import batch, single
from vibgym import Part
from vibgym.envs import VibgymEnv, VibgymVectorEnv
from vibgym.registration import PUSHER, TEE
from vibgym.tasks import TASKS, ArrangedTask

STEEL, ALUMINIUM = "steel_block", "aluminium_block"
WIDTH, DEPTH = 0.832, 0.208
LEFT, RIGHT = [0.0, 0.0, 0.156, DEPTH], [0.676, 0.0, WIDTH, DEPTH]
HUGE = {"shape": "disc", "radius": 0.105, "friction": 0.5}
LIGHT = {"shape": "disc", "radius": 0.02, "friction": 0.5, "mass": 1e-4}
GRIPPY = {"shape": "disc", "radius": 0.02, "friction": 4.0}
TALL = {"shape": "rectangle", "length": 0.02, "width": 0.02, "friction": 0.2, "height": 0.09}
DISC = {"shape": "disc", "radius": 0.02, "friction": 0.6, "name": "disc"}
SQUARE = {"shape": "rectangle", "length": 0.04, "width": 0.04, "friction": 0.6, "name": "square"}
CIRCLE = {"shape": "circle", "centre_mm": [400, 104], "radius_mm": 60}
LINE = {"shape": "polyline", "points_mm": [[100, 50], [300, 50], [300, 150]]}
SMALL, MEDIUM, LARGE = (Part.rectangle(a, 0.7 * a, friction=0.6, name=f"{1e3 * a:g} mm") for a in (0.03, 0.05, 0.07))


def zones(**zones):
    """Return zones of Sort, with default ones."""
    return {"zones": {STEEL: LEFT, ALUMINIUM: RIGHT, **zones}}


def pack(**settings):
    """Return six equal parts to pack."""
    return {"parts": [ALUMINIUM] * 6, "task_settings": settings}


def feed(slots=(3, 2, 1), **settings):
    """Return three different parts in so many slots each."""
    parts = [part for part, count in zip((SMALL, LARGE, MEDIUM), slots, strict=True) for _ in range(count)]
    return {"parts": parts, "task_settings": settings}


def drawn(**settings):
    """Return a part with a drawn shape."""
    return {"split": "test", "parts": [{"shape": "drawn"}], **settings}


def prototype(**settings):
    """Return actuators of a small machine."""
    return {"actuators": {"kind": "prototype", **settings}}


ROW = [[0.1 + 0.06 * k, 0.1, 0.0] for k in range(6)]
ELEMENTS = [[[1.0, 0.0]]]

OF_ENVIRONMENTS = [
    ("Align", {"surface": "table"}, "surface"),
    ("Align", {"surface": {"rows": 2, "columns": 2}}, "parts"),  # too small for the part
    ("Align", {"parts": []}, "parts"),
    ("Align", {"parts": [ALUMINIUM, STEEL]}, "parts"),
    ("Align", {"parts": ["gold_block"]}, "parts"),
    *((task, {"parts": [HUGE]}, "parts") for task in ("Transport", "Align", "Rotate", "Sort")),
    ("Sort", {"parts": [STEEL, {"shape": "disc", "friction": 0.5}]}, r"parts\[1\]\.radius"),
    ("Align", {"observation": "camera"}, "observation"),  # without a camera
    *((task, {"observation": "goal"}, "observation") for task in ("Sort", "Follow", "TwoGoals")),
    ("Align", {"periods_per_step": 1.5}, "periods_per_step"),
    ("Align", {"max_episode_periods": 0}, "max_episode_periods"),
    ("Sort", {"colour": "red"}, "keyword argument"),
    ("Align", {"surface": {"horizontal_amplitude": 4e-4}, "model": "averaged"}, "model"),  # requires permanent sliding
    ("Sort", {"model": "averaged"}, "model"),
    ("Align", {"action": "wrench", "parts": [GRIPPY]}, "parts"),
    *(("Align", {"action": name, "surface": {"frequency": 5.0}}, "parts") for name in ("velocity", "target")),
    *(("Align", {name: value}, name) for name, value in (
        ("walls", ["left"]), ("slots", 3), ("start", "crowded"), ("zones", {}), ("paths", {"speed": 0.1}),
    )),
    ("Singulate", {"start": "crowded"}, "start"),
    ("Singulate", {"zones": {}}, "zones"),
    ("Follow", {"walls": ["left"]}, "walls"),
    ("Sort", {"walls": ["left", "left"]}, "walls"),
    ("Sort", {"walls": ["north"]}, "walls"),
    ("Sort", {"costs": {}}, "costs"),
    ("Align", drawn(split="tests"), "split"),
    ("Align", drawn(split=None), "drawn"),
    ("Align", {"shapes": [1]}, "shapes require split"),
    ("Align", drawn(shapes=[28]), r"shapes\[0\]"),
    ("Align", drawn(shapes=[1, 2]), "shapes"),
    ("Align", drawn(shapes=3), "shapes"),
    ("Align", drawn(parts=[ALUMINIUM]), "drawn shape"),
    ("Align", drawn(parts=[{"shape": "drawn", "which": 1}]), "which"),
    ("Feed", drawn(), "Feed"),
]  # fmt: skip
OF_RANDOMIZATION = [
    ("Align", {"randomize": {"gravity": [1, 2]}}, "randomize"),
    ("Align", {"randomize": {"friction": [1.5, 0.5]}}, "randomize: friction"),
    ("Align", {"randomize": {"friction": [1, 6]}, "model": "averaged"}, r"randomize\['friction'\]"),
    ("Align", {"randomize": {"patches": [1, 6]}, "model": "averaged"}, r"randomize\['patches'\]"),
    ("Sort", {"randomize": {"mass": [0.1, 1]}, "parts": [STEEL, LIGHT]}, r"randomize\['mass'\]"),
    ("Align", {"randomize": {"disturbance": 0.3}}, r"randomize\.disturbance"),
    ("Align", {"randomize": {"disturbance": {"rate": 1.0, "tilt_deg": [3, 1]}}}, r"randomize\.disturbance: tilt"),
    ("Align", {"randomize": {"disturbance": {"rate": 1, "tilt_deg": [1, 30]}}, "model": "tilting", "parts": [TALL]},
     r"randomize\.disturbance\.tilt"),
    ("Align", {"randomize": {"parts": [1, 1]}}, "randomize"),
    ("Sort", {"randomize": {"parts": [4, 3]}}, r"randomize\.parts"),
    ("Sort", {"randomize": {"parts": [1, 7]}}, r"randomize\.parts"),
    ("Align", {"randomize": {"dead_zone": [0.0, 1e-4]}}, "randomize"),  # of ideal actuators
    *(("Align", {"actuators": "prototype", "randomize": {name: value}}, rf"randomize\['{name}'\]") for name, value in (
        ("dead_zone", [2e-4, 1e-4]), ("latency", [0, 1.5]), ("latency", [0, 400]), ("limit", [5e-5, 2e-4]), ("dead", 0.5),
    )),
]  # fmt: skip
OF_HARDWARE = [
    ("Align", prototype(dead_zone=3e-4, limit=2e-4), r"actuators\.dead_zone"),
    ("Align", prototype(limit=1e-3), r"actuators\.limit"),
    ("Align", prototype(resolution=1e-3), r"actuators\.resolution"),
    ("Align", prototype(latency=300), r"actuators\.latency"),  # longer than an episode
    ("Align", prototype(dead=[[0, 1], [0, 1]]), r"actuators\.dead"),
    ("Align", prototype(dead=[[0, 32]]), r"actuators\.dead"),
    ("Align", prototype(dead=[[0, 1]], stuck=[[0, 1, 1e-4, 0.0]]), r"actuators\.stuck"),
    ("Align", prototype(dead=0.7, stuck=0.6), r"actuators\.stuck"),
    ("Align", prototype(stuck=[[0, 0, 1e-3, 0.0]]), r"actuators\.stuck"),
    ("Align", prototype(elements=ELEMENTS), r"actuators\.elements"),
    ("Align", prototype(gain=0.0, compensate=True), "gain"),
    *(("Align", {"sensor": {"kind": "pose", **settings}}, rf"sensor\.{name}") for name, settings in (
        ("rate", {"rate": 20.0}), ("delay", {"delay": 250}), ("report", {"report": ["age", "age"]}),
        (r"noise\.position", {"noise": [1e-4]}), ("noise: position", {"noise": 2.0}),
    )),
    *(("Push", {"sensor": {**sensor, "report": ["contacts"]}}, r"sensor\.report") for sensor in (
        {"kind": "pose"}, {"kind": "ideal", "estimator": "kalman"},
    )),
    ("Align", {"sensor": {"kind": "pose", "fog": 1}}, "sensor"),
    *(("Align", {"sensor": {"kind": "camera", **settings}}, name) for name, settings in (
        (r"sensor\.effects", {"effects": {"fog": 1}}), ("effects.bias", {"bias": 1e-4, "effects": {"bias": 1e-4}}),
        ("sensor", {"height": 0.5}), ("sensor", {"tilt": [1.0, 1.0], "height": 0.02}),
        (r"sensor\.border", {"border": 0.001}), (r"sensor\.mark", {"mark": 0.001}), (r"sensor\.(mark|border)", {"mark": 0.05}),
    )),
    ("Feed", {"sensor": "camera"}, "sensor"),
]  # fmt: skip
OF_TASKS = [
    ("Align", {"task_settings": {"hold": 251}}, r"task_settings.*hold"),  # longer than an episode
    ("Follow", {"task_settings": {"hold": 480}}, "paths"),
    ("Align", {"task_settings": {"weights": {"speed": 1.0}}}, "'speed'"),
    ("Align", {"task_settings": {"weights": {"time": math.nan}}}, r"\.time"),
    ("Align", {"task_settings": {"weights": {3: 1.0}}}, r"\.3"),
    ("Align", {"observation": "goal", "task_settings": {"weights": {"time": 0.1}}}, r"task_settings\.weights"),
    ("Sort", {"surface": {"columns": 8}}, "zones"),
    ("Sort", {"surface": {"columns": 11}}, "zones"),
    ("Sort", {"surface": {"rows": 2, "columns": 2}}, "parts"),
    ("Sort", {"zones": {STEEL: LEFT}}, "zones"),
    ("Sort", zones(gold=LEFT), "zones"),
    *(("Sort", zones(**values), rf"zones\.{name}") for name, values in (
        (STEEL, {STEEL: LEFT[:3]}), (STEEL, {STEEL: [0.156, 0, 0, 0.2]}),
        (STEEL, {STEEL: [-0.001, 0, 0.2, 0.2]}), (ALUMINIUM, {ALUMINIUM: [0.155, 0, WIDTH, 0.2]}),
        (STEEL, {STEEL: [0, 0, 0.13, 0.1]}),
    )),
    ("Sort", {"parts": [STEEL, ALUMINIUM, DISC, SQUARE]}, "parts"),  # four kinds
    ("Sort", {"parts": [STEEL] * 37}, "parts"),
    ("Sort", {"slots": 5}, "slots"),
    ("Singulate", {"parts": [STEEL] * 17}, "parts"),
    ("Follow", {"parts": [STEEL] * 12}, "parts"),
    ("Follow", {"surface": {"horizontal_amplitude": 0.0}}, "parts"),
    ("Follow", {"surface": {"max_amplitude": 0.0}}, "parts"),
    ("Follow", {"parts": [{**DISC, "friction": 0.0}]}, "parts"),
    ("Follow", {"paths": "circle"}, "paths"),
    ("Follow", {"paths": [CIRCLE, CIRCLE]}, "paths"),  # of one part
    ("Follow", {"parts": [STEEL] * 2, "paths": [CIRCLE]}, "paths"),
    *(("Follow", {"paths": settings}, message) for settings, message in (
        ({"shapes": []}, r"paths\.shapes"), ({"shapes": ["star"]}, r"paths\.shapes\[0\]"), ({"speed": 0.3}, r"paths\.speed"),
        ({"acceleration": 2.5}, r"paths\.acceleration"), ({"speed": 0.25}, "parts"),
    )),
    *(("Follow", {"paths": [path]}, rf"paths\[0\]{name}") for path, name in (
        (3, ""), ({"shape": "star"}, ".shape"), ({**CIRCLE, "speed": 0.3}, ".speed"),
        ({**CIRCLE, "radius_mm": 5}, ".speed"), ({**CIRCLE, "acceleration": 3}, ".acceleration"),
        ({**CIRCLE, "centre_mm": [60, 104]}, ".centre"), ({**CIRCLE, "radius_mm": 120}, ".radius"),
        ({**LINE, "points_mm": [[100, 50], [300, 50], [100, 50]]}, ".points"),
        ({**LINE, "points_mm": [[100, 50], [100, 50]]}, ".points"),
        ({**LINE, "points_mm": [[100, 50], [300, 50]], "closed": True}, ".points"),
        ({"shape": "square", "centre_mm": [400, 104], "side_mm": 30}, ".side"), ({**LINE, "laps": 2}, ".laps"),
    )),
    ("Follow", {"paths": [{**CIRCLE, "laps": 9}]}, "paths"),  # longer than an episode
    *(("Pack", pack(**settings), name) for name, settings in (
        ("on this surface", {"rows": 6}), ("place", {"place_mm": [10, 100]}), ("columns", {"rows": 2, "columns": 2}),
        ("pattern", {"pattern": ROW[:5]}), ("goals 0 and 1", {"pattern": ROW[:1] * 6}),
        ("on this surface", {"pattern": [[x - 0.1, y, turn] for x, y, turn in ROW]}),
        ("pattern", {"pattern": [place[:2] for place in ROW]}), ("pattern", {"pattern": {STEEL: []}}),
        ("'gap'", {"pattern": ROW, "gap_mm": 2}), ("start", {"start": {"kind": "pattern", "gap_mm": 60, "rows": 3}}),
        ("gap_mm.*start", {"start": {"kind": "crowded", "gap_mm": 1}}),
    )),
    ("Swap", {"parts": [STEEL] * 4}, "parts"),
    ("Swap", {"task_settings": {"columns": 17}}, r"task_settings\.columns"),
    ("Swap", {"task_settings": {"columns": 4}}, "parts"),
    *(("PushAny", {"parts": parts}, "parts") for parts in ([PUSHER, PUSHER], [TEE], [PUSHER] * 5 + [TEE])),
    ("Feed", {"zones": {STEEL: [0.7, 0, 0.8, 0.1]}}, "zones"),
    ("Feed", {"zones": {"brass": [0.7, 0, 0.8, 0.1]}}, "zones"),
    ("Feed", {"surface": {"columns": 3}}, "zones"),
    ("Feed", {"task_settings": {"heap": 13}}, r"task_settings\.heap"),
    ("Feed", {"task_settings": {"heap": 12}}, r"task_settings\.heap"),
    ("Feed", feed(most=7), r"task_settings\.most"),
    ("Feed", feed(most=1, heap=2), r"task_settings\.most"),
    ("Feed", feed(probabilities=[0.5, 0.5]), r"task_settings\.probabilities"),
    ("Feed", feed(probabilities=[0.5, 0.4, 0.2]), r"task_settings\.probabilities"),
    ("Feed", feed(probabilities=[0.7, 0.3, 0.0]), r"task_settings\.probabilities\[2\]"),
    ("Feed", feed(probabilities=[0.6, 0.3, 0.1], heap=2), r"parts\[5\]"),
]  # fmt: skip


class TwoGoals(ArrangedTask):
    """Every part has a goal pose, and no PoseTask's reward."""

    has_goal = True


@pytest.mark.parametrize(
    "task, settings, named",
    [*OF_ENVIRONMENTS, *OF_RANDOMIZATION, *OF_HARDWARE, *OF_TASKS],
    ids=lambda value: str(value)[:60],
)
def test_conflicts_are_one_error_that_names_them(task, settings, named, monkeypatch):
    monkeypatch.setattr(TASKS, "_items", {**TASKS._items, "TwoGoals": TwoGoals})
    if task == "TwoGoals":
        makers = (lambda: VibgymEnv(task, **settings), lambda: VibgymVectorEnv(task, num_envs=2, **settings))
    else:
        makers = (lambda: single(task, **settings), lambda: batch(task, 2, **settings))
    for make in makers:
        with pytest.raises(ValueError, match=named) as error:
            make()
        assert is_one_line(str(error.value))


@pytest.mark.parametrize("task, settings", [
    ("Align", {"task_settings": {"hold": 250}}), ("Align", {"parts": [{**HUGE, "radius": 0.1}]}),
    *(("TwoGoals", {"observation": observation}) for observation in ("state", "parts", "image")),
    ("Sort", zones(**{STEEL: [0, 0, 0.416, DEPTH], ALUMINIUM: [0.416, 0, WIDTH, DEPTH]})),  # share a border
    ("Sort", {"parts": [STEEL] * 40, "zones": {STEEL: [0, 0, WIDTH, DEPTH]}, "randomize": {"parts": [1, 30]}}),
    ("Sort", {**zones(**{STEEL: [0, 0, 0.13, 0.1]}), "randomize": {"parts": [1, 2]}}),  # room for two
])  # fmt: skip
def test_values_at_the_limits_are_accepted(task, settings, monkeypatch):
    """Room is required for parts that are present at the same time."""
    monkeypatch.setattr(TASKS, "_items", {**TASKS._items, "TwoGoals": TwoGoals})
    env = VibgymEnv(task, **settings) if task == "TwoGoals" else single(task, **settings)
    env.reset(seed=0)


@pytest.mark.parametrize("name, value", [
    ("num_envs", 0), ("num_envs", 2.0), ("autoreset_mode", "Sometimes"), ("max_episode_steps", 0), ("render_mode", "human"),
])  # fmt: skip
def test_bad_settings_of_a_batch(name, value):
    with pytest.raises(ValueError, match=name):
        VibgymVectorEnv("Align", **{"num_envs": 2, name: value})
    with pytest.raises(ValueError, match="render_mode"):
        VibgymEnv("Align", render_mode="pixels")
