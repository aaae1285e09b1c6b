"""Failures of trainings with valid settings."""


class Diverged(RuntimeError):
    """A weight or a loss is not finite; nothing has been written."""


class TrainingError(RuntimeError):
    """A training diverged."""
