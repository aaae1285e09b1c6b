"""Fields without a sensor, as in chapter 4 of the thesis: planned at the start of an episode, never corrected.

The goal and where the part was put down are known (the first observation of an episode); after that nothing is looked at.
A radial field brings the part to the goal from wherever it is. To align it, a squeeze field towards a line through the
goal, along the wanted heading, follows. To turn it, a tangential field acts for the time that the turn takes at its steady
rate: friction lets the spin build up and run out with the same lag, so the two cancel.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from agents.control.seen import see, started
from agents.policy import Situation
from vibgym import checks
from vibgym.fields import radial, squeeze, tangential


class OpenLoopPolicy:
    """Whole-surface fields around the goal, as ``"phasor"`` actions.

    Args:
        situation: task, surface and part.
        turn_rate: rad/s, steady angular velocity in the tangential field.
        gather_time: s, time that the radial field gets before the squeeze field aligns the part.
        centring: strength of the radial field beside the squeeze field.
    """

    action, observation = "phasor", "state"

    def __init__(
        self, situation: Situation, turn_rate: float = 11.5, gather_time: float = 2.0, centring: float = 0.2
    ) -> None:
        situation.check_served("open_loop", many=False)
        self.situation = situation
        self.turn_rate = checks.number("turn_rate", turn_rate, above=0.0)
        self.gather_time = checks.number("gather_time", gather_time, least=0.0)
        self.centring = checks.number("centring", centring, least=0.0, most=1.0)

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Field of the goal latched at the episode's start; the state counts the steps since."""
        surface, part = self.situation.surface, self.situation.part
        seen = see(observation, surface, part)
        new = started(state, episode_start, len(seen.error))
        plan = np.zeros((len(new), 5)) if state is None else state.copy()  # goal x, y, heading, turn, steps
        plan[new] = np.column_stack(
            [seen.centre + seen.error, seen.heading + seen.turn, seen.turn, np.zeros(len(new))]
        )[new]
        x, y, heading, turn, step = (column[:, None, None] for column in plan.T)
        time = step * surface.period
        if self.situation.task == "Rotate":
            turning = time < np.abs(turn) / self.turn_rate
            field = radial(x, y, turning) + tangential(x, y, np.sign(turn) * turning)
        elif self.situation.task == "Align":
            gathering = time < self.gather_time
            field = radial(x, y, np.where(gathering, 1.0, self.centring)) + squeeze(x, y, heading, 1.0 * ~gathering)
        else:
            field = radial(x, y)
        plan[:, 4] += 1.0
        action = field.phasors(surface, friction=part.friction).astype(np.float32)
        return (action[0] if seen.single else action), plan
