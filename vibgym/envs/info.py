"""``info`` of a step: fields of the episodes by name and column, reward terms, and arrays of single parts.

A kernel copies all fields of a batch into a few new arrays per step; ``info`` contains their rows.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from vibgym.kernels.jit import jit
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

NUMBERS = {
    "reward": REWARD, "position_error": POSITION_ERROR, "heading_error": HEADING_ERROR, "clearance": SMALLEST_GAP,
}  # fmt: skip
COUNTS = {"parts_done": PARTS_DONE, "touching": IN_TOUCH}
FLAGS = {"ended": ENDED, "fallen": DOWN, "is_success": SUCCEEDED}
"""Fields of ``info`` and their columns in ``number``, ``count`` and ``flag`` of :class:`vibgym.tasks.episode.Episode`."""

GROUPS = (NUMBERS, COUNTS, (*FLAGS, "diverged"))
ROWS = {name: (group, row) for group, names in enumerate(GROUPS) for row, name in enumerate(names)}
"""Location of each field in a :class:`Report`: index of the array, and row."""

NUMBER = tuple(NUMBERS.values())
TERMS, DIVERGED = len(NUMBERS), len(FLAGS)
PART_FLAGS = ("done", "fallen", "present")


class Report(NamedTuple):
    """Fields of one step, a row per field."""

    number: np.ndarray  # (NUMBERS and reward terms, worlds) float64
    count: np.ndarray  # (COUNTS, worlds) int64
    flag: np.ndarray  # (FLAGS and diverged, worlds) bool
    part_number: np.ndarray  # (reward and reward terms, worlds, parts) float64
    part_flag: np.ndarray  # (PART_FLAGS, worlds, parts) bool


class Source(NamedTuple):
    """Live arrays that a report is copied from, pinned in memory."""

    number: np.ndarray  # of the episodes, and so on: see vibgym.tasks.episode.Episode
    count: np.ndarray
    flag: np.ndarray
    diverged: np.ndarray
    done: np.ndarray
    part_fallen: np.ndarray
    present: np.ndarray
    part_reward: np.ndarray
    terms: np.ndarray  # (worlds, terms) of the reward
    part_terms: np.ndarray  # (worlds, parts, terms)


SOURCE: Layout[Source] = Layout("SOURCE", __name__)
source_at = SOURCE.at


@jit
def report_worlds(source, worlds, number, count, flag, part_number, part_flag):
    """Copy the fields of some worlds into a report.

    Args:
        source: address of a pinned :class:`Source`.
        worlds: (n,) index.
        number, count, flag, part_number, part_flag: see :class:`Report`.
    """
    all_of = source_at(source)
    terms, part_terms = all_of.terms, all_of.part_terms
    # Row by row: rows of a world are a power of two apart, so writing them together causes cache conflicts.
    for row in range(TERMS):
        for k in range(worlds.shape[0]):
            number[row, worlds[k]] = all_of.number[worlds[k], NUMBER[row]]
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


class InfoData(NamedTuple):
    """Content of ``info``; the arrays are live."""

    fields: Sequence[str]  # names among ROWS, in order
    extra: Mapping[str, np.ndarray]  # further fields (worlds,)
    episode: Episode
    diverged: np.ndarray  # (worlds,) bool
    names: Sequence[str]  # of the reward terms
    terms: np.ndarray  # (worlds, terms)
    part_terms: np.ndarray  # (worlds, parts, terms)
    groups: Mapping[str, Any]  # nested fields (worlds, ...); a group may hold groups
    part_extra: Mapping[str, np.ndarray]  # further fields of single parts (worlds, parts)


class BatchInfo:
    """Makes the ``info`` of a batch, with Gymnasium's ``_key`` masks.

    Attributes:
        write: ``write(worlds, *report)`` copies the fields of some worlds; thread-safe for disjoint worlds.
    """

    def __init__(self, data: InfoData) -> None:
        self._data, episode = data, data.episode
        parts = (episode.done, episode.part_fallen, episode.present, episode.part_reward)
        source = Source(episode.number, episode.count, episode.flag, data.diverged, *parts, data.terms, data.part_terms)
        self.write = bound(report_worlds, Pinned(SOURCE, source))
        self._shape = episode.done.shape
        fields = len(data.fields) + len(data.extra) + 2 * (len(data.names) + 1)
        self._masks = fields + len(PART_FLAGS) + len(data.part_extra) + 2 + _size(data.groups)
        self._all_worlds = np.ones((self._masks, self._shape[0]), dtype=bool)

    def allocate(self) -> Report:
        """Return an uninitialised report."""
        worlds, terms = self._shape[0], len(self._data.names)
        return Report(
            np.empty((TERMS + terms, worlds)),
            np.empty((len(COUNTS), worlds), dtype=np.int64),
            np.empty((DIVERGED + 1, worlds), dtype=bool),
            np.empty((1 + terms, *self._shape)),
            np.empty((len(PART_FLAGS), *self._shape), dtype=bool),
        )

    def read(self, report: Report, mask: np.ndarray | None = None) -> dict[str, Any]:
        """Return ``info`` of all worlds.

        Args:
            report: of a step; its arrays become part of the result.
            mask: (worlds,) bool, worlds to include: zeros for the others; None: all.
        """
        data = self._data
        if mask is None:
            masks = iter(self._all_worlds.copy())
        else:
            masks = iter(np.tile(mask, (self._masks, 1)))
            report = _masked(report, mask)
        rows = [list(array) for array in report[:3]]
        info: dict[str, Any] = {}
        for name in data.fields:
            group, row = ROWS[name]
            info[name] = rows[group][row]
            info[f"_{name}"] = next(masks)
        _add(info, data.extra, mask, masks)
        info["reward_terms"] = _with_masks(data.names, rows[0][TERMS:], masks)
        info["_reward_terms"] = next(masks)
        _add(info, data.groups, mask, masks)
        reward, *terms = report.part_number
        parts = _with_masks((*PART_FLAGS, "reward"), [*report.part_flag, reward], masks)
        _add(parts, data.part_extra, mask, masks)
        parts["reward_terms"] = _with_masks(data.names, terms, masks)
        parts["_reward_terms"] = next(masks)
        info["parts"], info["_parts"] = parts, next(masks)
        return info


def _size(group: Mapping[str, Any]) -> int:
    """Return the number of names in a group, those of nested groups included."""
    return sum(1 + (_size(entry) if isinstance(entry, dict) else 0) for entry in group.values())


def _with_masks(names: Sequence[str], values: Sequence[np.ndarray], masks: Iterator[np.ndarray]) -> dict[str, Any]:
    """Return values by name, each with its mask."""
    shown: dict[str, Any] = {}
    for name, value in zip(names, values, strict=True):
        shown[name], shown[f"_{name}"] = value, next(masks)
    return shown


def _masked(report: Report, mask: np.ndarray) -> Report:
    """Return a copy with zeros outside the mask (worlds,)."""
    of_worlds = [np.where(mask, array, array.dtype.type(0)) for array in report[:3]]
    of_parts = [np.where(mask[:, None], array, array.dtype.type(0)) for array in report[3:]]
    return Report._make([*of_worlds, *of_parts])


def _add(info: dict[str, Any], group: Mapping[str, Any], mask: np.ndarray | None, masks: Iterator[np.ndarray]) -> None:
    """Add copies of live arrays (worlds, ...) to ``info``, each with its mask; zeros outside ``mask``."""
    for name, values in group.items():
        if isinstance(values, dict):
            info[name] = {}
            _add(info[name], values, mask, masks)
        else:
            info[name] = values.copy()
            if mask is not None:
                info[name][~mask] = 0
        info[f"_{name}"] = next(masks)
