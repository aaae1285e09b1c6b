"""Every setting is stated once, and refused by one line that names it: of registered classes, and of scenes."""

import math
from typing import Annotated, Any, get_args, get_origin

import pytest
from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel

from studies.manual.settings import REGISTRIES
from vibgym.envs.drawn import DrawnPart
from vibgym.envs.randomization import Disturbance, Randomization
from vibgym.scene.part_settings import SHAPES, DrawingSettings
from vibgym.scene.surface import SurfaceSettings
from vibgym.settings import BaseSettings, read, table, with_unit
from vibgym.tasks.follow import DrawnSettings
from vibgym.tasks.paths import SHAPES as PATHS

try:
    from agents.algorithms import ALGORITHMS
except ModuleNotFoundError:  # without the extra "learn"
    REGISTERING = REGISTRIES
else:
    REGISTERING = {**REGISTRIES, "algorithm": ALGORITHMS}

REGISTERED = {
    f"{what}: {name}": item.Settings
    for what, registry in REGISTERING.items()
    for name, item in registry.items()
    if hasattr(item, "Settings") and item.Settings.model_config["extra"] == "forbid"  # Stable-Baselines3 checks its own
}
CLASSES: dict[str, Any] = {
    **REGISTERED,
    **{f"part: {name}": cls for name, cls in SHAPES.items()},
    **{f"path: {name}": cls for name, cls in PATHS.items()},
    "part: file": DrawingSettings, "part: drawn": DrawnPart, "paths: drawn": DrawnSettings, "surface": SurfaceSettings,
    "randomize": Randomization.Settings, "disturbance": Disturbance,
}  # fmt: skip

REQUIRED: dict[str, dict] = {
    "policy: trained": {"path": "a.json"},
    "policy: residual": {"path": "a.json"},
    "policy: parallel_rollout": {"policies": ("pose",)},
    "algorithm: offline": {"dataset": "a/b-v0"},
    "algorithm: flow": {"dataset": "a/b-v0"},
    "part: rectangle": {"friction": 0.5, "length": 0.05, "width": 0.03},
    "part: disc": {"friction": 0.5, "radius": 0.02},
    "part: polygon": {"friction": 0.5, "vertices": ((0.0, 0.0), (0.05, 0.0), (0.0, 0.05))},
    "part: file": {"file": "a.dxf"},
    "part: drawn": {"shape": "drawn"},
    "path: circle": {"shape": "circle", "centre": (0.4, 0.1), "radius": 0.05},
    "path: square": {"shape": "square", "centre": (0.4, 0.1), "side": 0.1},
    "path: polyline": {"shape": "polyline", "points": ((0.1, 0.1), (0.3, 0.1))},
    "path: figure_eight": {"shape": "figure_eight", "centre": (0.4, 0.1), "radius": 0.04},
    "disturbance": {"rate": 1.0, "tilt": 0.02},
}
"""Values of settings without a default."""

POLICIES = ("policy: mpc", "base"), ("policy: residual", "base")
"""Settings that are policies, which may be any object with ``predict``; :func:`vibgym.make_policy` checks them."""


def test_classes_are_settings_of_their_own():
    assert all(issubclass(cls, BaseSettings) for cls in CLASSES.values())
    needed = {
        (name, setting)
        for name, cls in CLASSES.items()
        for setting, field in cls.model_fields.items()
        if field.is_required()
    }
    assert needed == {(name, setting) for name, values in REQUIRED.items() if name in CLASSES for setting in values}


@pytest.mark.parametrize("name", CLASSES)
def test_every_setting_refuses_what_it_is_not(name):
    model, needed = CLASSES[name], REQUIRED.get(name, {})
    read(model, needed, "it")
    for setting, field in model.model_fields.items():
        if field.annotation is Any:
            assert (name, setting) in POLICIES
            continue
        others = () if setting == "history" else alike(field)  # true: 1
        for value in (object(), math.nan, math.inf, -math.inf, *beyond(field), *others):
            refused(model, {**needed, setting: value}, f"it.{setting}")
    for setting in needed:
        refused(model, {other: value for other, value in needed.items() if other != setting}, f"it.{setting}")


@pytest.mark.parametrize("name", CLASSES)
def test_units_are_read_once(name):
    model, needed = CLASSES[name], REQUIRED.get(name, {})
    for key, (setting, _) in with_unit(model).items():
        refused(model, {**needed, setting: 0.0, key: 0.0}, setting)
    for key in ("no_such", "no_such_mm", 3):
        refused(model, {**needed, key: 1.0}, str(key))


@pytest.mark.parametrize("name", CLASSES)
def test_defaults_are_in_range(name):
    """pydantic does not validate defaults."""
    model = CLASSES[name]
    defaults = {n: f.get_default() for n, f in model.model_fields.items() if not f.is_required()}
    read(model, {**defaults, **REQUIRED.get(name, {})}, "it")


@pytest.mark.parametrize("name", REGISTERED)
def test_every_setting_has_a_meaning(name):
    for line in table(CLASSES[name]).splitlines()[2:]:
        assert line.count("|") >= 5 and not line.endswith("|  |"), line


def members(annotation):
    """Yield each type of a union with its bounds."""
    for inner in (annotation, *get_args(annotation)):
        kind, *more = get_args(inner) if get_origin(inner) is Annotated else (inner,)
        yield get_origin(kind) or kind, [bound for one in more for bound in getattr(one, "metadata", [one])]


def beyond(field):
    """Yield values just outside the range of a field, or of its items."""
    yield from outside(field.metadata)
    for _, bounds in members(field.annotation):
        yield from outside(bounds)
    for inner in (field.annotation, *get_args(field.annotation)):
        if get_origin(inner) is tuple:
            items = list(members(inner))[1:]
            yield from ((limit,) * len(items) for _, bounds in items for limit in outside(bounds))


def outside(bounds):
    """Yield a number beyond each bound of a range."""
    for bound in bounds:
        if isinstance(bound, Gt | Ge):
            yield bound.gt if isinstance(bound, Gt) else beside(bound.ge, -1)
        if isinstance(bound, Lt | Le):
            yield bound.lt if isinstance(bound, Lt) else beside(bound.le, 1)


def beside(limit, sign):
    """Return the next number beyond a limit."""
    return limit + sign if isinstance(limit, int) else math.nextafter(limit, sign * math.inf)


def alike(field):
    """Yield values that Python could take for a number or for a switch, and None, where they are none."""
    kinds = {kind for kind, _ in members(field.annotation)}
    if kinds & {int, float} and not kinds & {str, bool}:
        yield from ("1", True, [1.0], {"a": 1.0}, 1j, *([] if float in kinds else [1.0]))
    if field.annotation is bool:
        yield from (1, "yes")
    if type(None) not in kinds:
        yield None


def refused(model: type[BaseModel], values, name):
    with pytest.raises(ValueError) as error:
        read(model, values, "it")
    text = str(error.value)
    assert name in text and "\n" not in text and "pydantic" not in text, text
