"""Several parts: hulls, broad phase, impulses through pymunk."""
