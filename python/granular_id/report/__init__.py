"""An evaluation as one page of HTML."""

from granular_id.report.page import write

__all__ = ["write"]
