"""Sort: bring every kind of part into its own zone."""

from __future__ import annotations

from vibgym.tasks.many import ManyTask


class Sort(ManyTask):
    """Every present part's centre inside its kind's zone and slower than 20 mm/s; none has fallen.

    The speed is that of the mean over the last period: a part that slides in place circles at 37 mm/s.
    """

    SETTINGS = ("start", "zones", "slots", "walls", "randomize")
    ZONES = True
    SPEED = 0.020
