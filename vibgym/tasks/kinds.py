"""Kinds of parts: parts with the same name are of one kind, irrespective of their shape."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vibgym import checks
from vibgym.scene.parts import Part

MOST_KINDS = 3
"""Observations have room for these."""


def kinds_by_name(parts: Sequence[Part]) -> tuple[tuple[str, ...], np.ndarray]:
    """Names of the kinds in order of appearance, and each part's kind (parts,). Parts with the same name are of one kind.

    Raises:
        ValueError: there are too many kinds.
    """
    names = tuple(dict.fromkeys(part.name for part in parts))
    if len(names) > MOST_KINDS:
        raise checks.refuse("parts", f"{len(names)} kinds: {', '.join(names)}", f"at most {MOST_KINDS} kinds (names)")
    return names, np.array([names.index(part.name) for part in parts])
