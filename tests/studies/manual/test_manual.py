"""Generated documentation agrees with the results and the code."""

import csv
import json
import re
import statistics
from collections import Counter
from xml.etree import ElementTree

import gymnasium as gym
import numpy as np
import pytest
from docutils import nodes
from docutils.core import publish_doctree
from PIL import Image

from studies.manual import build, films, open_tasks, performance, published, rest, settings, site
from studies.manual.__main__ import main
from studies.manual.figures_file import RESULTS, ROOT
from studies.thesis.figures import FIGURES
from tests.commands import refusal
from vibgym.registration import ENVIRONMENTS


def cells_of(text):
    """Return the rows of a table in Markdown, without heading and rule."""
    lines = [line for line in text.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in lines[2:]]


@pytest.fixture(scope="module")
def pages():
    return build.pages()


@pytest.mark.parametrize(("task", "policy"), [("Transport", "random"), ("Align", "open_loop"), ("Rotate", "learned")])
def test_results_follow_from_the_episodes(task, policy):
    with (RESULTS / "report" / "episodes.csv").open(newline="") as file:
        lines = [line for line in csv.DictReader(file) if line["study"] == "report" and line["hardware"] == "ideal"]
    chosen = [line for line in lines if (line["task"], line["policy"]) == (task, policy)]
    times = [float(line["time_to_goal_s"]) for line in chosen if line["time_to_goal_s"]]
    row = next(cells for cells in cells_of(published.TABLES["one-part"]()) if cells[:2] == [task, policy])
    assert row[2] == f"{100 * sum(line['success'] == '1' for line in chosen) / len(chosen):.1f} %"
    assert row[4] == f"{statistics.median(times):.2f} s"
    assert row[-1] == f"{100 * sum(line['fallen'] == '1' for line in chosen) / len(chosen):.1f} %"


def test_every_table_has_rows_and_no_missing_values():
    for name, make in published.TABLES.items():
        text = make()
        assert name == "provenance" or cells_of(text), name
        assert "nan" not in text and "None" not in text, name
    assert published.report().day in published.provenance()


def test_cells_without_a_value():
    """Missing results are dashes; continuous tasks report good parts instead of success; agents have one line each."""
    rows = {tuple(cells[:2]): cells for cells in cells_of(open_tasks.suite())}
    assert rows["prototype", "mpc"][3:] == ["–"] * 8 and rows["ideal", "classical"][3] != "–"
    feed, swap = open_tasks.of("Feed"), open_tasks.of("Swap")
    assert "success" not in feed and "good parts per minute" in feed
    assert "success" in swap and "good parts per minute" not in swap and "| task |" not in swap
    lines = {cells[0].removesuffix(" (one seed)"): cells for cells in published.agent_lines()}
    assert lines["Feed/ideal"][1] == "–" and lines["Feed/ideal"][5] != "–"
    assert re.fullmatch(r"[\d., ]+ % of \d+", lines["Align/ideal"][1])
    with (RESULTS / "agents.csv").open(newline="") as file:
        seeds = Counter(row["agent"] for row in csv.DictReader(file) if row["agent"].startswith("Swap/"))
    expected = {name + (" (one seed)" if count == 1 else "") for name, count in seeds.items()}
    assert {cells[0] for cells in published.agent_lines("Swap")} == expected


def test_every_environment_has_a_page(pages):
    assert pages.keys() == ENVIRONMENTS.keys()
    assert {path.stem for path in (ROOT / "docs" / "films").glob("*.webp")} == ENVIRONMENTS.keys()
    index = (ROOT / "docs" / "environments" / "index.md").read_text(encoding="utf-8")
    assert set(re.findall(r"^([A-Z]\w+)$", index, re.M)) == ENVIRONMENTS.keys()


