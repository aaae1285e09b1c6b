"""One printable page that says what a surface does with a part: ``python -m agents datasheet [CONFIG.yaml]``."""

from agents.evaluation.datasheet.measure import Sheet, measure
from agents.evaluation.datasheet.page import PAGE, summary, write
from agents.evaluation.datasheet.settings import DatasheetSettings, load_settings, settings_from

__all__ = ["PAGE", "DatasheetSettings", "Sheet", "load_settings", "measure", "settings_from", "summary", "write"]
