"""No view holds up a capture, and one that breaks is left out and named."""

from threading import Event

import pytest

from granular_id.live import Views, view as view_module
from granular_id.live.snapshot import Snapshot


class Remembering:
    """Keeps what it shows; may be held, and may break."""

    def __init__(self, error=None):
        self.shown, self.n_closed, self.error = [], 0, error
        self.reached, self.released = Event(), Event()
        self.released.set()

    def show(self, snapshot):
        self.reached.set()
        assert self.released.wait(30)
        if self.error is not None:
            raise self.error
        self.shown.append(snapshot)

    def close(self):
        self.n_closed += 1


def test_publish_slow_view_shows_the_newest_of_each_state():
    view = Remembering()
    view.released.clear()
    with Views([view]) as views:
        views.publish(Snapshot("idle"))
        assert view.reached.wait(30)
        for state in ("armed", "triggered", "complete"):
            for k in range(1000):
                views.publish(Snapshot(state, time_s=float(k)))
        assert view.shown == []
        view.released.set()
    states = [(snapshot.state, snapshot.time_s) for snapshot in view.shown]
    assert states == [("idle", None), ("armed", 999.0), ("triggered", 999.0), ("complete", 999.0)]
    assert (view.n_closed, views.errors) == (1, ())


def test_view_that_raises_is_left_out_closed_and_named_to_others():
    broken, whole = Remembering(OSError("the disk is full")), Remembering()
    with Views([broken, whole]) as views:
        views.publish(Snapshot("armed", warnings=("gap",)))
        views.publish(Snapshot("complete", warnings=("gap",)))
    why = "Remembering has stopped: the disk is full"
    assert views.errors == (why,)
    assert whole.shown[-1].warnings == ("gap", why)
    assert (broken.n_closed, whole.n_closed) == (1, 1)


def test_view_that_is_stuck_at_the_end_is_left_behind_and_named(monkeypatch):
    monkeypatch.setattr(view_module, "_PATIENCE_S", 0.01)
    view = Remembering()
    view.released.clear()
    with Views([view]) as views:
        views.publish(Snapshot("idle"))
        assert view.reached.wait(30)
    view.released.set()
    assert views.errors == ("Remembering is stuck",)


@pytest.mark.parametrize("n_views", [0, 1])
def test_snapshots_are_wanted_ten_times_a_second_by_somebody(monkeypatch, n_views):
    now_s = 100.0
    monkeypatch.setattr(view_module.time, "monotonic", lambda: now_s)
    views, n_wanted = Views([Remembering()] * n_views), 0
    for step in range(2048):
        now_s = 100.0 + step / 1024
        if views.wants_snapshot():
            n_wanted += 1
            views.publish(Snapshot("idle"))
    assert n_wanted == 20 * n_views
