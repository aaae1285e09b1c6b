"""Registers example user-defined entries while the contracts run."""

import pytest

from tests.contracts.entries import OWN


@pytest.fixture(autouse=True)
def own_names(monkeypatch):
    for registry, items in OWN:
        monkeypatch.setattr(registry, "_items", {**registry._items, **items})
