"""Learned, hybrid and classical policies on the same seeds: intervals, paired differences, profiles, curves, generalisation."""

from agents.evaluation.comparison.compare import compare, write
from agents.evaluation.comparison.contenders import ComparisonSettings, load_settings, settings_from
from agents.evaluation.comparison.prepare import Prepared, prepare
from agents.evaluation.comparison.results import Comparison
from agents.evaluation.comparison.texts import summary_table

__all__ = [
    "Comparison",
    "ComparisonSettings",
    "Prepared",
    "compare",
    "load_settings",
    "prepare",
    "settings_from",
    "summary_table",
    "write",
]
