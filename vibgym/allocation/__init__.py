"""Control allocation: element motion for a required acceleration of parts.

:mod:`vibgym.allocation.frictional` computes the push that an acceleration requires at a velocity;
:mod:`vibgym.allocation.allocator` distributes the pushes of all parts of a scene to the elements under them, within dead zone
and limit of the hardware. Both are used by every controller and by ``action="wrench"``.
"""

from vibgym.allocation.allocator import Allocator

__all__ = ["Allocator"]
