"""An evaluation as one page of HTML, and as files of figures."""

from __future__ import annotations

from granular_id.report.page import write
from granular_id.report.pictures import FIGURES, figures

__all__ = ["FIGURES", "figures", "write"]
