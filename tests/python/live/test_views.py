"""No view holds up a capture, and one that breaks is not missed in silence."""

import threading

import pytest

from granular_id.live import BackgroundView, Snapshot, Views
from granular_id.live.view import MAX_HZ


class Remembering(BackgroundView):
    """Keeps what it shows; may be held, and may break."""

    def __init__(self, *, broken=False, **options):
        self.shown, self.finished, self.broken = [], 0, broken
        self.reached, self.released = threading.Event(), threading.Event()
        self.released.set()
        super().__init__("remembering view", **options)

    def show(self, snapshot):
        self.reached.set()
        self.released.wait(30)
        if self.broken:
            raise OSError("the disk is full")
        self.shown.append(snapshot)

    def finish(self):
        self.finished += 1


def held(**options):
    """Return a view that has taken one snapshot, and will not come back."""
    view = Remembering(**options)
    view.released.clear()
    view.publish(Snapshot("idle"))
    assert view.reached.wait(10)
    return view


def snapshots(n):
    return [Snapshot("triggered", time_s=float(i)) for i in range(n)]


def test_the_last_snapshot_is_shown_before_closing_and_none_after_it():
    with Remembering(waiting=2000) as view:
        for snapshot in snapshots(1000):
            view.publish(snapshot)
    assert [snapshot.time_s for snapshot in view.shown] == list(range(1000))
    view.close()
    assert (view.finished, view.dropped) == (1, 0)
    with pytest.raises(RuntimeError, match="is closed"):
        view.publish(Snapshot("idle"))


def test_a_stuck_view_takes_nothing_of_the_publisher_and_drops_are_counted():
    view = held(waiting=3)
    for snapshot in snapshots(1000):
        view.publish(snapshot)
    view.released.set()
    view.close()
    assert [snapshot.time_s for snapshot in view.shown] == [None, 997.0, 998.0, 999.0]
    assert view.dropped == 997


def test_a_view_that_stays_stuck_is_left_behind_and_told():
    view = held(patience_s=0.05)
    with Views([view]) as views:
        pass
    assert views.complaints == ("the remembering view was stuck, and not waited for after 0.05 s",)
    view.released.set()
    view._thread.join(10)
    assert view.finished == 1


def test_a_broken_view_is_left_out_and_closed_at_the_end_and_the_others_say_so():
    why = ("the remembering view has stopped: the disk is full",)
    broken, whole = Remembering(broken=True), Remembering(waiting=1000)
    with Views([broken]) as views:
        views.add(whole)
        views.publish(Snapshot("idle"))
        broken._thread.join(10)
        for snapshot in snapshots(2):
            views.publish(snapshot)
        assert views.complaints == why
    assert views.complaints == whole.shown[-1].warnings == why
    assert broken.finished == whole.finished == 1
    with pytest.raises(RuntimeError, match="the disk is full"):
        broken.close()


def test_what_breaks_at_the_end_is_told():
    with Views([Remembering(broken=True)]) as views:
        views.publish(Snapshot("idle"))
    assert views.complaints == ("the remembering view has stopped: the disk is full",)


def test_snapshots_are_wanted_at_most_thirty_times_a_second(monkeypatch):
    now = 100.0
    monkeypatch.setattr("granular_id.live.view.time.monotonic", lambda: now)
    with Views([Remembering(waiting=1000)]) as views:
        wanted = 0
        for step in range(2000):  # two seconds of a loop that turns every millisecond
            now = 100.0 + step / 1000
            if views.wants_snapshot():
                wanted += 1
                views.publish(Snapshot("idle"))
    assert 55 <= wanted <= 2 * MAX_HZ
    assert not views.wants_snapshot()  # nobody is left


@pytest.mark.parametrize("rate", [0, -1, 31, float("nan"), "10"])
def test_no_view_is_faster(rate):
    for make in (Remembering, lambda **options: Views([], **options)):
        with pytest.raises((ValueError, TypeError), match="max_hz must be"):
            make(max_hz=rate)


def test_views_are_idle_when_all_is_shown_not_while_one_draws():
    view = held()
    with Views([view]) as views:
        assert not views.are_idle
        view.released.set()
        view.close()
        assert views.are_idle
