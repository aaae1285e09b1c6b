"""Lower bounds on the time that parts need to their goals, whatever the elements do; ``docs/bound.md`` derives them."""

from vibgym.bounds.pushing import PushBound
from vibgym.bounds.several import SeveralBound
from vibgym.bounds.time_bound import TimeBound

__all__ = ["PushBound", "SeveralBound", "TimeBound"]
