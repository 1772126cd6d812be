"""Checks of a data set: each takes what was measured of the recordings and yields findings; `run.py` lists them."""

from __future__ import annotations

from granular_id.recording.checks.report import CheckReport, Finding

__all__ = ["CheckReport", "Finding"]
