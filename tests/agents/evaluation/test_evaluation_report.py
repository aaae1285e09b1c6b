"""The files: whole, complete, and readable without a network."""

import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest

from agents.evaluation import EvaluationSettings, difference, prepare, report, table
from agents.evaluation.rows import against_best, best_rows, differences, rows
from agents.evaluation.settings import laid_over, with_sensor
from agents.evaluation.table import where
from tests.agents.evaluation.conftest import BROKEN, CASES, SEVERAL, Counting, Pusher, Still
from tests.commands import rows_of


class Links(HTMLParser):
    """What a page would load, and the tags that are open."""

    VOID = {"meta", "img", "input", "br"}

    def __init__(self):
        super().__init__()
        self.loads, self.targets, self.anchors, self.open = [], set(), [], []

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


def test_pages_open_offline(written, written_several):
    for directory in (written, written_several):
        text = (directory / "report.html").read_text(encoding="utf-8")
        page = Links()
        page.feed(text)
        assert not page.open
        assert page.loads and all(address.startswith("data:image/") for address in page.loads)
        assert page.anchors and all(link.startswith("#") and link[1:] in page.targets for link in page.anchors)
        assert "@import" not in text and not re.search(r"url\(", text) and len(text) < 1.5e6


def test_pages_show_policies_hardware_effects_and_clear_differences(basic, written, written_several):
    text = (written / "report.html").read_text(encoding="utf-8")
    assert "still &lt;&amp;&gt;" in text and "still <&>" not in text
    assert "Does &lt;nothing&gt; &amp; says so." in text
    assert text.count("data:image/gif;") == len(basic.cases) == 6
    every = rows(basic)
    assert all(f"{100 * row['success_rate']:.1f} %" in text for row in every)
    gaps = against_best(basic, differences(basic, every), best_rows(basic, every))
    clear = [gap[name].clear for gap in gaps for name in ("success", "time") if gap[name].interval is not None]
    assert text.count('<td class="clear"') == sum(clear) and not all(clear)
    text = (written_several / "report.html").read_text(encoding="utf-8")
    assert "latency: 3" in text and text.count('id="card-') == 8
    section = text[text.index('<h2 id="effects"') : text.index('<h2 id="Transport"')]
    assert "late &lt;eyes&gt;" in section and "<eyes>" not in section and "delay: 5" in section
    assert section.count("<td style=") == 6


def test_best_policy_has_most_successes_then_the_lowest_time(basic):
    every = rows(basic)

    def best(**changes):
        changed = [{**row, **changes.get(row["policy"], {})} if row["task"] == "Transport" else row for row in every]
        return best_rows(basic, changed)["Transport", "ideal"]["policy"]

    all_of_them = {"successes": 8, "success_rate": 1.0}
    ratio, time = "time_over_bound_median", "time_to_goal_median_s"
    assert best(counting={**all_of_them, ratio: 1.5}, pusher={**all_of_them, ratio: 1.6}) == "counting"
    unknown = {**all_of_them, ratio: float("nan")}
    assert best(counting={**unknown, time: 0.5}, pusher={**unknown, time: 0.4}) == "pusher"
    assert best(counting=all_of_them, pusher={"successes": 7}) == "counting"


def test_any_table_of_episodes(basic):
    """A group is any choice of labels, and a difference that of two policies on the same seeds."""
    tasks = table(basic.main, by=["task"], columns=lambda some: {"rate": some["success"].mean(), "count": len(some)})
    assert tasks["task"].tolist() == ["Transport", "Align"] and tasks["count"].tolist() == [24, 24]
    first, second = (where(basic.main, task="Transport", policy=name) for name in ("pusher", "still <&>"))
    assert tasks["rate"][0] == where(basic.main, task="Transport")["success"].mean()
    gap = difference(first, second, resamples=200)
    assert gap["success"].value == first["success"].mean() and gap["both"] == 0 and np.isnan(gap["time"].value)
    assert gap["iqm"].value < 0.0  # a failure counts as the longest episode
    with pytest.raises(ValueError, match="the same episodes"):
        difference(first, second.iloc[1:])


def test_json_holds_everything(written, written_several):
    def refuse(constant):
        raise AssertionError(f"{constant} is not JSON")

    plain, several = (
        json.loads((directory / "results.json").read_text(encoding="utf-8"), parse_constant=refuse)
        for directory in (written, written_several)
    )
    assert plain["seeds"] == list(range(300, 308)) and plain["settings"]["tasks"] == ["Transport", "Align"]
    assert plain["versions"]["numpy"] == np.__version__ and plain["versions"]["vibgym"] and "commit" in plain
    assert [len(plain[name]) for name in ("results", "comparisons", "episodes")] == [6, 6, 48]
    assert plain["results"][0]["time_to_goal_median_s"] is None
    assert plain["tasks"]["Align"]["position_tolerance"] == 0.002
    assert several["hardware"]["ideal"] == {} and several["hardware"]["broken"] == {"actuators": BROKEN}
    assert several["settings"]["policies"]["still"]["hardware"] == ["ideal"]
    effects = several["effects"]
    assert effects["seeds"] == list(range(300, 304)) and effects["cases"] == CASES and len(effects["episodes"]) == 24


