"""Seeded rollouts of policies on tasks, their statistics, and the report."""

from agents.evaluation.log import Rollout
from agents.evaluation.records import Trial
from agents.evaluation.report.effects import Effects
from agents.evaluation.report.evaluate import evaluate, write
from agents.evaluation.report.prepare import Evaluation, Gif, prepare
from agents.evaluation.report.results import Results
from agents.evaluation.report.texts_of_results import summary_table
from agents.evaluation.settings import EvaluationSettings, load_settings, settings_from

__all__ = [
    "Effects",
    "Evaluation",
    "EvaluationSettings",
    "Gif",
    "Results",
    "Rollout",
    "Trial",
    "evaluate",
    "load_settings",
    "prepare",
    "settings_from",
    "summary_table",
    "write",
]
