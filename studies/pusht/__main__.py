"""PushT in vibgym's contact kernels against gym-pusht: ``python -m studies.pusht [STUDY ...]``.

- ``throughput``: control steps per second, measured in alternation with gym-pusht, each in one process.
- ``difference``: motion of the T in both simulators after the same pushes from the same states.
- ``play``: the model-predictive policy in both simulators, from the same seeds.
- ``picture``: both simulators after the same actions, ``docs/pusht.png``.

gym-pusht needs a separate environment (``make peers``).
"""

from __future__ import annotations

import statistics
import time
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agents.evaluation.statistics import bootstrap, exact
from studies import common
from studies.benchmarks import peers
from studies.common import LEVEL, RESAMPLES
from studies.kept import show
from studies.pusht.kernel import HIGH, LOW, PUSHER, T
from studies.pusht.policy import Planner
from studies.pusht.scene import CONTACTS, PERIODS, SIZE, SUCCESS, PushT, PushTEnv, origin_of, start_of
from studies.pusht.ways import CLEARANCE, rotation, ways
from studies.worker import Worker
from vibgym import checks

FIRST_SEED = 100_000
ROUNDS, BATCH, PUSHES, REPLAYS, EPISODES = 9, 1024, 1000, 30, 100

PAIRS = (("projected", "projected"), ("projected", "delayed"), ("gym-pusht", "delayed"), ("gym-pusht", "projected"))
"""Simulators in which the policy plays, and contacts of its model."""

COLUMNS = 4
"""Instants in the picture."""


class Played(NamedTuple):
    """An episode."""

    actions: np.ndarray  # (periods, 2)
    coverage: np.ndarray  # (periods,)
    block: np.ndarray  # (3,) pose of the T's centre of mass at the end
    planning: float  # s, of the policy in a period


def rate(contacts: str, worlds: int) -> peers.Rate:
    """Return a function that measures control steps per second under random actions, resets included."""
    env, random = PushTEnv(contacts), np.random.default_rng(0)
    batch, actions = env.batch if worlds == 1 else PushT(worlds, contacts), random.uniform(0.0, SIZE, (64, worlds, 2))
    taken = 0

    def advance() -> int:
        nonlocal taken
        if taken % PERIODS == 0:
            env.reset(seed=taken) if worlds == 1 else batch.reset(range(taken, taken + worlds))
        env.step(actions[taken % 64, 0]) if worlds == 1 else batch.step(actions[taken % 64])
        taken += 1
        return worlds

    return peers.rate(advance)


def throughput(python: Path, keep: bool, rounds: int = ROUNDS) -> None:
    """Measure control steps per second."""
    other = peers.Peer(python, "pusht")
    cases = [(contacts, worlds) for contacts in CONTACTS for worlds in (1, BATCH)]
    rates_of = peers.in_pairs([(rate(*case), other) for case in cases], rounds)
    other.close()
    lines = []
    for (contacts, worlds), rates in zip(cases, rates_of, strict=True):
        mine, theirs = np.median(rates, axis=0)
        lines.append(
            [contacts, str(worlds), f"{mine:.0f}", f"{theirs:.0f}", peers.spread(rates[:, 0] / rates[:, 1], 1)]
        )
    show("pusht-throughput", ("contacts", "worlds", "steps/s", "gym-pusht, steps/s", "ratio"), lines, keep)


