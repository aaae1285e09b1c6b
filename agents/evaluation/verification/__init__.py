"""Published results: what a report found, kept in the repository, and whether it is found again."""

from agents.evaluation.verification.differences import differences, versions_apart
from agents.evaluation.verification.output import figures_csv, report_of
from agents.evaluation.verification.publish import publish
from agents.evaluation.verification.published import Published, load_published
from agents.evaluation.verification.sample import Asked
from agents.evaluation.verification.verify import Verification, verify

__all__ = [
    "Asked",
    "Published",
    "Verification",
    "differences",
    "figures_csv",
    "load_published",
    "publish",
    "report_of",
    "verify",
    "versions_apart",
]
