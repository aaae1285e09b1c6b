"""A custom control law, planar and tilting: ``python examples/custom_law.py [EPISODES]``; see docs/control.md."""

import sys

import numpy as np

from vibgym.policies import POLICIES, Law, rollout


class Spring(Law):
    """Spring to the goal and damper."""

    class Settings(Law.Settings):
        """Settings of the law."""

        stiffness: float = 60.0
        """Acceleration over displacement, 1/s^2."""

        damping: float = 12.0
        """Acceleration over velocity, 1/s."""

    def wanted(self, measured, displacement, heading_error, memory):
        """Return wanted accelerations (batch, parts, 3), m/s^2 and rad/s^2, and the memory of the law."""
        own = self.settings
        push = own.stiffness * displacement - own.damping * measured.velocity
        torque = own.stiffness * heading_error - own.damping * measured.spin
        return np.concatenate([push, torque[..., None]], axis=-1), memory


POLICIES.register("spring", Spring)
episodes = int(sys.argv[1]) if len(sys.argv) > 1 else 50
disturbed = {"disturbance": {"rate": 0.25, "tilt_deg": 3.0}, "patches": [0.8, 1.2]}
worlds = {
    "in the plane": {},
    "prototype hardware": {"actuators": "prototype", "sensor": {"kind": "pose", "estimator": "model"}},
    "rigid, disturbed, on rough elements": {"model": "tilting", "randomize": disturbed},
}
for policy in ({"kind": "spring"}, {"kind": "spring", "damping": 15.0}, {"kind": "pose"}):
    for name, settings in worlds.items():
        result = rollout(policy, "vibgym/Align-v0", seeds=range(episodes), **settings)
        times = result.time_to_goal[result.success]
        median = f"median {np.median(times):.2f} s" if len(times) else "never there"
        print(f"{policy!s:36} {name:34} {100 * result.success.mean():5.1f} %, {median}")
