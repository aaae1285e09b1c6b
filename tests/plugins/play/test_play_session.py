"""Messages of the page and their effects."""

import base64
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from vibgym.plugins.play import starts
from vibgym.plugins.play.choices import settings_of
from vibgym.plugins.play.session import Session, parsed


class Page:
    """Sender of numbered messages."""

    def __init__(self, task, folder):
        self.session, self.n = Session(settings_of(task), folder), 0

    def __call__(self, do, **rest):
        self.n += 1
        return self.session.do(json.dumps({"n": self.n, "do": do, **rest}))

    @property
    def pose(self):
        return self.session.world.core.simulator.pose[0]


@pytest.fixture
def align(tmp_path):
    return Page("Align", tmp_path)


def refused(answers):
    return [answer["text"] for answer in answers if answer["kind"] == "refused"]


@pytest.mark.parametrize(("text", "named"), [
    ("hello", "message"), ("{}", "do"), ('{"do": "fly", "n": 1}', "do"), ('{"do": "undo", "n": 1}', "undo"),
    ('{"do": "pace", "n": 1, "speed": 100}', "speed"), ('{"do": "pace", "n": 0, "speed": 1}', "n"),
    ('{"do": "aim", "n": 1, "part": 0, "pose": [1, 2, NaN]}', "pose.2"),
    ('{"do": "aim", "n": 1, "part": 7, "pose": [0.1, 0.1, 0]}', "part"),
    ('{"do": "aim", "n": 1, "part": 0, "pose": [9, 0.1, 0]}', "pose"),
    ('{"do": "paint", "n": 1, "elements": [[0, 0]], "phasor": [3, 0]}', "phasor.0"),
    ('{"do": "paint", "n": 1, "elements": [[0, 99]], "phasor": [1, 0]}', "columns 0 to 31"),
    ('{"do": "switch", "n": 1, "hardware": "gold"}', "hardware"), ('{"do": "switch", "n": 1, "policy": "magic"}', "policy"),
    ('{"do": "open", "n": 1, "id": "Nothing"}', "id"), ('{"do": "open", "n": 1, "start": "abc"}', "start"),
    ('{"do": "carry", "n": 1, "part": 0, "pose": [0.1, 0.1, 0]}', "part"), ('{"do": "carry", "n": 1, "part": 0}', "pose"),
    ('{"do": "record", "n": 1, "what": "gif"}', "record"), ('{"do": "reset", "n": 1, "colour": "red"}', "colour"),
])  # fmt: skip
def test_bad_messages_are_one_clear_line_and_change_nothing(align, text, named):
    session = align.session
    before = session.world.get_state()["env"]
    answers = session.do(text)
    (line,) = refused(answers)
    assert named in line and "\n" not in line
    after = session.world.get_state()["env"]
    assert np.array_equal(before["simulator"]["pose"], after["simulator"]["pose"])
    assert np.array_equal(before["episode"]["goal"], after["episode"]["goal"])
    session.step()


TREES = st.recursive(st.none() | st.floats() | st.text(), lambda inner: st.dictionaries(st.text(), inner))


@given(st.text() | st.binary() | TREES.map(json.dumps))
def test_any_text_is_a_message_or_refused(text):
    try:
        parsed(text)
    except ValueError as error:
        assert "\n" not in str(error)


def test_a_repeated_message_is_executed_once(align):
    text = json.dumps({"n": 5, "do": "steps", "count": 3})
    align.session.do(text)
    there = align.pose
    assert align.session.do(text) == [] and np.array_equal(align.pose, there)
    assert align.session.acknowledged == 5


def test_undo_takes_back_step_by_step(align):
    align("pace", running=False)
    first, goal = align.pose, align.session.world.core.episode.goal.copy()
    align("steps", count=5)
    second = align.pose
    align("lift", part=0)
    align("carry", part=0, pose=[0.5, 0.1, 0.2])
    align("place", part=0)
    align("aim", part=0, pose=[0.3, 0.1, 0.0])
    align("paint", elements=[[0, 0]], phasor=[1, 0])
    align("switch", hardware="prototype")
    align("open", id="Sort")
    assert len(align.pose) == 6
    for hardware in ("prototype", "ideal"):
        align("undo")
        assert align.session.world.settings.hardware == hardware
    align("undo")
    assert np.isnan(align.session.world.paint).all()
    align("undo")
    assert np.array_equal(align.session.world.core.episode.goal, goal)
    assert align.pose[0].tolist() == [0.5, 0.1, 0.2]
    align("undo")
    assert np.array_equal(align.pose, second) and not align.session.world.held
    align("undo")
    assert np.array_equal(align.pose, first)
    align("steps", count=5)
    assert np.array_equal(align.pose, second)


