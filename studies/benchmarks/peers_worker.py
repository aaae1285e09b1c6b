"""Measure environments of other packages: reads durations (s) from stdin, a line each, and prints steps per second.

``python peers_worker.py pusht``, or ``envpool WORLDS THREADS``. Started by :mod:`studies.benchmarks.peers` in an interpreter
without vibgym.
"""

import sys
import time


def pusht():
    """Return a function that advances PushT-v0 with state observations."""
    import gym_pusht  # noqa: F401 - registers it
    import gymnasium

    env = gymnasium.make("gym_pusht/PushT-v0", obs_type="state")
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(64)]
    env.reset(seed=0)
    taken = 0

    def step():
        nonlocal taken
        _, _, terminated, truncated, _ = env.step(actions[taken % 64])
        taken += 1
        if terminated or truncated:
            env.reset()
        return 1

    return step


def envpool(worlds, threads):
    """Return a function that advances all worlds of EnvPool's CartPole-v1, synchronously."""
    import envpool
    import numpy

    worlds = int(worlds)
    env = envpool.make("CartPole-v1", env_type="gymnasium", num_envs=worlds, num_threads=int(threads), seed=0)
    generator = numpy.random.default_rng(0)
    actions = [generator.integers(0, 2, worlds) for _ in range(8)]
    env.reset()
    taken = 0

    def step():
        nonlocal taken
        env.step(actions[taken % 8])
        taken += 1
        return worlds

    return step


def main():
    """Answer requests until stdin is closed."""
    kind, *arguments = sys.argv[1:]
    step = {"pusht": pusht, "envpool": envpool}[kind](*arguments)
    for line in sys.stdin:
        steps, seconds, began = 0, float(line), time.perf_counter()
        while time.perf_counter() - began < seconds:
            for _ in range(4):
                steps += step()
        print(steps / (time.perf_counter() - began), flush=True)


if __name__ == "__main__":
    main()
