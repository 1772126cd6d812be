"""An evaluation as one page of HTML, and as files of figures."""

from __future__ import annotations

from granular_id.report.figures import FIGURES, figures
from granular_id.report.page import report

__all__ = ["FIGURES", "figures", "report"]
