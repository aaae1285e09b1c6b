"""Controllers and learners for vibgym, their training and their comparison. Runs from the checkout, not installed."""

import os

# After each parallel region torch's OpenMP threads spin for milliseconds and delay the simulator's threads in between. A lower
# spin count makes training about 10 % faster. The library reads it once, when torch is imported.
os.environ.setdefault("GOMP_SPINCOUNT", "2000")
