"""The files: whole, complete, and readable without a network."""

import csv
import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest

from agents.evaluation import report


class Links(HTMLParser):
    """Collects what a page would load, and the tags that are open."""

    VOID = {"meta", "img", "input", "br"}

    def __init__(self):
        super().__init__()
        self.loads: list[str] = []
        self.targets: set[str] = set()
        self.anchors: list[str] = []
        self.open: list[str] = []

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        assert tag not in ("link", "iframe") and not (tag == "script" and "src" in values)
        self.targets |= {value for value in [values.get("id")] if value}
        self.anchors += [value for value in [values.get("href")] if value]
        self.loads += [value for key in ("src", "srcset", "data") if (value := values.get(key))]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_page_opens_offline(written):
    text = (written / "report.html").read_text(encoding="utf-8")
    page = Links()
    page.feed(text)
    assert not page.open
    assert page.loads and all(each.startswith("data:image/") for each in page.loads)
    assert page.anchors and all(each.startswith("#") and each[1:] in page.targets for each in page.anchors)
    assert "@import" not in text and not re.search(r"url\(", text)
    assert len(text) < 1e6


def test_page_says_what_was_found(found, written):
    text = (written / "report.html").read_text(encoding="utf-8")
    assert "still &lt;&amp;&gt;" in text and "still <&>" not in text
    assert "Does &lt;nothing&gt; &amp; says so." in text
    assert text.count("data:image/gif;") == len(found.rollouts)
    for row in report.rows(found):
        assert f"{100 * row['success_rate']:.1f} %" in text
        assert f"Film of seed {found.rollout(row['task'], row['hardware'], row['policy']).film.seed}" in text


def test_bold_differences_are_those_that_are_clear(found, written):
    text = (written / "report.html").read_text(encoding="utf-8")
    gaps = report.against_best(found, report.comparisons(found), report.best_rows(found, report.rows(found)))
    clear = [gap[name].clear for gap in gaps for name in ("success", "time") if gap[name].interval is not None]
    assert text.count('<td class="clear"') == sum(clear) and not all(clear)


def test_best_policy_has_most_successes_then_the_lowest_time(found):
    rows = report.rows(found)

    def best(**changes):
        changed = [{**row, **changes.get(row["policy"], {})} if row["task"] == "Transport" else row for row in rows]
        return report.best_row(found, changed, "Transport", "ideal")["policy"]

    nan, every = float("nan"), {"successes": 8, "success_rate": 1.0}
    assert (
        best(counting={**every, "time_over_bound_median": 1.5}, pusher={**every, "time_over_bound_median": 1.6})
        == "counting"
    )
    unknown = {**every, "time_over_bound_median": nan}
    assert (
        best(counting={**unknown, "time_to_goal_median_s": 0.5}, pusher={**unknown, "time_to_goal_median_s": 0.4})
        == "pusher"
    )
    assert best(counting=every, pusher={"successes": 7}) == "counting"


def test_times_are_multiples_of_the_bound(found):
    for row in report.rows(found):
        rollout = found.rollout(row["task"], row["hardware"], row["policy"])
        each = (rollout.steps * rollout.step_time / rollout.bound)[rollout.success]
        expected = np.median(each) if len(each) else np.nan
        assert row["time_over_bound_median"] == pytest.approx(expected, nan_ok=True) and not expected <= 1.0


def test_json_holds_everything(found, written):
    def refuse(constant):
        raise AssertionError(f"{constant} is not JSON")

    content = json.loads((written / "results.json").read_text(encoding="utf-8"), parse_constant=refuse)
    assert content["seeds"] == list(range(300, 308))
    assert content["versions"]["numpy"] == np.__version__ and content["versions"]["vibgym"]
    assert content["machine"]["cores"] >= 1 and "commit" in content
    assert content["settings"]["tasks"] == ["Transport", "Align"]
    assert len(content["results"]) == 6 and len(content["comparisons"]) == 6 and len(content["episodes"]) == 48
    assert content["results"][0]["time_to_goal_median_s"] is None
    assert content["tasks"]["Align"]["position_tolerance"] == 0.002


def test_csv_rows(found, written):
    with (written / "results.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [(row["task"], row["hardware"], row["policy"]) for row in rows] == [place[1:] for place, _ in found.rollouts]
    assert rows[0]["time_to_goal_median_s"] == "" and float(rows[0]["success_rate"]) == 0.0
    with (written / "episodes.csv").open(newline="", encoding="utf-8") as file:
        episodes = list(csv.DictReader(file))
    pusher = found.rollout("Transport", "ideal", "pusher")
    mine = [row for row in episodes if (row["task"], row["policy"]) == ("Transport", "pusher")]
    assert [int(row["seed"]) for row in mine] == list(pusher.seeds)
    np.testing.assert_array_equal([float(row["position_error_m"]) for row in mine], pusher.position_error)


def test_only_the_files_are_left(written):
    assert sorted(path.name for path in written.iterdir()) == [
        "episodes.csv",
        "report.html",
        "results.csv",
        "results.json",
    ]
