"""The parts that a trained policy serves: measured by success, stored in its file, checked when the policy is made.

``python -m agents range vibgym/policies/trained/shipped/*.json``

Friction, size and mass of all parts are first varied alone, outwards from the parts of the policy's tasks, until episodes fail.
Then scenes are drawn from inside all ranges at once, and from the frequencies that the file states. While these fail more
often than they may, the range whose end has most of the failures is shortened by a tenth of the scenes (patient rule
induction, Friedman and Fisher, "Bump hunting in high-dimensional data", Statistics and Computing 1999). Scenes that succeed
are followed by more scenes, which must succeed as well: the first of several rounds to succeed is likely a lucky one. The same
is done with discs in place of the parts, which need not turn; if some parts of the task are discs, all parts have the same
ranges. Scenes have the hardware of training, or both for an agent that serves any, the planar model and certified contacts.
``--check COUNT`` plays other random scenes inside the stored ranges.
"""

from __future__ import annotations

import argparse
import copy
import json
import math
import tempfile
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agents.command_line import Command
from agents.learning_curve import RATE
from vibgym import Part, checks
from vibgym.envs.drawn import DRAWN
from vibgym.envs.vector import batch_of
from vibgym.policies.applicable import usual_parts
from vibgym.policies.rollout import rollout
from vibgym.policies.trained.storage import load_set, save_set
from vibgym.policies.trained.trained import ANY, DISCS, FREQUENCY, KIND, PARTS, RANGE, RANGES, RESIDUAL, VERSION
from vibgym.registration import ENVIRONMENTS
from vibgym.scene.library import SPLITS, shapes
from vibgym.scene.parts import part_from
from vibgym.seeds import RANGES as SEEDS
from vibgym.tasks import TASKS

SUCCESS = 0.98
"""Share of the episodes inside the ranges that shall succeed, or that of the parts of training if it is smaller: 97 %, and what
a few hundred episodes leave to chance."""

RATE_SHARE = 0.9
"""Of the good parts per minute with the parts of training, where parts come and go: fewer are a failure."""

FACTORS = (1.15, 1.3, 1.5, 1.75, 2.0, 2.5, 3.0, 3.5, 4.0)
"""Tried outwards, and their inverses."""

EPISODES, SCENES, WORLDS = 60, 120, 3
"""Episodes of the parts of training and of each factor; random scenes, and episodes of each."""

FLOWING = 6, 40, 1
"""The same where parts come and go: such an episode has hundreds of parts."""

CONFIRMING = 5
"""Times as many random scenes, with one episode each, confirm ranges."""

SLOWEST = 3.0
"""Of several parts: longest time to the goal, over that of the parts of training (99 % of the episodes); a jam would last to
the limit of the task."""

PEEL, KEPT = 0.1, 0.4
"""Share of the scenes by which a range is shortened; share of those drawn that is left when new ones are drawn."""

PROTOTYPE: dict[str, Any] = {"actuators": "prototype", "sensor": {"kind": "pose", "estimator": "model"}}
"""Played beside ideal hardware for an agent that serves any."""

FIRST_SEED = 220_000
"""In the range "evaluation" of :mod:`vibgym.seeds`."""

CHECKING = 5_000
"""Added to it for the first episode of ``--check``, after those of the measurement."""

Ranges = dict[str, list[float]]
"""Lowest and highest value by property."""


def varied(part: Any, friction: float, radius: float, mass: float) -> dict[str, Any]:
    """Return the settings of a part of an environment with factors on its properties; drawn shapes keep their masses."""
    drawn = isinstance(part, Mapping) and part.get("shape") == DRAWN
    given = {"friction": nominal(part).friction, **part} if drawn else part_from(part).to_dict()
    lengths = dict.fromkeys(("radius", "height", "centre_height", "vertices", "holes", "size"), radius)
    for name, factor in {**lengths, "friction": friction, "static_friction": friction, "mass": mass}.items():
        if name == "holes" and name in given:
            given[name] = [(factor * np.asarray(ring)).tolist() for ring in given[name]]
        elif name in given:
            given[name] = (factor * np.asarray(given[name])).tolist()
    return given


class Drawn(NamedTuple):
    """A random scene: lowest and highest value of its parts by property, and its episodes."""

    spans: dict[str, tuple[float, float]]
    outcome: np.ndarray


