"""Bounds on the performance of any policy, for all commands of the elements; ``docs/bound.md`` derives them.

Least times of one part (:class:`TimeBound`), of several (:class:`SeveralBound`), of one that others push (:class:`PushBound`),
and the most parts a minute where parts come and go (:class:`FlowBound`).
"""

from vibgym.bounds.several import FlowBound, PushBound, SeveralBound
from vibgym.bounds.time_bound import TimeBound

__all__ = ["FlowBound", "PushBound", "SeveralBound", "TimeBound"]
