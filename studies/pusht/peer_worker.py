"""Run gym-pusht on request: reads a JSON list ``[command, arguments...]`` a line from stdin, and prints the result as JSON.

Started by :mod:`studies.pusht.peer` in an interpreter without vibgym.
"""

import json
import sys
import time

import gym_pusht  # noqa: F401 - registers it
import gymnasium
import numpy


def state_of(env):
    """Return position and velocity of the pusher, and the pose of the T's centre of mass."""
    centre = env.block.local_to_world(env.block.center_of_gravity)
    return [*env.agent.position, *env.agent.velocity, *centre, env.block.angle]


def set_state(env, state):
    """Set a state as returned by :func:`state_of`, without the T's motion."""
    env.reset()
    env.agent.position, env.agent.velocity = state[:2], state[2:4]
    env.block.angle = state[6]
    turned = env.block.center_of_gravity.rotated(state[6])
    env.block.position = state[4] - turned[0], state[5] - turned[1]
    env.space.reindex_shapes_for_body(env.agent)
    env.space.reindex_shapes_for_body(env.block)


def rate(made, seconds):
    """Return the steps per second of random actions, resets included."""
    made.action_space.seed(0)
    actions = [made.action_space.sample() for _ in range(64)]
    made.reset(seed=0)
    taken, began = 0, time.perf_counter()
    while time.perf_counter() - began < seconds:
        _, _, terminated, truncated, _ = made.step(actions[taken % 64])
        taken += 1
        if terminated or truncated:
            made.reset()
    return taken / (time.perf_counter() - began)


def main():
    """Answer requests until stdin is closed."""
    made = gymnasium.make("gym_pusht/PushT-v0", obs_type="state")
    env = made.unwrapped
    for line in sys.stdin:
        command, *arguments = json.loads(line)
        if command == "reset":
            env.reset(seed=arguments[0])
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
        elif command == "rate":
            answer = rate(made, arguments[0])
        else:
            raise ValueError(f"unknown command {command}")
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()
