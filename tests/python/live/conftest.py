"""For all tests of live code."""

import pytest

from granular_id.live import signals


@pytest.fixture(autouse=True)
def nothing_moves(monkeypatch):
    """Forget what an earlier test has left in motion."""
    monkeypatch.setattr(signals, "MOVING", set())
