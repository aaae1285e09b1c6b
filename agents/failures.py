"""How a training may end whose settings were fine."""


class Diverged(RuntimeError):
    """A model has numbers that are not finite; nothing has been written."""


class TrainingError(RuntimeError):
    """A training that ended before its time, for no fault of the program's."""
