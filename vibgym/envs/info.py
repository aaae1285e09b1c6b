"""What ``info`` says: a kernel collects it world by world in a few arrays of a step's own, whose rows are handed out.

So nothing has to be copied key by key, and what was handed out is never written again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np

from vibgym.kernels.jit import borrowing
from vibgym.kernels.reference import Layout, Pinned, bound
from vibgym.tasks.episode import (
    DOWN,
    ENDED,
    HEADING_ERROR,
    IN_TOUCH,
    PARTS_DONE,
    POSITION_ERROR,
    REWARD,
    SMALLEST_GAP,
    SUCCEEDED,
    Episode,
)


class Live(NamedTuple):
    """Arrays of the state and of the scoring that ``info`` tells of, pinned in memory."""

    number: np.ndarray  # of the episodes, and so on: see vibgym.tasks.episode.Episode
    count: np.ndarray
    flag: np.ndarray
    diverged: np.ndarray
    done: np.ndarray
    part_fallen: np.ndarray
    present: np.ndarray
    part_reward: np.ndarray
    terms: np.ndarray  # (worlds, terms) of the reward, whoever makes them
    part_terms: np.ndarray  # (worlds, parts, terms)


LIVE: Layout[Live] = Layout("LIVE", __name__)
live_at = LIVE.at

NUMBERS = (REWARD, POSITION_ERROR, HEADING_ERROR, SMALLEST_GAP)
COUNTS = (PARTS_DONE, IN_TOUCH)
FLAGS = (ENDED, DOWN, SUCCEEDED)
TERMS, DIVERGED = len(NUMBERS), len(FLAGS)

PART_FLAGS = ("done", "fallen", "present")


class Told(NamedTuple):
    """What one step has come to, a row for each thing that is told."""

    number: np.ndarray  # (NUMBERS and reward terms, worlds) float64
    count: np.ndarray  # (COUNTS, worlds) int64
    flag: np.ndarray  # (FLAGS and diverged, worlds) bool
    part_number: np.ndarray  # (reward and reward terms, worlds, parts) float64
    part_flag: np.ndarray  # (PART_FLAGS, worlds, parts) bool


@borrowing
def tell_worlds(live, worlds, number, count, flag, part_number, part_flag):
    """Write what there is to tell of some worlds.

    Args:
        live: address of a pinned :class:`Live`.
        worlds: (n,) index.
        number, count, flag, part_number, part_flag: see :class:`Told`.
    """
    all_of = live_at(live)
    terms, part_terms = all_of.terms, all_of.part_terms
    # Row by row: all rows at a time would be as many places in memory, often a power of two apart.
    for row in range(TERMS):
        for k in range(worlds.shape[0]):
            number[row, worlds[k]] = all_of.number[worlds[k], NUMBERS[row]]
    for term in range(terms.shape[1]):
        for k in range(worlds.shape[0]):
            number[TERMS + term, worlds[k]] = terms[worlds[k], term]
    for k in range(worlds.shape[0]):
        w = worlds[k]
        count[0, w], count[1, w] = all_of.count[w, PARTS_DONE], all_of.count[w, IN_TOUCH]
        flag[0, w], flag[1, w] = all_of.flag[w, ENDED], all_of.flag[w, DOWN]
        flag[2, w], flag[DIVERGED, w] = all_of.flag[w, SUCCEEDED], all_of.diverged[w]
        for part in range(part_terms.shape[1]):
            part_flag[0, w, part], part_flag[1, w, part] = all_of.done[w, part], all_of.part_fallen[w, part]
            part_flag[2, w, part], part_number[0, w, part] = all_of.present[w, part], all_of.part_reward[w, part]
    for term in range(terms.shape[1]):
        for k in range(worlds.shape[0]):
            for part in range(part_terms.shape[1]):
                part_number[1 + term, worlds[k], part] = part_terms[worlds[k], part, term]


class Information:
    """Makes ``info``, of single environments and of batches.

    Args:
        episode: progress of every world.  diverged: (worlds,).
        names: of the reward terms.
        terms, part_terms: their values (worlds, terms), of each part alone (worlds, parts, terms).
        facts: what is told besides, (worlds,): live arrays.
        more: groups of what else is told, live arrays (worlds, ...); a group may hold groups. It stands before the parts.
        part_facts: what is told of each part besides, (worlds, parts): live arrays.

    Attributes:
        write: ``write(worlds, *told)`` writes what there is to tell of some worlds; of others it may at the same time.
    """

    def __init__(
        self,
        episode: Episode,
        diverged: np.ndarray,
        names: Sequence[str],
        terms: np.ndarray,
        part_terms: np.ndarray,
        facts: Mapping[str, np.ndarray],
        more: Mapping[str, Any],
        part_facts: Mapping[str, np.ndarray],
    ) -> None:
        part = (episode.done, episode.part_fallen, episode.present, episode.part_reward)
        live = Live(episode.number, episode.count, episode.flag, diverged, *part, terms, part_terms)
        self._names, self._more, self._part_facts = tuple(names), more, part_facts
        self.write = bound(tell_worlds, Pinned(LIVE, live))
        self._shape = episode.done.shape
        columns = [episode.number[:, k] for k in NUMBERS], [episode.count[:, k] for k in COUNTS]
        flags = [*(episode.flag[:, k] for k in FLAGS), diverged]
        # Where the rows of Told stand that tell of such an array.
        rows = {_place(each): (group, k) for group, of in enumerate((*columns, flags)) for k, each in enumerate(of)}
        self._facts = {name: rows.get(_place(values)) for name, values in facts.items()}
        self._own = {name: values for name, values in facts.items() if self._facts[name] is None}
        first = (0, len(NUMBERS), len(NUMBERS) + len(COUNTS))  # of each group, in the list of one world
        order = [first[where[0]] + where[1] for where in self._facts.values() if where is not None]
        self._known = tuple(name for name, where in self._facts.items() if where is not None)
        self._pick = _picker(order)
        worlds = self._shape[0]
        self._masks = len(facts) + 2 * (len(self._names) + 1) + len(PART_FLAGS) + len(part_facts) + 2 + _size(more)
        self._everyone = np.ones((self._masks, worlds), dtype=bool)

    def fresh(self) -> Told:
        """With nothing in it yet."""
        worlds, terms = self._shape[0], len(self._names)
        return Told(
            np.empty((TERMS + terms, worlds)),
            np.empty((len(COUNTS), worlds), dtype=np.int64),
            np.empty((DIVERGED + 1, worlds), dtype=bool),
            np.empty((1 + terms, *self._shape)),
            np.empty((len(PART_FLAGS), *self._shape), dtype=bool),
        )

    def batch(self, told: Told, mask: np.ndarray | None = None) -> dict[str, Any]:
        """Of all worlds, with Gymnasium's ``_key`` masks.

        Args:
            told: of a step, which this becomes part of.
            mask: (worlds,) bool, of which worlds there is something to tell: zeros for the others; None: of all.
        """
        if mask is None:
            masks = iter(self._everyone.copy())
        else:
            masks = iter(np.tile(mask, (self._masks, 1)))
            told = _masked(told, mask)
        rows, info = [list(each) for each in told[:3]], {}
        for name, where in self._facts.items():
            info[name] = _shown(self._own[name], mask) if where is None else rows[where[0]][where[1]]
            info[f"_{name}"] = next(masks)
        info["reward_terms"] = _with_masks(self._names, rows[0][TERMS:], masks)
        info["_reward_terms"] = next(masks)
        _add(info, self._more, mask, masks)
        reward, *terms = told.part_number
        parts = _with_masks((*PART_FLAGS, "reward"), [*told.part_flag, reward], masks)
        _add(parts, self._part_facts, mask, masks)
        parts["reward_terms"] = _with_masks(self._names, terms, masks)
        parts["_reward_terms"] = next(masks)
        info["parts"], info["_parts"] = parts, next(masks)
        return info


class OneWorld(Information):
    """Of a single environment. Its arrays stay the same: what it hands out are plain numbers, and copies."""

    def __init__(self, *what: Any) -> None:
        super().__init__(*what)
        terms = len(self._names)
        self._number, self._count = np.zeros(TERMS + terms), np.zeros(len(COUNTS), dtype=np.int64)
        self._flag = np.zeros(DIVERGED + 1, dtype=bool)
        self._part_number = np.zeros((1 + terms, self._shape[1]))
        self._part_flag = np.zeros((len(PART_FLAGS), self._shape[1]), dtype=bool)
        rows = (each[:, None] for each in (self._number, self._count, self._flag))
        self._told = Told._make([*rows, self._part_number[:, None], self._part_flag[:, None]])

    def fresh(self) -> Told:
        """The same ever after."""
        return self._told

    def one(self) -> tuple[float, bool, dict[str, Any]]:
        """Reward, whether the episode has ended, and info: numbers, and arrays as batches of single environments stack them."""
        number, flag, names = self._number.tolist(), self._flag.tolist(), self._names
        terms = number[TERMS:]
        info = dict(zip(self._known, self._pick(number[:TERMS] + self._count.tolist() + flag)))
        if self._own:
            info = {name: info[name] if name in info else self._own[name][0].item() for name in self._facts}
        info["reward_terms"] = dict(zip(names, terms))
        if self._more:
            info |= _first(self._more)
        done, fallen, present = self._part_flag.copy()
        rows = iter(self._part_number.copy())
        parts = {"done": done, "fallen": fallen, "present": present, "reward": next(rows), **_first(self._part_facts)}
        parts["reward_terms"] = dict(zip(names, rows))
        info["parts"] = parts
        return number[0], flag[0], info


_ZERO = {np.dtype(kind): np.zeros((), dtype=kind) for kind in (np.float64, np.int64, np.bool_)}


def _place(values: np.ndarray) -> tuple[Any, ...]:
    """What tells an array of the state from others."""
    return values.__array_interface__["data"][0], values.dtype.str, values.shape, values.strides


def _picker(order: Sequence[int]) -> Callable[[list[Any]], Sequence[Any]]:
    """What picks the entries of a list in this order."""
    return itemgetter(*order) if len(order) > 1 else lambda known: [known[k] for k in order]


def _size(group: Mapping[str, Any]) -> int:
    """How many names there are in a group, with those of its groups."""
    return sum(1 + (_size(each) if isinstance(each, dict) else 0) for each in group.values())


def _with_masks(names: Sequence[str], values: Sequence[np.ndarray], masks: Iterator[np.ndarray]) -> dict[str, Any]:
    """Values by name, each with its mask."""
    shown: dict[str, Any] = {}
    for name, each in zip(names, values, strict=True):
        shown[name], shown[f"_{name}"] = each, next(masks)
    return shown


def _masked(told: Told, mask: np.ndarray) -> Told:
    """A copy with zeros outside the mask (worlds,)."""
    of_worlds = [np.where(mask, each, _ZERO[each.dtype]) for each in told[:3]]
    of_parts = [np.where(mask[:, None], each, _ZERO[each.dtype]) for each in told[3:]]
    return Told._make([*of_worlds, *of_parts])


def _shown(values: np.ndarray, mask: np.ndarray | None) -> np.ndarray:
    """A copy of a live array, with zeros outside the mask."""
    shown = values.copy()
    if mask is not None:
        shown[~mask] = 0
    return shown


def _add(info: dict[str, Any], group: Mapping[str, Any], mask: np.ndarray | None, masks: Iterator[np.ndarray]) -> None:
    """Put copies of live arrays into ``info``, each with its mask."""
    for name, values in group.items():
        if isinstance(values, dict):
            info[name] = {}
            _add(info[name], values, mask, masks)
        else:
            info[name] = _shown(values, mask)
        info[f"_{name}"] = next(masks)


def _first(details: Mapping[str, Any]) -> dict[str, Any]:
    """Details of the first world: numbers, and arrays as batches of single environments stack them."""
    first: dict[str, Any] = {}
    for name, values in details.items():
        if isinstance(values, dict):
            first[name] = _first(values)
        else:
            first[name] = values[0].item() if values.ndim == 1 else values[0].copy()
    return first
