"""Speed: environments against CartPole-v1, training, imports. ``python -m studies.benchmarks.speed``

Ratios are measured alternately in one process, because machines drift: each figure is the median of its rounds.

    python -m studies.benchmarks.speed --against ../base   # this checkout and another one, in two processes that take turns
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym

import vibgym

ROUNDS = 7
WORLDS = 1024
TRAIN_CONFIG = Path("configs/agents/rotate.yaml")


def rates(first: Callable[[], float], second: Callable[[], float], rounds: int = ROUNDS) -> tuple[float, float, float]:
    """Median rates of two measurements taken in turn, and the median of the rounds' ratios first / second."""
    pairs = [(first(), second()) for _ in range(rounds)]
    return (
        statistics.median(a for a, _ in pairs),
        statistics.median(b for _, b in pairs),
        statistics.median(a / b for a, b in pairs),
    )


def batch_rate(env: Any, steps: int) -> Callable[[], float]:
    """Steps per second of a vector environment under fixed random actions, resets included."""
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(8)]
    env.reset(seed=0)
    for k in range(20):
        env.step(actions[k % 8])

    def measure() -> float:
        began = time.perf_counter()
        for k in range(steps):
            env.step(actions[k % 8])
        return steps * env.num_envs / (time.perf_counter() - began)

    return measure


def single_rate(env: gym.Env, steps: int) -> Callable[[], float]:
    """Steps per second of a single environment as ``gym.make`` gives it, resets included."""
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(64)]
    env.reset(seed=0)

    def measure() -> float:
        began = time.perf_counter()
        for k in range(steps):
            _, _, terminated, truncated, _ = env.step(actions[k % 64])
            if terminated or truncated:
                env.reset()
        return steps / (time.perf_counter() - began)

    measure()
    return measure


