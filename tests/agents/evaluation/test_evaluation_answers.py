"""The report's first screen: which policy is best of each task, by how much, and what is still open."""

import dataclasses
import re

from agents.evaluation.records import Row

from agents.evaluation.report import answers, report_page


def changed(found, task, policy, **values):
    """The same results, with other statistics of a policy on a task."""
    rows = [Row(**{**vars(row), **values}) if (row.task, row.policy) == (task, policy) else row for row in found.rows]
    return dataclasses.replace(found, rows=tuple(rows))


def test_best_is_who_succeeds_most_and_of_equals_the_fastest(found):
    both = changed(found, "Transport", "counting", successes=8, success_rate=1.0, time_over_bound_median=1.5)
    slow = changed(both, "Transport", "pusher", successes=8, success_rate=1.0, time_over_bound_median=1.6)
    assert answers.best_row(slow, "Transport", "ideal").policy == "counting"
    nan = float("nan")
    unknown = changed(slow, "Transport", "counting", time_over_bound_median=nan, time_to_goal_median_s=0.5)
    unknown = changed(unknown, "Transport", "pusher", time_over_bound_median=nan, time_to_goal_median_s=0.4)
    assert answers.best_row(unknown, "Transport", "ideal").policy == "pusher", "where no bound is known, time decides"
    fast = changed(slow, "Transport", "pusher", time_over_bound_median=1.4)
    assert answers.best_row(fast, "Transport", "ideal").policy == "pusher"
    failing = changed(fast, "Transport", "pusher", successes=7, success_rate=7 / 8)
    assert answers.best_row(failing, "Transport", "ideal").policy == "counting"


def test_every_cell_says_its_figures(found):
    told = answers.answers(found)
    assert told["policies"] == list(found.policies) and [each["hardware"] for each in told["tables"]] == ["ideal"]
    for line in told["tables"][0]["rows"]:
        for name, cell in zip(told["policies"], line["cells"], strict=True):
            (row,) = [row for row in found.rows if (row.task, row.policy) == (line["task"], name)]
            assert float(cell["large"].removesuffix(" %")) == round(100 * row.success_rate, 1)
            assert cell["small"] == (f"{row.time_over_bound_median:.2f} ×" if row.successes else "")
            assert cell["to"] == answers.anchor(row) and " " not in cell["to"]
        assert sum(cell["best"] for cell in line["cells"]) == 1
    assert [each["row"].task for each in told["best"]] == ["Transport", "Align"]


def test_open_is_what_no_policy_does_well(found):
    well = changed(found, "Transport", "pusher", successes=8, success_rate=0.95)
    poor = changed(found, "Transport", "pusher", successes=8, success_rate=0.9499)
    for results, is_open in ((well, False), (poor, True)):
        assert ("Transport" in [each["row"].task for each in answers.answers(results)["open"]]) is is_open


def test_the_page_begins_with_the_answers(found, written):
    text = (written / "report.html").read_text(encoding="utf-8")
    assert text.index('id="answers"') < text.index('id="best"') < text.index('id="open"') < text.index('id="asked"')
    assert text.index('id="asked"') < text.index('id="results"')
    for row in found.rows:
        assert text.count(f'id="{report_page.anchor(row)}"'.replace("<&>", "&lt;&amp;&gt;")) == 1
    assert len(re.findall(r'<td data-sort="[^"]+" style="[^"]+" class="best">', text)) == 2
