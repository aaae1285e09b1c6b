"""Environments of other packages, see :class:`studies.worker.Worker`: ``peers_worker.py pusht``, or ``envpool WORLDS THREADS``.

Runs in an interpreter without vibgym (``make peers``).
"""

import json
import sys
import time


class PushT:
    """PushT-v0 of gym-pusht with state observations."""

    def __init__(self):
        import gym_pusht  # noqa: F401 - registers it
        import gymnasium

        size = {"visualization_width": 320, "visualization_height": 320}
        self.limited = gymnasium.make("gym_pusht/PushT-v0", obs_type="state", **size)
        self.limited.action_space.seed(0)
        self.actions = [self.limited.action_space.sample() for _ in range(64)]
        self.limited.reset(seed=0)
        self.env, self.taken = self.limited.unwrapped, 0

    def advance(self):
        """Take a step with a random action, and reset at the end; return 1."""
        _, _, terminated, truncated, _ = self.limited.step(self.actions[self.taken % 64])
        self.taken += 1
        if terminated or truncated:
            self.limited.reset()
        return 1

    def state(self):
        """Return position and velocity of the pusher, and the pose of the T's centre of mass."""
        env = self.env
        centre = env.block.local_to_world(env.block.center_of_gravity)
        return [*env.agent.position, *env.agent.velocity, *centre, env.block.angle]

    def reset(self, seed):
        """Start an episode; return its state."""
        self.env.reset(seed=seed)
        self.env._last_action = None  # which pictures show
        return self.state()

    def set(self, state):
        """Set a state, without the T's motion, and return it."""
        env = self.env
        env.reset(
            options={"reset_to_state": [50, 50, 256, 256, 0]}
        )  # without contacts, whose corrections would persist
        env.agent.position, env.agent.velocity = state[:2], state[2:4]
        env.block.angle = state[6]
        turned = env.block.center_of_gravity.rotated(state[6])
        env.block.position = state[4] - turned[0], state[5] - turned[1]
        env.space.reindex_shapes_for_body(env.agent)
        env.space.reindex_shapes_for_body(env.block)
        return self.state()

    def steps(self, actions):
        """Take control periods; return states and coverage after each."""
        import numpy

        answer = []
        for action in actions:
            coverage = self.env.step(numpy.array(action))[4]["coverage"]
            answer.append([*self.state(), coverage])
        return answer

    def picture(self):
        """Return the pixels of a picture."""
        return self.env.render().tolist()


class EnvPool:
    """All worlds of EnvPool's CartPole-v1, advanced synchronously."""

    def __init__(self, worlds, threads):
        import envpool
        import numpy

        self.worlds, self.taken = int(worlds), 0
        self.env = envpool.make(
            "CartPole-v1", env_type="gymnasium", num_envs=self.worlds, num_threads=int(threads), seed=0
        )
        generator = numpy.random.default_rng(0)
        self.actions = [generator.integers(0, 2, self.worlds) for _ in range(8)]
        self.env.reset()

    def advance(self):
        """Take a step with random actions; return the number of worlds."""
        self.env.step(self.actions[self.taken % 8])
        self.taken += 1
        return self.worlds


def rate(env, seconds):
    """Return the steps per second of all worlds, measured for ``seconds``."""
    steps, began = 0, time.perf_counter()
    while time.perf_counter() - began < seconds:
        for _ in range(4):
            steps += env.advance()
    return steps / (time.perf_counter() - began)


def main():
    """Answer requests until stdin is closed."""
    kind, *arguments = sys.argv[1:]
    env = {"pusht": PushT, "envpool": EnvPool}[kind](*arguments)
    for line in sys.stdin:
        name, *values = json.loads(line)
        print(json.dumps(rate(env, *values) if name == "rate" else getattr(env, name)(*values)), flush=True)


if __name__ == "__main__":
    main()
