"""Bounds on the performance of any policy, for all commands of the elements; ``docs/bound.md`` derives them.

Least times for one part (:class:`TimeBound`), for several (:class:`SeveralBound`), and for a part pushed by others
(:class:`PushBound`); largest flow in parts per minute (:class:`FlowBound`).
"""

from vibgym.bounds.several import FlowBound, PushBound, SeveralBound
from vibgym.bounds.time_bound import TimeBound

__all__ = ["FlowBound", "PushBound", "SeveralBound", "TimeBound"]
