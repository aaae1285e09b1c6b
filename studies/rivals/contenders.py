"""Who is compared: machines, the speed that they are given, and their policies."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from studies.rivals.by_turns import ByTurnsPolicy
from studies.rivals.machines import register
from studies.rivals.policies import rival_policy
from vibgym import Surface
from vibgym.envs.vector import batch_of, environment_id
from vibgym.policies.protocol import Policy
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import TaskInfo
from vibgym.scene.sliding import top_slip

OWN_SPEED = 0.100
"""m/s, the most that Table 1.1 says of the rigid plate (10 to 100 mm/s)."""


class Contender(NamedTuple):
    """A machine and its settings in the comparison."""

    title: str
    action: str  # of the environment
    own_speed: bool = False  # whether it is as slow as Table 1.1 says; else as fast as the segmented surface


CONTENDERS: Mapping[str, Contender] = {
    "segmented": Contender("segmented surface (this thesis)", "phasor"),
    "plate": Contender("rigid plate, as fast", "plate"),
    "plate-own-speed": Contender("rigid plate, at its own speed", "plate", own_speed=True),
    "plain-plate": Contender("rigid plate, pushes in proportion", "plain-plate"),
    "conveyor": Contender("conveyor cells, both ways", "conveyor"),
    "one-way": Contender("conveyor cells, one way", "one-way"),
}
"""By name; the first is what the others are compared with."""


def strength_of(surface: Surface, speed: float) -> float:
    """Amplitude, over the largest, at which a part on a uniform field gets as fast as ``speed`` (m/s), but no faster."""
    low, high = 0.0, 1.0
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if top_slip(middle) * surface.table_speed < speed else (low, middle)
    return high


def scene_of(name: str) -> dict[str, Any]:
    """Keyword arguments of a contender's environments."""
    register()
    contender, surface = CONTENDERS[name], Surface()
    if not contender.own_speed:
        return {"action": contender.action}
    assert surface.max_amplitude is not None
    limit = strength_of(surface, OWN_SPEED) * surface.max_amplitude
    exact = dict.fromkeys(("dead_zone", "gain_spread", "phase_spread"), 0.0)
    return {"action": contender.action, "actuators": {"kind": "prototype", "limit": limit, "latency": 0, **exact}}


def policy_of(name: str, task: str) -> Policy:
    """A contender's policy for a task: the pose law under the planner; the plate serves several parts by turns."""
    env = batch_of(environment_id(task), num_envs=1, **scene_of(name))
    info = TaskInfo.of(env)
    env.close()
    action = CONTENDERS[name].action
    if name == "segmented":
        return make_policy({"kind": "pose", "action": action}, info)
    by_turns: Callable[..., Policy] = ByTurnsPolicy
    if "plate" in action and info.zones is not None:
        return by_turns(info, action)
    return rival_policy(info, action)
