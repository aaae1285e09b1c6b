"""Evaluation of policies on seeded episodes: reports, comparisons, scores, verification of published results, data sheets.

One path: settings -> cases (:mod:`.run`) -> one table of episodes (:mod:`.table`) -> statistics (:mod:`.statistics`) -> a view
(:mod:`.report`, :mod:`.compare`, :mod:`.score`, :mod:`.published`, :mod:`.verify`, :mod:`.datasheet`).
"""

from agents.evaluation.films import Rollout
from agents.evaluation.report import Gif, prepare, summary_table, write
from agents.evaluation.run import Case, Prepared, Results, evaluate
from agents.evaluation.settings import EvaluationSettings, load_settings, settings_from

__all__ = [
    "Case",
    "EvaluationSettings",
    "Gif",
    "Prepared",
    "Results",
    "Rollout",
    "evaluate",
    "load_settings",
    "prepare",
    "settings_from",
    "summary_table",
    "write",
]
