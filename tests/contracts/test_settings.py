"""Every setting of every registered class is stated once, and refused by one line that names it."""

import math
from typing import Any

import pytest
from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel

from studies.manual.settings import REGISTRIES
from vibgym.settings import BaseSettings, read, table, with_unit

CLASSES = {
    f"{what}: {name}": item.Settings
    for what, registry in REGISTRIES.items()
    for name, item in registry.items()
    if hasattr(item, "Settings")
}

REQUIRED: dict[str, dict] = {
    "policy: trained": {"path": "a.json"},
    "policy: residual": {"path": "a.json"},
    "policy: parallel_rollout": {"policies": ("pose",)},
}
"""Values of settings without a default."""

POLICIES = ("policy: mpc", "base"), ("policy: residual", "base")
"""Settings that are policies, which may be any object with ``predict``; :func:`vibgym.make_policy` checks them."""


def test_classes_are_settings_of_their_own():
    assert all(issubclass(each, BaseSettings) for each in CLASSES.values())
    needed = {
        (name, setting)
        for name, each in CLASSES.items()
        for setting, field in each.model_fields.items()
        if field.is_required()
    }
    assert needed == {(name, setting) for name, values in REQUIRED.items() for setting in values}


@pytest.mark.parametrize("name", CLASSES)
def test_every_setting_refuses_what_it_is_not(name):
    model, needed = CLASSES[name], REQUIRED.get(name, {})
    read(model, needed, "it")
    for setting, field in model.model_fields.items():
        if field.annotation is Any:
            assert (name, setting) in POLICIES
            continue
        wrong = [object(), math.nan, math.inf, -math.inf, *beyond(field)]
        for value in wrong:
            refused(model, {**needed, setting: value}, f"it.{setting}")


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
    given = {n: f.get_default() for n, f in model.model_fields.items() if not f.is_required()}
    read(model, {**given, **REQUIRED.get(name, {})}, "it")


@pytest.mark.parametrize("name", CLASSES)
def test_every_setting_has_a_meaning(name):
    for line in table(CLASSES[name]).splitlines()[2:]:
        assert line.count("|") >= 5 and not line.endswith("|  |"), line


def beyond(field):
    """Yield numbers just outside the range of a field."""
    for bound in field.metadata:
        if isinstance(bound, Gt | Ge):
            limit = bound.gt if isinstance(bound, Gt) else bound.ge - 1
            yield limit
        if isinstance(bound, Lt | Le):
            yield bound.lt if isinstance(bound, Lt) else bound.le + 1


def refused(model: type[BaseModel], given, name):
    with pytest.raises(ValueError) as error:
        read(model, given, "it")
    text = str(error.value)
    assert name in text and "\n" not in text and "pydantic" not in text, text
