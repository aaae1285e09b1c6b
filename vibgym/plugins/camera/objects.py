"""Finding objects in the image: fixed threshold, area of interest, coarse grid, runs, moments from runs (thesis section 5.1).

An object is a set of dark pixels that are connected along lines and columns. A coarse grid hits at least one pixel of each;
from there its runs are followed from line to line. Moments are sums over runs (the delta method, eqs. 5.13 to 5.18).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import jit


class Interest(NamedTuple):
    """The area of interest and parameters of the search."""

    first: np.ndarray  # (lines,) first column of interest in each line; beyond ``last`` for empty lines
    last: np.ndarray  # (lines,) last column of interest
    threshold: float  # grey level below which a pixel belongs to a part
    lines: int  # spacing of the coarse grid
    columns: int  # the same along lines
    least: int  # fewest pixels of an object; smaller ones are noise


class Found(NamedTuple):
    """Objects of one image; entries beyond the counts are undefined."""

    count: np.ndarray  # (2,) int64, objects and runs
    run: np.ndarray  # (most runs, 4) int64: line, first column, column after the last, object
    first: np.ndarray  # (most objects + 1,) int64 of each object's runs
    moment: np.ndarray  # (most objects, 6) float64: M00, M10, M01, M20, M11, M02 of columns and lines
    box: np.ndarray  # (most objects, 4) int64: first line, line after the last, first column, column after the last
    # (most objects,) bool: reaches the border of the area of interest, so that it may be incomplete
    clipped: np.ndarray
    label: np.ndarray  # (lines, columns) int16: 1 + object, 0 elsewhere


def new_found(shape: tuple[int, int], objects: int) -> Found:
    """Return arrays for the objects of an image of ``shape``; further objects and runs are skipped."""
    runs = shape[0] * 8 + objects * 64
    return Found(
        np.zeros(2, dtype=np.int64),
        np.zeros((runs, 4), dtype=np.int64),
        np.zeros(objects + 1, dtype=np.int64),
        np.zeros((objects, 6)),
        np.zeros((objects, 4), dtype=np.int64),
        np.zeros(objects, dtype=np.bool_),
        np.zeros(shape, dtype=np.int16),
    )


@jit
def _add_run(grey, interest, line, column, number, count, blobs):
    """Store the run of dark pixels through a dark one; returns the new number of runs."""
    start, end = column, column + 1
    while start > interest.first[line] and grey[line, start - 1] < interest.threshold:
        start -= 1
    while end <= interest.last[line] and grey[line, end] < interest.threshold:
        end += 1
    for at in range(start, end):
        blobs.label[line, at] = number + 1
    run = blobs.run[count]
    run[0], run[1], run[2], run[3] = line, start, end, number
    return count + 1


@jit
def _follow(grey, interest, number, first, blobs):
    """Store all runs of an object whose first run is known; returns the total number of runs, or -1 without room."""
    at, count = first, first + 1
    while at < count:
        line, start, end = blobs.run[at, 0], blobs.run[at, 1], blobs.run[at, 2]
        for step in range(-1, 2, 2):
            near = line + step
            if 0 <= near < grey.shape[0]:
                for column in range(max(start, interest.first[near]), min(end, interest.last[near] + 1)):
                    if blobs.label[near, column] == 0 and grey[near, column] < interest.threshold:
                        if count == blobs.run.shape[0]:
                            return -1
                        count = _add_run(grey, interest, near, column, number, count, blobs)
        at += 1
    return count


@jit
def run_moments(line, start, length, moment):
    """Add a run of pixels to the moments (thesis eqs. 5.13 to 5.18).

    Args:
        line, start, length: whole numbers: line, first column and number of pixels (delta).
        moment: (6,) M00, M10, M01, M20, M11, M02.
    """
    d = float(length)
    m10 = start * d + 0.5 * (d * d - d)
    moment[0] += d
    moment[1] += m10
    moment[2] += line * d
    moment[3] += start * start * d + start * (d * d - d) + (d * d * d / 3.0 - d * d / 2.0 + d / 6.0)
    moment[4] += line * m10
    moment[5] += line * line * d


@jit
def _describe(interest, number, first, last, blobs):
    """Return moments, box and clipping of an object from its runs; moments are about the first pixel of its first run."""
    moment, box = blobs.moment[number], blobs.box[number]
    moment[:] = 0.0
    line0, column0 = blobs.run[first, 0], blobs.run[first, 1]
    box[0], box[1], box[2], box[3] = line0, line0 + 1, column0, column0 + 1
    clipped = False
    for k in range(first, last):
        line, start, end = blobs.run[k, 0], blobs.run[k, 1], blobs.run[k, 2]
        run_moments(line - line0, start - column0, end - start, moment)
        box[0], box[1] = min(box[0], line), max(box[1], line + 1)
        box[2], box[3] = min(box[2], start), max(box[3], end)
        clipped = clipped or start == interest.first[line] or end == interest.last[line] + 1
        for near in range(line - 1, line + 2, 2):
            if near < 0 or near >= interest.first.shape[0]:
                clipped = True
            elif start < interest.first[near] or end > interest.last[near] + 1:
                clipped = True
    blobs.clipped[number] = clipped
    shift_moments(moment, column0, line0)


@jit
def shift_moments(moment, column, line):
    """Return moments of an object displaced by (column, line)."""
    m00, m10, m01 = moment[0], moment[1], moment[2]
    moment[3] += column * (2.0 * m10 + column * m00)
    moment[4] += column * m01 + line * m10 + column * line * m00
    moment[5] += line * (2.0 * m01 + line * m00)
    moment[1] += column * m00
    moment[2] += line * m00


@jit
def find(grey: np.ndarray, interest: Interest, blobs: Found) -> None:
    """Find all objects in the area of interest, after those of the previous image are cleared.

    Args:
        grey: (lines, columns) uint8.
    """
    for k in range(blobs.count[1]):
        for column in range(blobs.run[k, 1], blobs.run[k, 2]):
            blobs.label[blobs.run[k, 0], column] = 0
    objects, runs = 0, 0
    for line in range(interest.lines // 2, grey.shape[0], interest.lines):
        for column in range(interest.first[line], interest.last[line] + 1, interest.columns):
            if grey[line, column] >= interest.threshold or blobs.label[line, column] != 0:
                continue
            if objects == blobs.moment.shape[0] or runs == blobs.run.shape[0]:
                blobs.count[0], blobs.count[1] = objects, runs
                return
            first = runs
            _add_run(grey, interest, line, column, objects, runs, blobs)
            runs = _follow(grey, interest, objects, first, blobs)
            if runs < 0:  # no room: the remaining objects are not parts
                blobs.count[0], blobs.count[1] = objects, blobs.run.shape[0]
                return
            _describe(interest, objects, first, runs, blobs)
            if blobs.moment[objects, 0] >= interest.least:
                blobs.first[objects], blobs.first[objects + 1] = first, runs
                objects += 1
            else:
                for k in range(first, runs):
                    for at in range(blobs.run[k, 1], blobs.run[k, 2]):
                        blobs.label[blobs.run[k, 0], at] = 0
                runs = first
    blobs.count[0], blobs.count[1] = objects, runs


def area_of_interest(places: np.ndarray, shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Return first and last column, each (lines,), of pixel centres inside a convex polygon ``places`` (n, 2), px."""
    first, last = np.full(shape[0], 0, dtype=np.int64), np.full(shape[0], -1, dtype=np.int64)
    following = np.roll(places, -1, axis=0)
    for line in range(shape[0]):
        crossing = (places[:, 1] <= line) != (following[:, 1] <= line)
        if crossing.any():
            here, there = places[crossing], following[crossing]
            column = here[:, 0] + (line - here[:, 1]) / (there[:, 1] - here[:, 1]) * (there[:, 0] - here[:, 0])
            first[line] = max(int(np.ceil(column.min())), 0)
            last[line] = min(int(np.floor(column.max())), shape[1] - 1)
    return first, last