def test_a_shared_start_is_restored(tmp_path):
    page = Page("Sort", tmp_path)
    page("steps", count=20)
    page("paint", elements=[[1, 2], [3, 4]], phasor=[0.6, -0.8])
    page("switch", hardware="prototype", policy="planner")
    code = next(message["code"] for message in page("share") if message["kind"] == "start")
    assert len(code) < 1500 and code.replace("-", "").replace("_", "").isalnum()
    world = starts.world_from(code)
    np.testing.assert_allclose(world.core.simulator.pose[0], page.pose, atol=1e-6)
    assert world.settings == page.session.world.settings
    np.testing.assert_allclose(world.paint, page.session.world.paint, atol=1e-4)


@given(st.data())
def test_an_altered_start_is_refused(data):
    code = CODE
    place = data.draw(st.integers(0, len(code) - 2))  # the last letter has unused bits
    letter = data.draw(st.sampled_from("ABCDEFGHIJabcdefghij0123456789-_").filter(lambda sign: sign != code[place]))
    with pytest.raises(ValueError, match="start"):
        starts.world_from(code[:place] + letter + code[place + 1 :])


CODE = starts.code_of(Session(settings_of("Align"), None).world)


def recorded(page, what):
    """Record steps, a stroke and more steps; return the answer."""
    page("record", what="begin")
    page("steps", count=20)
    page("paint", elements=[[0, 0]], phasor=[1, 0])
    page("steps", count=10)
    return next(answer for answer in page("record", what=what) if answer["kind"] == "kept")


def test_recordings_hold_what_was_seen_and_done(align, monkeypatch):
    kept = recorded(align, "gif")
    path = align.session.kept[kept["link"].removeprefix("kept/")]
    with Image.open(path) as film:
        lasts = [film.seek(k) or film.info["duration"] for k in range(film.n_frames)]
        assert sum(lasts) == 16 * 80, "pictures that are the same are kept once"
    align("switch", policy="zero")
    kept = recorded(align, "minari")
    name = kept["text"].rpartition("data set ")[2].rstrip(")")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(align.session.output))
    import minari

    data = minari.load_dataset(name)
    episodes = list(data.iterate_episodes())
    assert sum(len(episode) for episode in episodes) == 30
    env = data.recover_environment()
    assert env.spec.id == "vibgym/Align-v0"
    assert env.action_space.contains(episodes[-1].actions[-1])
    assert episodes[-1].observations.shape == (11, *env.observation_space.shape)


def test_a_recorded_episode_is_reproduced_by_the_environment(align):
    """The actions of a recording, played in the environment that it names, give its rewards."""
    align("reset", seed=4)
    align("record", what="begin")
    for _ in range(30):
        align.session.step()
    segment = align.session._recorder.segments[0]
    env = settings_of("Align").environment()
    env.reset(seed=4)
    rewards = [env.step(action)[1] for action in segment.actions]
    assert rewards == segment.rewards


def test_a_dropped_drawing_becomes_the_part(align, tmp_path):
    """The part of the task is replaced, with its friction; undo brings it back, and a link keeps it."""
    pytest.importorskip("svgpathtools")
    path = tmp_path / "ell.svg"
    lines = '<svg xmlns="http://www.w3.org/2000/svg" width="90mm" viewBox="0 0 90 90">\n'
    lines += '<path d="M0 0h50v15h-30v25h-20z"/></svg>'
    path.write_text(lines)
    before = align.session.world.env.parts[0]
    content = base64.b64encode(path.read_bytes()).decode()
    assert not refused(align("drop", name="C:\\drawings\\ell.svg", content=content))
    part = align.session.world.env.parts[0]
    assert (part.name, part.friction) == ("ell", before.friction)
    assert part.area == pytest.approx(50 * 15e-6 + 20 * 25e-6)
    align.session.step()
    code = next(answer["code"] for answer in align("share") if answer["kind"] == "start")
    assert starts.world_from(code).env.parts[0].same_as(part)
    assert not refused(align("switch", hardware="prototype")) and align.session.world.env.parts[0].same_as(part)
    noted = base64.b64encode(lines.replace("</svg>", "<text>30</text></svg>").encode()).decode()
    notes = [answer["text"] for answer in align("drop", name="ell.svg", content=noted) if answer["kind"] == "note"]
    assert notes == ["ell.svg: skipped 1 text"]
    align("undo")
    bad = base64.b64encode(lines.replace("z", "").encode()).decode()
    (text,) = refused(align("drop", name="ell.svg", content=bad))
    assert text == "ell.svg: path in line 2 is open, and filled without a stroke: close it"
    assert refused(align("drop", name="ell.svg", content="%%"))[0].startswith("content")
    align("undo")
    align("undo")
    assert align.session.world.env.parts[0].same_as(before)
