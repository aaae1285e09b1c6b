"""Learned, hybrid and classical policies on the same seeds: intervals, paired differences, profiles, curves, generalisation."""

from agents.comparison.compare import compare, write
from agents.comparison.jobs import Prepared, prepare
from agents.comparison.results import Comparison
from agents.comparison.settings import ComparisonSettings, load_settings, settings_from
from agents.comparison.tables import summary_table

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