def test_csv_files(basic, several, written, written_several):
    for results, directory in ((basic, written), (several, written_several)):
        summary, episodes = (rows_of(directory / name) for name in ("results.csv", "episodes.csv"))
        assert [(row["task"], row["hardware"], row["policy"]) for row in summary] == [
            case.place[1:] for case in results.cases if case.place.study == "report"
        ]
        assert len(episodes) == len(results.main)
        for name in ("position_error_m", "collisions", "throughput_parts_per_s", "clearance_m", "time_to_goal_s"):
            np.testing.assert_array_equal([float(row[name] or "nan") for row in episodes], results.main[name])
        for row in summary:
            some = where(results.main, **{key: row[key] for key in ("task", "hardware", "policy")})
            figures = {
                "episodes": len(some),
                "success_rate": some["success"].mean(),
                "collisions_mean": some["collisions"].mean(),
                "throughput_median_parts_per_s": some["throughput_parts_per_s"].median(),
                "clearance_median_m": some["clearance_m"].median(),
                "time_over_bound_median": some["time_over_bound"].median(),
            }
            for name, value in figures.items():
                assert float(row[name] or "nan") == pytest.approx(value, nan_ok=True)
        assert {row[key] for row in episodes for key in ("good_per_minute", "pattern_error_m", "coverage")} == {""}
    # Policies that are objects are not recorded.
    names = {"episodes.csv", "report.html", "results.csv", "results.json"}
    assert {path.name for path in written.iterdir()} == names
    # Tasks with the same figures stand together.
    tables = report.write(several, quiet=True)[1].split("\n\n")
    assert [("throughput" in table, "Sort" in table) for table in tables] == [
        (False, False),
        (True, True),
        (False, False),
    ]
    lines = tables[0].splitlines()
    assert lines[0].startswith("| task | hardware | policy |")
    assert lines[4].startswith("| Transport | broken | pusher | 0.0 % (")


# -- settings ----------------------------------------------------------------------------------------------------------


def settings(**changes):
    return EvaluationSettings.checked(
        {"tasks": ["Transport", "Sort"], "policies": ["zero"], "first_seed": 9, **changes}
    )


def test_episodes_of_a_task():
    some = settings(episodes=5, task_episodes={"Sort": 2})
    assert some.seed_list() == some.seed_list("Transport") == [9, 10, 11, 12, 13]
    assert some.seed_list("Sort") == [9, 10]
    some = settings(first_seed=None, seeds=[7, 3, 5], task_episodes={"Sort": 1})
    assert some.seed_list("Transport") == [7, 3, 5] and some.seed_list("Sort") == [7]
    assert len(settings().seed_list("Sort")) == 100
    # The command line's are those of all tasks, at most those of the hardware and of the study.
    for episodes, broken, effects in ((5, 4, 4), (3, 3, 3)):
        cases = prepare(EvaluationSettings.checked(SEVERAL, episodes)).cases
        main = {case.place[1:3]: len(case.seeds) for case in cases if case.place.study == "report"}
        assert main["Sort", "ideal"] == main["Transport", "late"] == episodes and main["Transport", "broken"] == broken
        assert {len(case.seeds) for case in cases if case.place.study == "effects"} == {effects}


def test_a_policy_runs_on_its_tasks_or_on_all_that_it_serves():
    policies = [
        "open_loop",
        {"name": "mine", "policy": Pusher(), "tasks": ["Transport"]},
        Counting(),
        {"kind": "local_field", "name": "local_fields", "tasks": ["Sort"]},
        {"policy": Still(), "action": "field", "name": "with its action"},
        "zero",
    ]
    served = {
        "Transport": ["open_loop", "mine", "counting", "with its action", "zero"],  # what an object serves is not known
        "Sort": ["counting", "local_fields", "with its action", "zero"],
    }
    pairs = [case.place[1::2] for case in prepare(settings(policies=policies)).cases]
    assert pairs == [(task, name) for task, names in served.items() for name in names]


def test_hardware_replaces_arguments_of_the_environment():
    environment = {"surface": "prototype", "actuators": "ideal", "randomize": {"parts": [1, 3], "friction": [1, 2]}}
    over = laid_over(environment, {"actuators": BROKEN, "randomize": {"friction": [0.9, 1.1]}})
    assert over == {"surface": "prototype", "actuators": BROKEN, "randomize": {"parts": [1, 3], "friction": [0.9, 1.1]}}
    assert laid_over({"randomize": {"parts": [1, 3]}}, {"randomize": None}) == {"randomize": None}
    noisy = {"kind": "pose", "noise": [0.1, 0.2], "estimator": "none"}
    assert with_sensor({"sensor": noisy}, {"estimator": "model"})["sensor"] == {**noisy, "estimator": "model"}
