"""The time left: told from what partitions took, and never a fifth more than what was told."""

import pytest

from granular_id._progress import in_words
from granular_id.evaluation import telling
from granular_id.evaluation.telling import Run, Teller


@pytest.fixture
def clock(monkeypatch):
    """A clock that stands still until it is moved."""
    now = [0.0]
    monkeypatch.setattr(telling, "monotonic", lambda: now[0])

    def pass_by(seconds):
        now[0] += seconds

    return pass_by


def teller_of(*runs):
    return Teller([Run(*run) for run in runs])


def done(teller, clock, run, seconds):
    teller.begin(teller.runs[run])
    for _ in range(teller.runs[run].n_partitions):
        clock(seconds)
        teller.tick("a partition")


def test_nothing_is_told_before_every_space_was_measured(clock):
    teller = teller_of(("raw", "session", 2), ("best", "session", 2))
    assert teller.left() is None
    done(teller, clock, 0, 1.0)
    assert teller.left() is None


def test_a_space_takes_as_long_again_under_the_next_protocol(clock):
    teller = teller_of(
        ("raw", "session", 2), ("best", "session", 2), ("raw", "matched", 2), ("best", "matched", 2)
    )
    done(teller, clock, 0, 1.0)
    done(teller, clock, 1, 10.0)
    assert teller.left() == pytest.approx(2 * 1.0 + 2 * 10.0)


def test_controls_count_as_the_cheapest_space(clock):
    teller = teller_of(("raw", "session", 2), ("best", "session", 2), ("rest", "", 3))
    done(teller, clock, 0, 1.0)
    done(teller, clock, 1, 10.0)
    assert teller.left() == pytest.approx(3.0)


def test_what_was_told_grows_by_a_fifth_at_most(clock):
    teller = teller_of(("raw", "session", 10), ("raw", "matched", 10))
    teller.begin(teller.runs[0])
    clock(1.0)
    teller.tick("a partition")
    assert teller.left() == pytest.approx(19.0)
    clock(99.0)
    teller.tick("a slow partition")
    assert teller.left() == pytest.approx(1.2 * 19.0)


@pytest.mark.parametrize(("seconds", "words"), [(3.2, "3 s"), (89.0, "89 s"), (120.0, "2 min")])
def test_a_time_is_told_in_a_unit_that_fits(seconds, words):
    assert in_words(seconds) == words


def test_every_line_of_a_log_is_told_even_where_no_bar_is(capsys):
    with Teller([Run("raw", "session", 1)]).shown(True) as teller:
        teller.tell("held-out sessions  raw  91.2 %")
    assert capsys.readouterr().err == "held-out sessions  raw  91.2 %\n"
