"""Seeded rollouts of policies on tasks, their statistics, and the report."""

from agents.evaluation.effects import Effects
from agents.evaluation.evaluate import evaluate, write
from agents.evaluation.jobs import Evaluation, Gif, prepare
from agents.evaluation.log import Rollout
from agents.evaluation.results import Results, Trial
from agents.evaluation.settings import EvaluationSettings, load_settings, settings_from
from agents.evaluation.tables import summary_table

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
