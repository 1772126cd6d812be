"""How far the work is: a bar on a terminal, a line now and then elsewhere, with the time that is left."""

import io
import sys

import pytest

from granular_id._progress import Ticker, showing


class Clock:
    """Seconds that pass by hand."""

    now = 1000.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr("granular_id._progress.monotonic", clock)
    return clock


class Screen(io.StringIO):
    def isatty(self):
        return True


def work(clock, steps, seconds):
    with showing(True) as callback:
        ticker = Ticker(steps, callback)
        for step in range(steps):
            clock.now += seconds
            ticker.tick(f"model {step}")


def test_a_line_now_and_then_without_a_terminal(clock, capfd):
    work(clock, 76, 12.0)
    lines = capfd.readouterr().err.splitlines()
    assert lines[:2] == ["3 of 76, about 15 min left: model 2", "6 of 76, about 14 min left: model 5"]
    assert lines[-1] == "75 of 76, about 12 s left: model 74"
    assert len(lines) == 25


@pytest.mark.parametrize(("seconds", "left"), [(31, "31 s"), (200, "3 min"), (7000, "2 h")])
def test_long_steps_get_a_line_each(clock, capfd, seconds, left):
    work(clock, 2, seconds)
    assert capfd.readouterr() == ("", f"1 of 2, about {left} left: model 0\n")


def test_short_work_and_work_in_silence_say_nothing(clock, capfd):
    work(clock, 20, 1.0)
    with showing(False) as callback:
        assert callback is None
    assert capfd.readouterr() == ("", "")


def test_bar_has_the_time_left_where_the_total_is_known(clock, monkeypatch):
    screen = Screen()
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setattr("rich.console.monotonic", clock)
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setenv("TERM", "xterm")
    with showing(True) as callback:
        for step in (1, 2, 3):
            clock.now += 40.0
            callback(step, 5, f"model {step}")
    with showing(True) as callback:
        callback(2048, 0, "recordings")
    assert "0:01:20" in screen.getvalue()
    assert "2048/?" in screen.getvalue()
