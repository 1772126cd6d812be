"""URLs of sources, what sources say of themselves, and sources that die."""

from __future__ import annotations

import threading
from functools import partial

import numpy as np
import pytest

from granular_id.io import save
from granular_id.live.replay import ReplaySource
from granular_id.live.robot import ManualRobot
from granular_id.live.setup import setup_of
from granular_id.live.sim import SimSource
from granular_id.live.source import Health, Pace, SourceInfo, SourceUrl, ThreadedSource, open_source
from granular_id.live.stream import opened
from granular_id.recording import Dataset, Recording, SampleFlag
from granular_id.synthetic import synthesize
from sink_cases import begun, rows_in, rows_of


@pytest.mark.parametrize(
    ("url", "options", "match"),
    [
        ("rice", {}, "names no source"),
        ("sim:rice?speed", {}, "cannot be read"),
        ("rdt://host:99999", {}, "cannot be read"),
        ("sim:rice?speed=2", {"speed": 3}, "option 'speed' .* is given twice"),
        ("sim:rice?sped=1", {}, "no option 'sped'; known: rate_hz, seed, speed"),
        ("sim:rice?speed=fast", {}, "'sim:rice.speed=fast': option speed='fast'; wanted a number"),
        ("sim:ryce", {}, "url 'sim:ryce': materials has no material 'ryce'; known: dry peas, rice"),
        ("rdt://box?http_port=70000", {}, "http_port must be at most 65535"),
        ("rdt:/?variant=onrobot", {}, "no host"),
        ("rdt://box/x", {}, "the path '/x'"),
        ("rdt://box?variant=onrobot&rate_hz=300", {}, "whole number of milliseconds"),
    ],
)
def test_open_source_bad_url_is_refused(url, options, match):
    with pytest.raises((ValueError, TypeError, ImportError), match=match):
        open_source(url, **options)


def test_open_source_options_in_url_and_by_keyword_are_the_same():
    one = open_source("sim:fine%20sugar?seed=3&speed=7&rate_hz=250").info
    other = open_source("sim:fine_sugar", seed=3, speed=7, rate_hz=250).info
    assert one == other
    assert (one.rate_hz, one.speed, one.meta["seed"]) == (250.0, 7.0, 3)


def test_source_url_parts_are_decoded():
    url = SourceUrl.parse("RDT://Host.local:49152?variant=axia", {})
    assert (url.scheme, url.host, url.port, url.path) == ("rdt", "Host.local", 49152, "")
    assert SourceUrl.parse("replay:C%3F/a b.npz", {}).path == "C?/a b.npz"
    assert SourceUrl.parse("ros2://ft_sensor/Wrench", {}).path == "/Wrench"


@pytest.mark.parametrize(("name", "value"), [("name", ""), ("rate_hz", 0), ("full_scale", (1, 2, 3))])
def test_source_info_bad_value_is_refused(name, value):
    with pytest.raises(ValueError, match=name):
        SourceInfo(**{"name": "x", "rate_hz": 500, "device_clock": True, name: value})


class Counting(ThreadedSource):
    """Some rows, and then an end or a fault; or it waits to be stopped."""

    def __init__(self, n=10, error=None, wait_s=0.0, value=1.0):
        super().__init__(SourceInfo("counting", 500, device_clock=False))
        self._n, self._fault, self._wait_s, self._value = n, error, wait_s, value

    def deliver(self, buffer, stopping):
        for _ in range(self._n):
            buffer.push([self._value] * 6)
        if self._fault is not None:
            raise self._fault
        stopping.wait(self._wait_s)


def ended(source):
    """Wait for the end of its thread."""
    source._thread.join(20)
    return source.health()


def test_threaded_source_end_and_fault_are_in_its_health():
    source, dying = Counting(), Counting(error=OSError("unplugged"))
    assert source.health() == Health(running=False)
    buffer = begun(source)
    assert ended(source) == Health(running=False, finished=True)
    assert buffer.stats()["written"] == 10
    begun(dying)
    assert ended(dying) == Health(running=False, error="OSError: unplugged")
    for used in (source, dying):
        used.stop()
        with pytest.raises(RuntimeError, match="counting runs once"):
            used.start(buffer)


def test_threaded_source_hanging_driver_is_logged(monkeypatch, caplog):
    release, source = threading.Event(), Counting(1)
    deliver = source.deliver
    source.deliver = lambda buffer, stopping: deliver(buffer, release) or release.wait(20)
    monkeypatch.setattr("granular_id.live.source._STOP_S", 0.01)
    with pytest.raises(ZeroDivisionError), opened(source):  # what happened is not replaced
        raise ZeroDivisionError
    assert source._thread.daemon
    assert "counting did not stop within 0.01 s: its driver hangs" in caplog.text
    release.set()
    assert not ended(source).running


