"""What a user might register stands in the registries while the contracts are tried."""

import pytest

from tests.agents.conftest import one_thread
from tests.agents.training.conftest import recorded
from tests.contracts.entries import OWN

__all__ = ["one_thread", "recorded"]  # for the algorithms


@pytest.fixture(autouse=True)
def own_names(monkeypatch):
    for registry, items in OWN:
        monkeypatch.setattr(registry, "_items", {**registry._items, **items})
