"""An evaluation as one page of HTML, and as files of figures."""

from granular_id.evaluation.report.files import figures
from granular_id.evaluation.report.page import report

__all__ = ["figures", "report"]
