"""Tuning of hyperparameters: ``python -m agents tune CONFIG``."""
