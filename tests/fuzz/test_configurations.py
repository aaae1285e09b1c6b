"""Mutated configurations: they parse and prepare, or one line names the file, and the line or field."""

import copy
import tempfile
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from agents.evaluation import EvaluationSettings, prepare
from studies.accuracy import report
from studies.accuracy import settings as accuracy_settings
from tests.fuzz.campaign import count, fuzz, numpy_warns_of_nothing, places  # noqa: F401 - for this module

pytest.importorskip("torch")

from agents.ppo import PPO
from agents.training_file import load_settings

ENVIRONMENT = """
  surface: {rows: 8, columns: 32, element_size_mm: 26, horizontal_amplitude_mm: 2.7, frequency: 25, gravity: 9.81}
  parts:
    - {shape: rectangle, length_mm: 50, width: 0.035, friction: 0.58, static_friction: 0.6, height: 0.02, name: block}
    - {shape: disc, radius_mm: 20, friction: 0.6, restitution: 0.2, contact_friction: 0.3, name: disc}
    - {shape: polygon, vertices_mm: [[0, 0], [50, 0], [50, 20], [20, 20], [20, 40], [0, 40]], friction: 0.5, name: angle}
  walls: [left, top]
  randomize: {parts: [1, 3], friction: [0.9, 1.1], incline: 0.002, dead_zone_mm: [0.05, 0.1]}
  actuators: {kind: prototype, dead_zone_mm: 0.1, latency: 1, phase_spread_deg: 5, dead: [[0, 1]]}
  sensor: {kind: pose, noise: [0.0001, 0.003], dropout: 0.1, estimator: {kind: model, drift: 0.01}}
"""
ZONES = "  zones: {block: [0, 0, 0.2, 0.2], disc: [0.3, 0, 0.5, 0.2], angle: [0.6, 0, 0.8, 0.2]}\n"


def train(path, output):
    """As far as ``python -m agents train`` can refuse the file."""
    settings = load_settings(path)
    if settings.worlds <= 1000:
        try:
            PPO(settings).close()
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None


def evaluate(path, output):
    """As far as ``python -m agents evaluate`` can."""
    settings = EvaluationSettings.load(path, output=str(output))
    try:
        prepare(settings)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def measure(path, output):
    """As far as ``python -m studies.accuracy`` can."""
    settings = accuracy_settings.load_settings(path, str(output))
    try:
        report.prepare(settings)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


KINDS = {"agents": train, "evaluations": evaluate, "accuracy": measure}
TEXTS = [(kind, path.read_text(encoding="utf-8")) for kind in KINDS for path in sorted(Path("configs", kind).glob("*"))]
BLOCK = f"environment:{ENVIRONMENT}{ZONES}"
TEXTS += [
    ("agents", f"task: Sort\nworlds: 4\nsteps: 1000\nppo: {{net: [8], gamma: 0.9}}\n{BLOCK}  action: field\n"),
    ("evaluations", f"tasks: [Sort]\npolicies: [zero, {{kind: random, seed: 3}}]\nepisodes: 2\n{BLOCK}"),
    ("evaluations", "tasks: [Rotate]\npolicies: [{name: a, kind: local_field, tasks: [Rotate]}]\nseeds: [1, 2]\n"),
]

VALUES = st.recursive(
    st.one_of(
        st.none(),
        st.booleans(),
        st.integers(-2, 10),
        st.sampled_from([10**9, 10**12, 2**63, -(10**30), 10**400, 1e300, -1e300, 5e-324, float("nan"), float("inf")]),
        st.floats(allow_nan=False),
        st.text(max_size=5),
        st.sampled_from(
            ["auto", "ideal", "a\nb", "$\\frac$", "x" * 2000, "\x85", "1e400", "../..", "{task}", "zero", "a.json"]
        ),
    ),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=2),
    max_leaves=4,
)
KEYS = st.sampled_from(["<<", "kind", "name", "", "x" * 300, "a b", "rows_mm", "steps", "µ", "seed_deg"]) | st.text(
    max_size=4
)
SNIPPETS = [
    "&a [*a]", "*a", "!!int x", "2024-02-31", "1" * 5000, "\0", "\t", "- ", "? ", "{", "[" * 200, "]", ": ", "\n", "#", "|",
    "%", "---\n", "!!binary x", "'", '"\\ud800"', ".nan", "0x", "1:2:3", "~", "<<: 1\n",
]  # fmt: skip


@st.composite
def documents(draw):
    """Kind and content of a mutated file."""
    kind, text = draw(st.sampled_from(TEXTS))
    if draw(st.booleans()):
        data = yaml.safe_load(text)
        for _ in range(draw(st.integers(1, 2))):
            candidates = list(places(data))
            if candidates:
                _mutate(draw, data, draw(st.sampled_from(candidates)))
        return kind, yaml.safe_dump(data, allow_unicode=True, sort_keys=False).encode("utf-8", "surrogatepass")
    content = bytearray(text.encode())
    for _ in range(draw(st.integers(1, 3))):
        at = draw(st.integers(0, max(len(content) - 1, 0)))
        how = draw(st.sampled_from(["flip", "cut", "drop", "double", "insert", "unicode"]))
        start, end = content.rfind(b"\n", 0, at) + 1, (content.find(b"\n", at) + 1) or len(content)
        if how == "flip" and content:
            content[at] ^= 1 << draw(st.integers(0, 7))
        elif how == "cut":
            del content[at:]
        elif how == "drop":
            del content[start:end]
        elif how == "double":
            content[end:end] = content[start:end]
        elif how == "insert":
            content[at:at] = draw(st.sampled_from(SNIPPETS)).encode()
        else:
            content[at:at] = draw(st.text(max_size=3)).encode()
    return kind, bytes(content)


def _mutate(draw, data, where):
    *above, last = where
    owner = data
    for key in above:
        owner = owner[key]
    how = draw(st.sampled_from(["value", "value", "value", "drop", "rename", "add", "nest", "list", "copy"]))
    if how == "value":
        owner[last] = draw(VALUES)
    elif how == "drop":
        del owner[last]
    elif how == "rename" and isinstance(owner, dict):
        owner[draw(KEYS)] = owner.pop(last)
    elif how == "add" and isinstance(owner, dict):
        owner[draw(KEYS)] = draw(VALUES)
    elif how == "nest":
        for _ in range(draw(st.sampled_from([1, 2, 60]))):
            owner[last] = {draw(KEYS): owner[last]}
    elif how == "list":
        owner[last] = [copy.deepcopy(owner[last]) for _ in range(draw(st.sampled_from([1, 2, 200])))]
    else:
        owner[last] = copy.deepcopy(data)


@fuzz(examples=40, seconds_share=2.0)
@given(documents())
def test_mutated_files(document):
    kind, content = document
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mutated.yaml"
        path.write_bytes(content)
        try:
            KINDS[kind](path, Path(folder) / "out")
        except ValueError as error:
            count("refused")
            text = str(error)
            assert "\n" not in text and text.isprintable() and len(text) < 4000, text
            assert str(path) in text, text
        else:
            count("accepted")
