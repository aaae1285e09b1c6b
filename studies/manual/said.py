"""Words of the generated pages that stand in docstrings as reST, or in lists there."""

from __future__ import annotations

import re

from vibgym.tasks.episode import QUANTITIES

ACTIONS_SAID = {
    "element": "amplitude and phase of every element",
    "phasor": "amplitude x (cos, sin) phase of every element",
    "patch": "the same of the elements around each part",
    "field": "strengths of six basic fields around each part",
    "wrench": "wanted acceleration of each part, x, y and angular, in units of what the elements can give",
}

TERMS_SAID = {
    "distance": "by how much the mean distance has shrunk, per 100 mm",
    "approach": "by how much tanh(mean distance / 10 mm) has shrunk",
    "turn": "by how much the mean heading error has shrunk, per rad",
    "alignment": "by how much tanh(heading error / 0.15 rad) has shrunk",
    "inside": "change of the share of parts whose centre is at its goal",
    "within": "1 while all parts are where and as they should be",
    "clearance": "change of the mean of min(distance to the nearest part / what is asked, 1)",
    "time": "-1 every period",
    "success": "1 on success",
    "fallen": "-1 if a part has fallen",
    "good": "1 for a part that has left as it should",
    "faulty": "-1 for a part that has left otherwise",
}
"""Of each of :data:`vibgym.tasks.episode.QUANTITIES`."""

if TERMS_SAID.keys() != set(QUANTITIES):
    raise RuntimeError(f"words are missing for {sorted(TERMS_SAID.keys() ^ set(QUANTITIES))}")


def spoken(text: str) -> str:
    """A paragraph of a docstring in Markdown: roles and literals as code."""
    text = re.sub(r":\w+:`~?\.?(?:[\w.]*\.)?(\w+)`", r"`\1`", text)
    return re.sub(r"``(.+?)``", r"`\1`", text).replace("|", "\\|")
