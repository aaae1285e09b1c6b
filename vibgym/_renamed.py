"""Deprecated aliases of public modules that have moved; each is removed one release after its move."""

from __future__ import annotations

import importlib
import importlib.abc
import importlib.machinery
import sys
import warnings
from collections.abc import Sequence
from types import ModuleType

RENAMED: dict[str, str] = {
    "vibgym._numba": "vibgym.kernels",
    "vibgym.envs.layout": "vibgym.envs.features",
    "vibgym.envs.named": "vibgym.envs.vector",
    "vibgym.physics.averaged.contact": "vibgym.physics.averaged.integrator",
    "vibgym.physics.collision": "vibgym.physics.contacts",
    "vibgym.physics.planar.cut": "vibgym.physics.planar.contact_area",
    "vibgym.physics.planar.outline": "vibgym.physics.planar.contact_area",
    "vibgym.physics.planar.phasors": "vibgym.physics.core.drive",
    "vibgym.physics.planar.series": "vibgym.physics.planar.wrench",
    "vibgym.physics.tilting": "vibgym.plugins.tilting",
    "vibgym.play": "vibgym.plugins.play",
    "vibgym.policies.classical.laws": "vibgym.policies.classical.steering",
    "vibgym.policies.search": "vibgym.policies",
    "vibgym.policies.trained.state_policy": "vibgym.policies.trained.trained",
    "vibgym.rendering.page": "vibgym.plugins.play.drawing",
    "vibgym.sensing.camera": "vibgym.plugins.camera",
    "vibgym.tasks.align": "vibgym.tasks.pose",
    "vibgym.tasks.arranged": "vibgym.tasks.sort",
    "vibgym.tasks.exchange": "vibgym.tasks.swap",
    "vibgym.tasks.reward": "vibgym.tasks.scoring",
    "vibgym.tasks.rotate": "vibgym.tasks.pose",
    "vibgym.tasks.singulate": "vibgym.tasks.sort",
    "vibgym.tasks.transport": "vibgym.tasks.pose",
}
"""Old module name -> new module name."""


class _Aliases(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Import the new module when an old name is imported, with a ``DeprecationWarning``."""

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        return importlib.machinery.ModuleSpec(name, self) if _target(name) else None

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> ModuleType:
        new = _target(spec.name)
        assert new is not None
        warnings.warn(f"{spec.name} has moved to {new}", DeprecationWarning, stacklevel=2)
        module = importlib.import_module(new)
        spec.loader_state = module.__spec__  # the import system replaces it
        return module

    def exec_module(self, module: ModuleType) -> None:
        assert module.__spec__ is not None
        module.__spec__ = module.__spec__.loader_state


def _target(name: str) -> str | None:
    """Return the new name of a module that has moved, or of a submodule of a package that has moved."""
    for old, new in RENAMED.items():
        if name == old or name.startswith(old + "."):
            return new + name.removeprefix(old)
    return None


def install() -> None:
    """Make old module names importable; before all other finders, which would import a moved submodule a second time."""
    if not any(isinstance(each, _Aliases) for each in sys.meta_path):
        sys.meta_path.insert(0, _Aliases())
