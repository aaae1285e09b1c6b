"""Several parts: hulls, broad phase, impacts, impulses."""
