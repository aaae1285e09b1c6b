"""A suite of tasks as one benchmark: a score between nothing and the bound for each, and one for all of them."""

from agents.evaluation.suite.output import summary, write
from agents.evaluation.suite.run import Suite, prepare, score
from agents.evaluation.suite.settings import SuiteSettings, load_settings, settings_from

__all__ = ["Suite", "SuiteSettings", "load_settings", "prepare", "score", "settings_from", "summary", "write"]