def test_pace_out_of_reach_makes_the_clock_wait(monkeypatch):
    now = [10**9]
    monkeypatch.setattr("granular_id.live.source.host_ns", lambda: now[0])
    real, fast = (Pace(SourceInfo("x", 500, device_clock=True, speed=speed)) for speed in (1, 1000))
    assert (real.due(0), fast.due(0)) == (1, 1)
    now[0] += 10**9
    assert (real.due(1), fast.due(1)) == (50, 50_000)
    assert (real.due(51), fast.due(50_001)) == (50, 0), "the rest is made up for, or comes later"
    now[0] += 10**6
    assert fast.due(50_001) == 500


SHORT = {"first_row_s": 0.1}


@pytest.mark.parametrize(
    ("source", "options", "error", "match"),
    [
        (partial(Counting, 0, wait_s=20), SHORT, TimeoutError, r"nothing within 0\.1 s$"),
        (partial(Counting, 3, wait_s=20, value=np.nan), SHORT, TimeoutError, "3 rows with NaN .* left"),
        (partial(Counting, 0), {}, ConnectionError, "counting came to its end before its first row"),
        (partial(Counting, 0, OSError("no route")), {}, ConnectionError, "counting: OSError: no route"),
        (int, {}, TypeError, "source must be a URL or have info, start, stop and health, got int"),
    ],
)
def test_opened_source_without_rows_is_refused(source, options, error, match):
    with pytest.raises(error, match=match), opened(source(), **options):
        pass


def test_replay_gives_the_samples_back(tmp_path):
    data = synthesize(["rice", "fine sugar"], n_per_class=2, duration_s=0.4)
    flags = np.where(np.arange(200) == 7, SampleFlag.SATURATED, 0)
    data = Dataset([*data[:3], Recording(data[3].wrench, rate_hz=500, label="fine sugar", flags=flags)])
    source = open_source(f"replay:{save(data, tmp_path / 'set.npz')}?speed=50&pause_s=0.1")
    info = source.info
    assert (info.name, info.synthetic, info.rate_hz) == ("replay of 4 recordings", True, 500)
    assert info.repeats
    assert source.replays
    rows, epochs = rows_in(begun(source), 800)
    assert ended(source).finished
    assert np.array_equal(rows.wrench, np.concatenate([r.wrench for r in data]))
    assert np.flatnonzero(rows.flags).tolist() == [607]
    starts = np.arange(4) * 0.5
    assert np.allclose(rows.time_s.reshape(4, 200), starts[:, np.newaxis] + np.arange(200) / 500)
    assert epochs == [200] * 4, "silence is no loss"
    labels = [source.truth_at(time_s) for time_s in (0.0, 0.498, 0.5, 1.5)]
    assert labels == [data[n].label for n in (0, 0, 1, 3)]


def test_replay_is_paced_and_stops():
    source = ReplaySource(synthesize(["rice"], n_per_class=1, duration_s=0.4), speed=0.001)
    assert len(rows_of(source, 1)) < 200


@pytest.mark.parametrize(
    ("other", "match"),
    [
        ({"time_s": [0, 0.1, 0.3]}, "irregularly sampled"),
        ({"rate_hz": 100}, r"differ in rate .* \.resample"),
        ({"rate_hz": 500, "axes": ("fx", "fz")}, r"\.select\(axes="),
    ],
)
def test_replay_without_common_rate_or_axes_is_refused(other, match):
    n_axes = len(other.get("axes", range(6)))
    odd = Recording(np.zeros((3, n_axes)), label="a", **other)
    fast = Recording(np.zeros((3, 6)), rate_hz=500, label="a")
    with pytest.raises(ValueError, match=match):
        ReplaySource(Dataset([fast, odd]))


DATA = synthesize(["rice"], n_per_class=2, duration_s=0.4)
BARE = Dataset([Recording(one.wrench, rate_hz=500, label="rice") for one in DATA])


@pytest.mark.parametrize(
    ("source", "robot", "trigger", "name"),
    [
        (SimSource("rice", seed=1), "none", "manual", "manual"),
        (SimSource("rice", seed=1), ManualRobot(), "auto", "force"),
        (ReplaySource(DATA), "auto", "auto", "time"),  # it knows where each motion began
        (ReplaySource(BARE), "auto", "auto", "force"),
    ],
)
def test_setup_of_trigger_follows_from_source_and_robot(source, robot, trigger, name):
    setup = setup_of(source, robot, trigger)
    assert setup.trigger().name == name
    assert setup.robot is (None if isinstance(robot, str) else robot)
