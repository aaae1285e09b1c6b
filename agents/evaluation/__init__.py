"""Seeded rollouts of policies on tasks, their statistics, and the report."""

from agents.evaluation.evaluate import Evaluation, Gif, evaluate, prepare, write
from agents.evaluation.results import Results
from agents.evaluation.rollout import Rollout
from agents.evaluation.settings import EvaluationSettings, load_settings, settings_from
from agents.evaluation.tables import summary_table

__all__ = [
    "Evaluation",
    "EvaluationSettings",
    "Gif",
    "Results",
    "Rollout",
    "evaluate",
    "load_settings",
    "prepare",
    "settings_from",
    "summary_table",
    "write",
]
