"""Contact models of the planar model: one interface, :class:`vibgym.simulation.contacts.base.ContactModel`, by name."""

from __future__ import annotations

from collections.abc import Callable

from vibgym.registry import Registry
from vibgym.simulation.contacts.base import ContactModel
from vibgym.simulation.contacts.certified import CertifiedContacts
from vibgym.simulation.contacts.fast import FastContacts
from vibgym.simulation.contacts.stepped import SteppedContacts
from vibgym.simulation.model import Setup
from vibgym.simulation.schemes import PlanarSettings


def by_pymunk(setup: Setup, settings: PlanarSettings) -> ContactModel:
    """Return contacts by pymunk, which is imported only for them."""
    from vibgym.simulation.contacts.pymunk_contacts import PymunkContacts

    return PymunkContacts(setup, settings)


CONTACTS: Registry[Callable[[Setup, PlanarSettings], ContactModel]] = Registry(
    "contacts", {"certified": CertifiedContacts, "fast": FastContacts, "pymunk": by_pymunk}
)
"""Contact models by name, called with a setup and settings of the planar model; ``CONTACTS.register(name, cls)`` adds one."""

__all__ = ["CONTACTS", "ContactModel", "SteppedContacts"]