def best_cartpole() -> Any:
    """SyncVectorEnv of CartPole-v1 at the size at which it is fastest here."""
    best, best_rate = None, 0.0
    for size in (16, 32, 64, 128, 256, 1024):
        env = gym.make_vec("CartPole-v1", num_envs=size, vectorization_mode="sync")
        rate = max(batch_rate(env, max(8, 40_000 // size))() for _ in range(2))
        if rate > best_rate:
            best, best_rate = env, rate
    return best


def in_fresh_process(code: str, rounds: int = 5) -> float:
    """Median seconds that ``code`` says it took (it prints them), each in a process of its own."""
    run = [sys.executable, "-c", code]
    return statistics.median(float(subprocess.check_output(run, text=True)) for _ in range(rounds))


TIMED = "import time; began = time.perf_counter(); {}; print(time.perf_counter() - began)"
FIRST_STEP = "env = gymnasium.make('vibgym/Rotate-v0'); env.reset(seed=0); env.step(env.action_space.sample())"


def environments() -> None:
    """The environments' step rates."""
    cartpole = best_cartpole()
    theirs = batch_rate(cartpole, max(8, 200_000 // cartpole.num_envs))
    print(
        f"\nVector environments, {WORLDS} worlds, against CartPole-v1 (SyncVectorEnv, {cartpole.num_envs}: its best size)"
    )
    print(f"  {'environment':34s} {'steps/s':>10s} {'CartPole':>10s} {'ratio':>7s}")
    for task, action in (("Rotate", "element"), ("Rotate", "patch"), ("Transport", "element"), ("Align", "field")):
        env = gym.make_vec(f"vibgym/{task}-v0", num_envs=WORLDS, action=action)
        ours, other, ratio = rates(batch_rate(env, 100), theirs)
        target = "   (target >= 1.5)" if (task, action) == ("Rotate", "element") else ""
        print(f"  {task + '-v0, ' + action:34s} {ours:10.0f} {other:10.0f} {ratio:7.2f}{target}")
    single, other, ratio = rates(
        single_rate(gym.make("vibgym/Rotate-v0"), 4000), single_rate(gym.make("CartPole-v1"), 20_000)
    )
    print("\nSingle environments from gym.make")
    print(
        f"  Rotate-v0, element: {1e6 / single:.1f} us a step, CartPole-v1: {1e6 / other:.1f} us, "
        f"{1 / ratio:.1f} times its cost (target <= 8)"
    )


BATCHES = (("Rotate", "element"), ("Rotate", "patch"), ("Align", "field"))


def serve() -> None:
    """Measure once for every line on stdin: rates of vibgym and of CartPole, a line of JSON each."""
    cartpole = best_cartpole()
    measures = {"CartPole, batch": batch_rate(cartpole, max(8, 100_000 // cartpole.num_envs))}
    for task, action in BATCHES:
        env = gym.make_vec(f"vibgym/{task}-v0", num_envs=WORLDS, action=action)
        measures[f"{task}, {action}, batch of {WORLDS}"] = batch_rate(env, 50)
    measures["CartPole, single"] = single_rate(gym.make("CartPole-v1"), 10_000)
    measures["Rotate, element, single"] = single_rate(gym.make("vibgym/Rotate-v0"), 2000)
    for _ in sys.stdin:
        print(json.dumps({name: measure() for name, measure in measures.items()}), flush=True)


def against(other: Path, rounds: int = ROUNDS) -> None:
    """Rates of this checkout and of another one, measured in turn, and how many times CartPole's each of them is.

    Args:
        other: a checkout of vibgym, of any commit. It is measured by this file, with a cache of its own.
    """
    own = Path(__file__).parents[2]
    code = "import runpy, sys; sys.argv = ['speed', '--serve']; runpy.run_path({!r}, run_name='__main__')"
    servers = []
    for path in (own, other.resolve()):
        environment = {**os.environ, "PYTHONPATH": str(path)}
        if path != own:
            environment["NUMBA_CACHE_DIR"] = os.environ.get("NUMBA_CACHE_DIR_OTHER", str(path / ".numba"))
        command = [sys.executable, "-c", code.format(str(Path(__file__).resolve()))]
        servers.append(
            subprocess.Popen(
                command, env=environment, cwd=path, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE
            )
        )
    rows: list[list[dict[str, float]]] = []
    for _ in range(rounds):
        row = []
        for server in servers:
            assert server.stdin and server.stdout
            server.stdin.write("\n")
            server.stdin.flush()
            row.append(json.loads(server.stdout.readline()))
        rows.append(row)
    for server in servers:
        server.communicate()
    print(f"\nSteps/s, medians of {rounds} rounds; beside {other}, and as multiples of CartPole's in the same process")
    print(f"  {'':34s} {'here':>10s} {'there':>10s} {'ratio':>7s} {'x CartPole':>11s} {'there':>7s}")
    for name in rows[0][0]:
        kind = name.rpartition(", ")[2].split()[0]
        here, there, ratio, ours, theirs = (
            statistics.median(each)
            for each in zip(
                *(
                    (
                        a[name],
                        b[name],
                        a[name] / b[name],
                        a[name] / a[f"CartPole, {kind}"],
                        b[name] / b[f"CartPole, {kind}"],
                    )
                    for a, b in rows
                )
            )
        )
        print(f"  {name:34s} {here:10.0f} {there:10.0f} {ratio:7.2f} {ours:11.3f} {theirs:7.3f}")


def start() -> None:
    """Import time and the first step with a warm cache."""
    base = in_fresh_process(TIMED.format("import numba, gymnasium"))
    ours = in_fresh_process(TIMED.format("import vibgym"))
    both = "import gymnasium, vibgym; " + TIMED.format(FIRST_STEP)
    in_fresh_process(both, 1)
    print("\nStart")
    print(
        f"  import vibgym: {ours:.2f} s, numba and gymnasium alone: {base:.2f} s, {ours / base:.2f} times (target <= 1.5)"
    )
    print(f"  first step with a warm cache: {in_fresh_process(both, 3):.2f} s (target <= 1)")


def training() -> None:
    """PPO from the shipped configuration, everything included from the first environment to the saved policy."""
    import yaml

    from agents.training.train import train

    settings = yaml.safe_load(TRAIN_CONFIG.read_text())
    settings["steps"] = 1_000_000
    with tempfile.TemporaryDirectory() as directory:
        config = Path(directory) / "speed.yaml"
        config.write_text(yaml.safe_dump(settings))
        began = time.perf_counter()
        train(config, Path(directory) / "run", quiet=True)
        rate = settings["steps"] / (time.perf_counter() - began)
    print(f"\nPPO training, {settings['task']} with patch actions: {rate:.0f} steps/s (target >= 35000)")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--no-training", action="store_true", help="leave the training rate out (needs torch)")
    parser.add_argument(
        "--against", type=Path, metavar="CHECKOUT", help="compare with another checkout, and nothing else"
    )
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.serve:
        serve()
        return
    print(f"vibgym {vibgym.__version__}, Python {platform.python_version()}, {os.cpu_count()} processors")
    if arguments.against is not None:
        against(arguments.against)
        return
    environments()
    start()
    if not arguments.no_training:
        training()


if __name__ == "__main__":
    main()
