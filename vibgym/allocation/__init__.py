"""Which motion of the elements gives parts the acceleration that I want?

:mod:`vibgym.allocation.inverse` turns the averaged model round for one part, to second order and with certified error.
:mod:`vibgym.allocation.allocator` serves all parts of a scene at once, near rest, within what the machine's elements can do:
it stands under every controller and under ``action="wrench"``.
"""

from vibgym.allocation.allocator import Allocator
from vibgym.allocation.inverse import Allocation, Inverse, Periods, mean_acceleration, mean_state, phasors_for

__all__ = ["Allocation", "Allocator", "Inverse", "Periods", "mean_acceleration", "mean_state", "phasors_for"]
