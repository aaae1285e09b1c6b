"""Run gym-pusht on request: reads a JSON list ``[command, arguments...]`` a line from stdin, and prints the result as JSON.

Started by :mod:`studies.pusht.peer` in an interpreter without vibgym.
"""

import json
import sys
from typing import Any

import gym_pusht  # noqa: F401 # pyright: ignore[reportMissingImports] - registers it
import gymnasium
import numpy


def state_of(env):
    """Return position and velocity of the pusher, and the pose of the T's centre of mass."""
    centre = env.block.local_to_world(env.block.center_of_gravity)
    return [*env.agent.position, *env.agent.velocity, *centre, env.block.angle]


def set_state(env, state):
    """Set a state as returned by :func:`state_of`, without the T's motion."""
    env.reset(options={"reset_to_state": [50, 50, 256, 256, 0]})  # without contacts, whose corrections would persist
    env.agent.position, env.agent.velocity = state[:2], state[2:4]
    env.block.angle = state[6]
    turned = env.block.center_of_gravity.rotated(state[6])
    env.block.position = state[4] - turned[0], state[5] - turned[1]
    env.space.reindex_shapes_for_body(env.agent)
    env.space.reindex_shapes_for_body(env.block)


def main():
    """Answer requests until stdin is closed."""
    made = gymnasium.make("gym_pusht/PushT-v0", obs_type="state", visualization_width=320, visualization_height=320)
    env: Any = made.unwrapped
    for line in sys.stdin:
        command, *arguments = json.loads(line)
        if command == "reset":
            env.reset(seed=arguments[0])
            env._last_action = None  # which pictures show
            answer = state_of(env)
        elif command == "set":
            set_state(env, arguments[0])
            answer = state_of(env)
        elif command == "steps":
            answer = []
            for action in arguments[0]:
                _, _, _, _, info = env.step(numpy.array(action))
                answer.append([*state_of(env), info["coverage"]])
        elif command == "picture":
            answer = env.render().tolist()
        else:
            raise ValueError(f"unknown command {command}")
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()
