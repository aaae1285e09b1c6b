"""Learned policies: training with Stable-Baselines3, storage, and inference without torch."""
