"""Training: networks in torch, PPO and SAC on Stable-Baselines3, imitation, checkpoints, learning curves."""

import os

# After each parallel region torch's OpenMP threads spin for milliseconds, and so keep the simulator's threads waiting that
# run in between. Less patience makes training about 10 % faster. The library reads this once, when torch is imported.
os.environ.setdefault("GOMP_SPINCOUNT", "2000")
