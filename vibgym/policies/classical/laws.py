"""Control laws by name."""

from __future__ import annotations

from vibgym.policies.classical.law import Law
from vibgym.policies.classical.local_law import LocalLaw
from vibgym.policies.classical.lqr import LqrLaw
from vibgym.policies.classical.pid import PidLaw
from vibgym.policies.classical.pose_law import PoseLaw
from vibgym.registry import Registry

LAWS: Registry[type[Law]] = Registry("law", {"local": LocalLaw, "pose": PoseLaw, "lqr": LqrLaw, "pid": PidLaw})
"""``LAWS.register(name, cls)`` adds one of your own, made as ``cls(info, **settings)``; see :mod:`.law`. Its name is
then a controller's, too: straight to the goal with one part, under the planner with several."""
