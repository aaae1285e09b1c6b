"""A lower bound on the time that a part needs to its goal, whatever the elements do; ``docs/bound.md`` derives it."""

from vibgym.bounds.time_bound import TimeBound

__all__ = ["TimeBound"]
