"""What a user might register stands in the registries while the contracts are tried."""

import pytest

from tests.contracts.entries import OWN


@pytest.fixture(autouse=True)
def own_names(monkeypatch):
    for registry, items in OWN:
        monkeypatch.setattr(registry, "_items", {**registry._items, **items})
