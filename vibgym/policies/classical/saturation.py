"""The saturation block of figs. 5.18 and 5.23: no vector is longer than the limit."""

from __future__ import annotations

import numpy as np


def shortened(vectors: np.ndarray, most: float | np.ndarray) -> np.ndarray:
    """Vectors (..., n), those longer than ``most`` shortened to it; their direction stays.

    An amplitude that is limited, with its phase kept, is a push of this kind; :class:`vibgym.allocation.frictional
    .FrictionalInverse` limits in the same way what a push changes of a part's acceleration.

    Args:
        vectors: finite.
        most: broadcastable to (...,), > 0.
    """
    length = np.sqrt((vectors**2).sum(axis=-1))
    return vectors / np.maximum(length / most, 1.0)[..., None]
