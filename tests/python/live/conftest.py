"""For all tests of live code."""

import pytest

from granular_id.live import signals, supervisor
from world import World


@pytest.fixture(autouse=True)
def nothing_moves(monkeypatch):
    """Forget what an earlier test has left in motion, and heard of signals."""
    for name, kind in (("_HEARD", list), ("_STOPPED", list), ("MOVING", set)):
        monkeypatch.setattr(signals, name, kind())


@pytest.fixture
def w(monkeypatch):
    """A bench whose arm goes back within a second."""
    monkeypatch.setattr(supervisor, "_BACK_S", 1.5)
    world = World()
    world.arm.goes_back()
    return world
