"""Evaluation of policies on seeded episodes: reports, comparisons, scores, verification of published results, data sheets.

One path: settings -> cases (:mod:`.plan`) -> one table of episodes (:mod:`.run`, :mod:`.table`) -> statistics
(:mod:`.statistics`) -> a view (:mod:`.report`, :mod:`.score`, :mod:`.published`, :mod:`.verify`). Data sheets are measurements
of their own (:mod:`.datasheet`)::

    settings = EvaluationSettings.checked({"tasks": ["Align"], "policies": ["pose", "zero"], "episodes": 20})
    episodes = run(cases(settings))
    table(episodes, by=["task", "policy"])
"""

from agents.evaluation.plan import cases, prepare
from agents.evaluation.run import Case, Prepared, Results, evaluate, run
from agents.evaluation.score import score
from agents.evaluation.settings import ComparisonSettings, EvaluationSettings, SuiteSettings
from agents.evaluation.table import difference, table
from agents.evaluation.verify import check

__all__ = [
    "Case",
    "ComparisonSettings",
    "EvaluationSettings",
    "Prepared",
    "Results",
    "SuiteSettings",
    "cases",
    "check",
    "difference",
    "evaluate",
    "prepare",
    "run",
    "score",
    "table",
]