class Range:
    """Measurement of one policy file.

    Args:
        path: of the file.
        folder: for a copy of it without ranges.

    Attributes:
        task: of training.
        own: {property: (lowest, highest)} of the parts of all its tasks, of properties that are varied.
        fixed: the same of those that are not.
        flows: whether parts come and go.
        least: smallest measure (success rate, or good parts a minute) of a policy that serves.

    Raises:
        ValueError: not a policy file, or no environment with a step limit.
    """

    def __init__(self, path: Path, folder: Path) -> None:
        tensors, record = load_set(path, KIND, VERSION)
        content = {key: value for key, value in record.items() if key not in ("tensors", "sha256", RANGE)}
        save_set(folder / path.name, KIND, tensors, content, VERSION)
        self.policy = {"kind": RESIDUAL if record.get(RESIDUAL) else "trained", "path": str(folder / path.name)}
        tasks = [checks.choice(f"{path}: tasks", task, tuple(ENVIRONMENTS)) for task in record["tasks"]]
        self.task, trained_in = tasks[0], record["training"]["settings"]["environment"]
        self.scene = {name: trained_in[name] for name in ("split",) if name in trained_in}
        of_training = {name: trained_in[name] for name in PROTOTYPE if name in trained_in}
        self.hardware = [{}, PROTOTYPE] if record.get("hardware") == ANY else [of_training]
        stated = record["surface"]["frequency"]
        self.frequency = stated if isinstance(stated, list) else [stated * (1.0 + sign * FREQUENCY) for sign in (-1, 1)]
        self.parts = usual_parts(f"vibgym/{self.task}-v0")
        own = self._ends([part for task in tasks for part in kinds_in(task)])
        fixed = RANGES[1:] if "split" in self.scene else ()  # drawn shapes have the sizes of their library
        self.own = {name: span for name, span in own.items() if name not in fixed}
        self.fixed = {name: list(span) for name, span in own.items() if name in fixed}
        self.flows = TASKS[ENVIRONMENTS[self.task][1]["task"]].continuous_feed  # no success, but good parts a minute
        self.episodes, self.count, self.worlds = FLOWING if self.flows else (EPISODES, SCENES, WORLDS)
        usual, steps = self.play({}, self.episodes)
        self.least = RATE_SHARE * usual.mean() if self.flows else min(SUCCESS, usual.mean())
        if not self.flows and len(self.parts) > 1 and usual.any():
            self.scene["max_episode_steps"] = math.ceil(SLOWEST * np.quantile(steps[usual > 0.0], 0.99))

    def _ends(self, parts: Sequence[Part]) -> dict[str, tuple[float, float]]:
        """Return the smallest and largest properties of parts; mass matters in contacts only."""
        names = RANGES[: 2 if len(self.parts) == 1 else 3]
        return {name: ends([getattr(part, name) for part in parts]) for name in names}

    @property
    def kinds(self) -> dict[str, Any]:
        """The different parts, by :func:`name_of`."""
        return {name_of(part): part for part in self.parts}

    def with_discs(self) -> Range:
        """Return the same measurement with discs of the same areas as parts."""
        other = copy.copy(self)
        other.parts = [as_disc(part) for part in self.parts]
        other.own = other._ends([part_from(part) for part in other.parts])
        return other

    def measure(
        self, factors: Mapping[str, Mapping[str, float]], episodes: int, first: int = 0, **surface: float
    ) -> np.ndarray:
        """Return success, or good parts a minute, of episodes, see :meth:`play`."""
        return self.play(factors, episodes, first, **surface)[0]

    def play(
        self, factors: Mapping[str, Mapping[str, float]], episodes: int, first: int = 0, **surface: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Play episodes with factors on the properties of each kind of part; {}: none. The hardware changes from seed to seed.

        Returns:
            (episodes,) success, or good parts a minute; (episodes,) steps.
        """
        parts = [varied(part, **factors[name_of(part)]) for part in self.parts] if factors else self.parts
        scene: dict[str, Any] = {**self.scene, "parts": parts} | ({"surface": surface} if surface else {})
        first, measured, steps = FIRST_SEED + first, np.zeros(episodes), np.zeros(episodes, dtype=np.int64)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about densities
            for k, hardware in enumerate(self.hardware):
                rows = slice((k - first) % len(self.hardware), None, len(self.hardware))
                seeds = range(first, first + episodes)[rows]
                if len(seeds):
                    result = rollout(self.policy, self.task, seeds=seeds, **scene, **hardware)
                    rate = result.reported(RATE)
                    measured[rows], steps[rows] = np.where(np.isfinite(rate), rate, result.success), result.steps
        return measured, steps

    def serves(self, factors: Mapping[str, Mapping[str, float]]) -> bool:
        """Return whether episodes with these factors do as well as they shall; not if the task refuses the parts."""
        try:
            return bool(self.measure(factors, self.episodes).mean() >= self.least)
        except checks.Refused:
            return False

    def alone(self) -> Ranges:
        """Return the range of each property, varied alone."""
        ranges = {}
        for name, own in self.own.items():
            reached = list(own)
            for end, power in enumerate((-1.0, 1.0)):
                for factor in FACTORS:
                    same = dict.fromkeys(RANGES, 1.0) | {name: factor**power}
                    if not self.serves(dict.fromkeys(self.kinds, same)):
                        break
                    reached[end] = own[end] * factor**power
            ranges[name] = reached
        return ranges

    def scenes(
        self, ranges: Ranges, generator: np.random.Generator, count: int, worlds: int, first: int
    ) -> Iterator[Drawn]:
        """Play random scenes with parts and frequencies in the ranges; yield those that the task accepts.

        Args:
            ranges: of all parts.
            generator: of the scenes.
            count: number of scenes.
            worlds: episodes of each.
            first: added to :data:`FIRST_SEED` for the first episode.
        """
        for k in range(count):
            factors, values = {}, []
            for name_of_kind, kind in self.kinds.items():
                drawn = {name: float(np.exp(generator.uniform(*np.log(span)))) for name, span in ranges.items()}
                usual = nominal(kind)
                own = {name: value / getattr(usual, name) for name, value in drawn.items()}
                factors[name_of_kind] = dict.fromkeys(RANGES, 1.0) | own
                values.append(drawn)
            frequency = float(generator.uniform(*self.frequency))
            try:
                outcome = self.measure(factors, worlds, first + worlds * k, frequency=frequency)
            except checks.Refused:
                continue
            yield Drawn({name: ends([drawn[name] for drawn in values]) for name in ranges}, outcome)

    def together(self) -> Ranges:
        """Return ranges inside which random scenes do as well as they shall."""
        ranges, generator = self.alone(), np.random.default_rng(0)
        while True:
            scenes = list(self.scenes(ranges, generator, self.count, self.worlds, first=self.episodes))
            if self.suffice(scenes):
                later = self.episodes + self.worlds * self.count
                scenes = list(self.scenes(ranges, generator, CONFIRMING * self.count, 1, first=later))
                if self.suffice(scenes):
                    return ranges
            shorter = self.peeled(ranges, scenes)
            if shorter == ranges:
                return {name: list(own) for name, own in self.own.items()}
            ranges = shorter

    def suffice(self, scenes: Sequence[Drawn]) -> bool:
        """Return whether random scenes do as well as they shall."""
        return bool(scenes) and bool(outcomes(scenes).mean() >= self.least)

    def peeled(self, ranges: Ranges, scenes: Sequence[Drawn]) -> Ranges:
        """Return shorter ranges, in which fewer of the scenes fail; they contain the parts of the tasks."""
        ranges = {name: list(span) for name, span in ranges.items()}
        kept = list(scenes)
        while len(kept) > KEPT * len(scenes) and np.mean([scene.outcome.mean() for scene in kept]) < self.least:
            cuts = []
            for name, own in self.own.items():
                low, high = np.quantile([scene.spans[name] for scene in kept], (PEEL, 1.0 - PEEL), axis=0)
                for end, limit, sign in ((0, min(float(low[0]), own[0]), 1.0), (1, max(float(high[1]), own[1]), -1.0)):
                    inside = [scene for scene in kept if sign * (scene.spans[name][end] - limit) >= 0.0]
                    if 0 < len(inside) < len(kept):
                        cuts.append((np.mean([scene.outcome.mean() for scene in inside]), name, end, limit, inside))
            if not cuts:
                break
            _, name, end, limit, kept = max(cuts, key=lambda cut: cut[:3])
            ranges[name][end] = limit
        return ranges


def outcomes(scenes: Sequence[Drawn]) -> np.ndarray:
    """Return the outcomes of all episodes of random scenes."""
    return np.concatenate([scene.outcome for scene in scenes])


def ends(values: Sequence[float]) -> tuple[float, float]:
    """Return the smallest and the largest value."""
    return min(values), max(values)


def kinds_in(task: str) -> Sequence[Part]:
    """Return the kinds of parts of an environment, with drawn shapes of all splits."""
    splits = [{"split": split} for split in SPLITS] if "split" in ENVIRONMENTS[task][1] else [{}]
    every: list[Part] = []
    for split in splits:
        env: Any = batch_of(task, num_envs=1, **split)
        every += env.unwrapped.core.kinds.every
        env.close()
    return every


def nominal(part: Any) -> Part:
    """Return a part of an environment; of drawn shapes one of the library with the friction of the part."""
    if isinstance(part, Mapping) and part.get("shape") == DRAWN:
        shape = shapes("train")[0]
        return replace(shape, friction=part.get("friction", shape.friction))
    return part_from(part)


def name_of(part: Any) -> str:
    """Return a name of the settings of a part."""
    return json.dumps(part, sort_keys=True)


def as_disc(part: Any) -> dict[str, Any]:
    """Return the settings of a disc with the properties and the area of a part."""
    own = part_from(part)
    given = {name: value for name, value in own.to_dict().items() if name not in ("vertices", "holes")}
    return {**given, "shape": "disc", "radius": math.sqrt(own.area / math.pi)}


def check(path: Path, count: int) -> None:
    """Play random scenes inside the stored ranges of a policy file, and print how they did.

    Raises:
        ValueError: the file has no ranges, or no policy file.
    """
    stored = load_set(path, KIND, VERSION)[1].get(RANGE)
    if not stored:
        raise checks.conflict(f"{path}: there are no ranges to check; python -m agents range {path} measures them")
    with tempfile.TemporaryDirectory() as folder:
        agent = Range(path, Path(folder))
        unit = "good parts a minute" if agent.flows else "of the episodes succeed"
        for kind, ranges in stored.items():
            if ranges is None:
                print(f"{path}: {kind}: not served")
                continue
            of_kind = agent.with_discs() if kind == DISCS else agent
            scenes = list(of_kind.scenes(ranges, np.random.default_rng(CHECKING), count, 1, CHECKING))
            mean = f"{outcomes(scenes).mean():.4g} {unit}, {agent.least:.4g} shall; " if scenes else ""
            print(f"{path}: {kind}: {mean}{len(scenes)} scenes, {count - len(scenes)} refused by the task")


def measured(path: Path) -> dict[str, Ranges | None]:
    """Return the ranges of a policy file, see :func:`vibgym.policies.trained.trained.check_range`."""
    with tempfile.TemporaryDirectory() as folder:
        agent = Range(path, Path(folder))
        found: dict[str, Ranges | None] = {PARTS: agent.together() | agent.fixed}
        if not agent.fixed and all(nominal(part).symmetry for part in agent.parts):
            discs = agent.with_discs()
            found[DISCS] = discs.together() if discs.serves({}) else None
    return {
        kind: None if ranges is None else {name: [float(f"{end:.3g}") for end in span] for name, span in ranges.items()}
        for kind, ranges in found.items()
    }


def store(path: Path) -> None:
    """Measure the ranges of a policy file, store them in it, and print them."""
    ranges = measured(path)
    tensors, record = load_set(path, KIND, VERSION)
    content = {key: value for key, value in record.items() if key not in ("tensors", "sha256")}
    save_set(path, KIND, tensors, {**content, RANGE: ranges}, VERSION)
    for kind, spans in ranges.items():
        texts = [f"{name} {low:g} to {high:g}" for name, (low, high) in (spans or {}).items()]
        print(f"{path}: {kind}: {', '.join(texts) or 'none'}")


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``range``."""
    parser.add_argument("files", type=Path, nargs="+", metavar="FILE", help="policy files, which get the ranges")
    parser.add_argument(
        "--check", type=int, metavar="COUNT", help="play random scenes inside the stored ranges instead"
    )


def command(args: argparse.Namespace) -> None:
    """Measure the ranges of policy files and store them, or check those that they have."""
    if args.check is not None:
        checks.count("--check", args.check, most=SEEDS["evaluation"].stop - FIRST_SEED - CHECKING)
    for path in args.files:
        if args.check is None:
            store(path)
        else:
            check(path, args.check)


COMMANDS = {"range": Command(arguments, command)}