def pushes(count: int, speed: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return states in which a pusher is 1 px from the T, at random places.

    Args:
        count: number of states.
        speed: px/s, of the pusher.

    Returns:
        Pusher (count, 4), pose of the T's centre of mass (count, 3), and direction of the push (count, 2), within 45
        degrees of the inward normal.
    """
    around, pusher, block, along = ways(), np.zeros((count, 4)), np.zeros((count, 3)), np.zeros((count, 2))
    for k in range(count):
        random = np.random.default_rng([FIRST_SEED, k])
        block[k] = start_of(k)[1]
        turn, at = rotation(block[k, 2]), random.integers(len(around.point))
        inward = around.inward[at] @ turn
        along[k] = inward @ rotation(random.uniform(-0.25, 0.25) * np.pi)
        pusher[k, :2] = block[k, :2] + around.point[at] @ turn + (CLEARANCE - 1.0) * inward
        pusher[k, 2:] = speed * along[k]
    return pusher, block, along


def gym_pusht(python: Path = peers.PYTHON) -> Worker:
    """Return a process of gym-pusht, see ``studies/benchmarks/peers_worker.py``."""
    return Worker(python, peers.WORKER, "pusht")


def steps(peer: Worker, actions: np.ndarray) -> np.ndarray:
    """Take control periods with actions (periods, 2) in gym-pusht; return states and coverage after each, (periods, 8)."""
    return np.array(peer.ask("steps", actions.tolist()))


def in_gym_pusht(peer: Worker, pusher: np.ndarray, block: np.ndarray, actions: np.ndarray) -> np.ndarray:
    """Return poses (count, 3) of the T in gym-pusht after actions (count, periods, 2) from states as of :func:`pushes`."""
    reached = np.empty_like(block)
    for k, action in enumerate(actions):
        peer.ask("set", [*pusher[k], *block[k]])
        reached[k] = steps(peer, action)[-1, 4:7]
    return reached


def cells(start: np.ndarray, theirs: np.ndarray, ours: np.ndarray, gap: np.ndarray) -> list[str]:
    """Return cells from poses and gaps: motion in gym-pusht, differences of the ends, overlap; median, 90 %, largest."""
    far, way = ours - theirs, np.hypot(*(theirs - start)[:, :2].T)
    values = way, np.hypot(*far[:, :2].T), np.degrees(np.abs(far[:, 2])), np.maximum(-gap, 0.0)
    return [", ".join(f"{number:.3f}" for number in np.quantile(value, (0.5, 0.9, 1.0))) for value in values]


def difference(python: Path, keep: bool, count: int = PUSHES, replays: int = REPLAYS) -> None:
    """Measure the difference of the T's motion after the same pushes."""
    lines = []
    with gym_pusht(python) as peer:
        for name, number, speed, pace, periods in (
            ("a period, 100 px/s", count, 100.0, 0.0, 1),
            ("a period, 400 px/s", count, 400.0, 0.0, 1),
            ("an episode, 200 px at 100 px/s", max(count // 10, 1), 0.0, 10.0, PERIODS),
        ):
            pusher, block, along = pushes(number, speed)
            # A target 0.2 s ahead (damping over stiffness) nearly keeps the velocity.
            ahead = 0.2 * speed + pace * np.minimum(np.arange(1, periods + 1), 20)
            actions = np.clip(pusher[:, None, :2] + ahead[:, None] * along[:, None], 0.0, SIZE)
            theirs = in_gym_pusht(peer, pusher, block, actions)
            for contacts in CONTACTS:
                batch = PushT(number, contacts)
                batch.set_state(pusher, block)
                batch.rollout(actions)
                lines.append([name, str(number), contacts, *cells(block, theirs, batch.block, batch.gaps())])
        policy, seeds = Planner("delayed"), range(FIRST_SEED, FIRST_SEED + replays)
        played = [play(seed, policy, "delayed", peer) for seed in seeds]
    theirs, start = np.array([episode.block for episode in played]), np.array([start_of(seed)[1] for seed in seeds])
    for contacts in CONTACTS:
        ends, gaps = np.empty_like(theirs), np.empty(replays)
        for k, seed in enumerate(seeds):
            batch = PushT(1, contacts)
            batch.reset([seed])
            batch.rollout(played[k].actions[None])
            ends[k], gaps[k] = batch.block[0], batch.gaps()[0]
        lines.append(["an episode of the policy", str(replays), contacts, *cells(start, theirs, ends, gaps)])
    heads = ("push", "pushes", "contacts", "motion, px", "difference, px", "difference, deg", "overlap at the end, px")
    show("pusht-difference", heads, lines, keep)


def play(seed: int, policy: Planner, contacts: str, peer: Worker | None = None, periods: int = PERIODS) -> Played:
    """Play an episode in gym-pusht, if a peer is given, else with ``contacts``."""
    batch, actions, coverage, planning = PushT(1, contacts), [], [], 0.0
    observation = batch.reset([seed])[0]
    state = None if peer is None else np.array(peer.ask("reset", seed))
    policy.reset()
    while len(actions) < periods and not (coverage and coverage[-1] > SUCCESS):
        if state is not None:
            observation = np.concatenate([state[:2], origin_of(state[4:7])])
        began = time.perf_counter()
        actions.append(policy.predict(observation))
        planning += time.perf_counter() - began
        if peer is None:
            step = batch.step(actions[-1][None])
            observation, share = step.observation[0], float(step.coverage[0])
        else:
            state = steps(peer, actions[-1][None])[0]
            share = float(state[7])
        coverage.append(share)
    block = batch.block[0] if state is None else state[4:7]
    return Played(np.array(actions), np.array(coverage), block, planning / len(actions))


def episodes(python: Path, keep: bool, count: int = EPISODES) -> None:
    """Play the policy in both simulators."""
    lines = []
    with gym_pusht(python) as peer:
        for simulator, model in PAIRS:
            policy, foreign = Planner(model), simulator == "gym-pusht"
            contacts = model if foreign else simulator
            played = [
                play(seed, policy, contacts, peer if foreign else None)
                for seed in range(FIRST_SEED, FIRST_SEED + count)
            ]
            best = np.array([episode.coverage.max() for episode in played])
            success, reward = best > SUCCESS, np.minimum(best / SUCCESS, 1.0).mean()
            rate, spread = exact(int(success.sum()), count, LEVEL), bootstrap(best, LEVEL, RESAMPLES)
            periods = np.array([len(episode.actions) for episode in played])[success]
            plan = 1e3 * statistics.median(episode.planning for episode in played)
            lines.append([
                simulator, model, f"{100 * success.mean():.1f} % ({100 * rate.low:.1f} to {100 * rate.high:.1f})",
                f"{best.mean():.3f} ({spread.low:.3f} to {spread.high:.3f})", f"{reward:.3f}",
                f"{0.1 * np.median(periods):.1f} s", f"{plan:.0f} ms",
            ])  # fmt: skip
            print(*lines[-1], flush=True)
    heads = (
        "simulator",
        "model",
        "success",
        "mean best coverage",
        "mean best reward",
        "median time",
        "planning a step",
    )
    show("pusht-play", heads, lines, keep)


def picture(python: Path, path: Path) -> None:
    """Draw gym-pusht, and both laws of contact after the same actions: those of an episode in gym-pusht."""
    from matplotlib.figure import Figure

    batches = {contacts: PushT(1, contacts) for contacts in reversed(CONTACTS)}
    figure = Figure(figsize=(9.6, 7.4), layout="constrained")
    axes = figure.subplots(1 + len(batches), COLUMNS)
    with gym_pusht(python) as peer:
        actions = play(FIRST_SEED, Planner("delayed"), "delayed", peer).actions
        peer.ask("reset", FIRST_SEED)
        for batch in batches.values():
            batch.reset([FIRST_SEED])
        taken = 0
        for column, stop in enumerate(np.linspace(0, len(actions), COLUMNS).round().astype(int)):
            if stop > taken:
                steps(peer, actions[taken:stop])
            image = np.array(peer.ask("picture"), dtype=np.uint8)
            axes[0, column].imshow(image, extent=(0.0, SIZE, SIZE, 0.0))
            axes[0, column].set_title(f"{0.1 * stop:.1f} s", fontsize=9)
            for row, batch in enumerate(batches.values(), 1):
                batch.rollout(actions[None, taken:stop])
                draw(axes[row, column], batch)
                axes[row, column].set_xlabel(f"coverage {batch.coverage()[0]:.3f}", fontsize=8)
            taken = stop
    for row, name in zip(axes, ("gym-pusht", *batches), strict=True):
        row[0].set_ylabel(name, fontsize=9)
        for axes in row:
            axes.set(xlim=(0.0, SIZE), ylim=(SIZE, 0.0), aspect="equal", xticks=(), yticks=())
    figure.savefig(path, dpi=90)
    print(f"picture: {path}")


def draw(axes: Any, batch: PushT) -> None:
    """Draw the first world of a batch with the colours of gym-pusht."""
    from matplotlib.patches import Circle, Rectangle

    hulls, (x, y) = batch.hulls, batch.pusher[0, :2].tolist()
    for pose, colour in ((batch.goal, "lightgreen"), (batch.block[0], "lightslategray")):
        for piece in range(hulls.owner[T + 1]):
            corners = hulls.corner[hulls.first[piece] : hulls.first[piece + 1], :2]
            axes.fill(*(pose[:2] + corners @ rotation(pose[2])).T, color=colour, linewidth=0.0)
    axes.add_patch(Circle((x, y), hulls.radius[PUSHER], color="royalblue"))
    axes.add_patch(Rectangle((LOW, LOW), HIGH - LOW, HIGH - LOW, fill=False, edgecolor="lightgray", linewidth=1.0))


STUDIES = ("throughput", "difference", "play", "picture")


def main() -> None:
    """Run the studies and print their tables; with ``--keep`` write those of the documentation."""
    parser = common.parser(__doc__)
    parser.add_argument("studies", nargs="*", metavar="STUDY", help=f"of {', '.join(STUDIES)}; default: all")
    parser.add_argument("--episodes", type=int, default=EPISODES, help="of each line of play")
    parser.add_argument(
        "--python", type=Path, default=peers.PYTHON, help=f"interpreter with gym-pusht; default: {peers.PYTHON}"
    )
    parser.add_argument("--picture", type=Path, default=Path("docs/pusht.png"), metavar="PNG")
    asked = parser.parse_args()
    run = {
        "throughput": partial(throughput, asked.python, asked.keep),
        "difference": partial(difference, asked.python, asked.keep),
        "play": partial(episodes, asked.python, asked.keep, checks.count("--episodes", asked.episodes)),
        "picture": partial(picture, asked.python, asked.picture),
    }
    if not asked.python.exists():
        parser.error(f"--python {asked.python} is missing: gym-pusht requires make peers")
    for name in [checks.choice("STUDY", name, STUDIES) for name in asked.studies] or STUDIES:
        run[name]()


if __name__ == "__main__":
    main()