@pytest.mark.parametrize("name", ["Align", "Sort", "Push", "Feed"])
def test_tables_of_a_page_agree_with_the_environment(pages, name):
    page = pages[name]
    for action, shape, numbers, _ in cells_of(page.split("## Actions")[1].split("## ")[0]):
        space = gym.make(f"vibgym/{name}-v0", action=action.strip("`")).action_space
        assert space.shape == (int(numbers),) and np.prod([int(n) for n in re.findall(r"\d+", shape)]) == int(numbers)
    env = gym.make(f"vibgym/{name}-v0").unwrapped
    state = cells_of(page.split("### Features of `state`")[1].split("## ")[0])
    indices = [int(index) for cells in state for index in cells[0].split(",")]
    assert indices == list(range(env.observation_space.shape[0] // env.task.slots))
    rewards = cells_of(page.split("## Reward")[1].split("## ")[0])
    assert {cells[0]: float(cells[2]) for cells in rewards} == pytest.approx(env.task.weights)


def test_films_are_small_and_move(tmp_path):
    for name in ENVIRONMENTS:
        path = ROOT / "docs" / "films" / f"{name}.webp"
        assert path.stat().st_size < 100_000, name
        with Image.open(path) as film:
            assert film.n_frames >= 5 and film.width <= 480, name
    assert main(["films", "--only", "Rotate", "--output", str(tmp_path), "--quiet"]) == 0
    with Image.open(tmp_path / "Rotate.webp") as film:
        assert film.n_frames > 3 and film.width == films.FEW.width
        film.seek(film.n_frames - 1)
        last = np.asarray(film.convert("RGB"), dtype=float)
        film.seek(0)
        assert np.abs(last - np.asarray(film.convert("RGB"), dtype=float)).max() > 50


def test_the_thesis_page_has_every_figure_and_its_pictures():
    text = (ROOT / "docs" / "thesis" / "figures.md").read_text(encoding="utf-8")
    assert re.findall(r"`python -m studies.thesis --figure (\w+)`", text) == list(FIGURES)
    pictures = re.findall(r"\]\(thesis/([\w-]+\.png)\)", text)
    assert len(pictures) >= len(FIGURES)
    assert {path.name for path in (ROOT / "docs" / "thesis").glob("*.png")} == set(pictures)


def test_markdown_in_a_docstring_becomes_rest():
    lines = [
        "It moves.",
        "",
        "## Rewards",
        "Their sum:",
        "",
        "| term | meaning |",
        "|---|---|",
        "| time | every ``x`` |",
        "",
    ]
    tree = publish_doctree("\n".join(rest.converted(lines)), settings_overrides={"report_level": 2, "halt_level": 2})
    entries = [entry.astext() for entry in tree.findall(nodes.entry)]
    assert entries == ["term", "meaning", "time", "every x"]
    assert [title.astext() for title in tree.findall(nodes.rubric)] == ["Rewards"]


@pytest.mark.parametrize("name", settings.INCLUDED)
def test_pages_include_the_tables_of_settings(name):
    text = settings.included()[name]
    names = [cells[0].strip("`") for cells in cells_of(text)]
    assert names == list(settings.INCLUDED[name][1]) and ":mod:" not in text
    pages = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "docs").glob("*.md"))
    assert f"{{include}} generated/settings/{name}.md" in pages


def test_the_readme_is_updated_between_its_marks(tmp_path, capsys):
    path = tmp_path / "README.md"
    path.write_text(f"before\n{build.BEGIN}\nold\n{build.END}\nafter\n")
    assert main(["readme", "--output", str(tmp_path)]) == 0
    text = path.read_text(encoding="utf-8")
    assert (
        "old" not in text
        and text.startswith("before\n")
        and text.endswith("\nafter\n")
        and published.overview() in text
    )
    assert main(["readme", "--output", str(tmp_path)]) == 0
    assert "unchanged" in capsys.readouterr().out


@pytest.mark.parametrize("text", ["", build.BEGIN, build.END + build.BEGIN, 2 * (build.BEGIN + build.END)])
def test_a_readme_without_its_marks_is_rejected_unchanged(tmp_path, capsys, text):
    path = tmp_path / "README.md"
    path.write_text(text)
    message = refusal(capsys, main, "readme", "--output", tmp_path)
    assert "README" in message and path.read_text() == text


@pytest.mark.parametrize(("command", "known"), [("films", "Transport"), ("thesis", "transient")])
def test_unknown_names_are_rejected(tmp_path, capsys, command, known):
    message = refusal(capsys, main, command, "--only", "Nothing", "--output", tmp_path / "out")
    assert "'Nothing'" in message and known in message and not (tmp_path / "out").exists()


def test_versions_are_listed_branches_first_then_the_newest_release(tmp_path):
    for name in ("0.9.0", "0.10.0", "main", "0.2.0"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "index.html").touch()
    (tmp_path / "other").mkdir()
    assert site.versions(tmp_path) == ["main", "0.10.0", "0.9.0", "0.2.0"]
    assert [site.name_of(ref) for ref in ("v1.2.3", "main", "a/b")] == ["1.2.3", "main", "a-b"]


def test_unknown_versions_are_refused_before_anything_is_built(tmp_path):
    with pytest.raises(ValueError, match="REF"):
        site.build(tmp_path / "site", ["HEAD", "no such ref"])
    assert not (tmp_path / "site").exists()


def test_charts_are_inline_graphics_in_the_colour_of_the_page():
    charts = performance.generated()
    for name in ("roofline", *performance.CURVES):
        chart = charts[f"{name}-chart"]
        graphic = ElementTree.fromstring(chart)[0]
        assert graphic.get("role") == "img" and graphic.get("aria-label") and graphic.get("width") is None
        assert "currentColor" in chart and performance.INK not in chart and "\n" not in chart
    ids = [name for text in charts.values() for name in re.findall(r' id="([^"]+)"', text)]
    assert ids and len(ids) == len(set(ids))  # all are on one page
    stored = json.loads(performance.STORED.read_text(encoding="utf-8"))
    for scene in stored["stages"]:
        assert f"{sum(scene['stages'].values()):.2f}" in charts["stages"]
