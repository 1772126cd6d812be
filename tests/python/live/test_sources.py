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
from granular_id.live.source import Health, Pace, SourceInfo, ThreadedSource, WrenchSource, open_source
from granular_id.live.source_url import SourceUrl
from granular_id.live.stream import opened
from granular_id.recording import Dataset, Recording, SampleFlag
from granular_id.synthetic import synthesize
from sink_cases import Sink


@pytest.mark.parametrize(
    ("url", "options", "match"),
    [
        ("rice", {}, "names no source"),
        ("sim:", {}, "names no source"),
        ("simm:rice", {}, "has the scheme 'simm'; known: bota, rdt, replay, ros2, sim, ur"),
        ("sim:rice?speed", {}, "cannot be read"),
        ("rdt://host:99999", {}, "cannot be read"),
        ("sim:rice?speed=2", {"speed": 3}, "option 'speed' .* is given twice"),
        ("sim:rice?sped=1", {}, "has no option 'sped'; known: materials, rate_hz, seed, session, speed"),
        ("sim:rice?speed=fast", {}, "option speed='fast' of url .*; wanted a number above 0"),
        ("sim:rice?speed=nan", {}, "wanted a number above 0"),
        ("sim:rice", {"speed": True}, "option speed=True"),
        ("sim:rice?seed=-1", {}, "option seed='-1' .* wanted a whole number of at least 0"),
        ("sim:rice?seed=²", {}, "wanted a whole number"),
        ("sim:ryce", {}, "url 'sim:ryce': materials has no material 'ryce'; known: dry peas, rice"),
        ("sim:rice?materials=rice", {}, "option materials .* is for sim:unknown only"),
        ("sim:unknown", {"materials": 7}, "option materials=7"),
        ("sim://rice", {}, "names a host.*wanted sim:rice"),
        ("rdt://box?variant=atii", {}, "one of auto, netft, axia, onrobot"),
        ("rdt://box?buffered=yes", {}, "wanted one of False, True, 0, 1"),
        ("rdt:/?variant=onrobot", {}, "no host"),
        ("rdt://box/x", {}, "the path '/x'"),
        ("rdt://box?variant=onrobot&rate_hz=300", {}, "whole number of milliseconds"),
    ],
)
def test_open_source_bad_url_is_refused(url, options, match):
    with pytest.raises(ValueError, match=match):
        open_source(url, **options)


def test_open_source_options_in_url_and_by_keyword_are_the_same():
    one = open_source("sim:fine%20sugar?seed=3&speed=7&session=2&rate_hz=250").info
    other = open_source("sim:fine_sugar", seed=3, speed=7, session=2, rate_hz=250).info
    assert one == other
    assert (one.rate_hz, one.speed, one.meta["seed"], one.meta["session"]) == (250.0, 7.0, 3, 2)


@pytest.mark.parametrize("scheme", ["ur", "bota", "ros2"])
def test_open_source_of_contrib_says_how_to_install(scheme):
    advice = rf"'{scheme}://x' needs granular-id-contrib.*pip install \./contrib"
    with pytest.raises(ImportError, match=advice):
        open_source(f"{scheme}://x")


def test_source_url_parts_are_decoded():
    url = SourceUrl.parse("RDT://Host.local:49152?variant=axia", {})
    assert (url.scheme, url.host, url.port, url.path) == ("rdt", "Host.local", 49152, "")
    assert SourceUrl.parse("replay:C%3F/a b.npz", {}).path == "C?/a b.npz"
    assert SourceUrl.parse("ros2://ft_sensor/Wrench", {}).path == "/Wrench"


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("name", ""),
        ("rate_hz", 0),
        ("rate_hz", float("nan")),
        ("tick_hz", -1),
        ("speed", 0),
        ("full_scale", (1, 2, 3)),
        ("full_scale", (1, 2, 3, 4, 5, 0)),
    ],
)
def test_source_info_bad_value_is_refused(name, value):
    with pytest.raises(ValueError, match=name):
        SourceInfo(**{"name": "x", "rate_hz": 500, "device_clock": True, name: value})


class Counting(ThreadedSource):
    """Some rows, and then an end or a fault; or it waits to be stopped."""

    def __init__(self, n=10, error=None, wait_s=0.0):
        super().__init__(SourceInfo("counting", 500, device_clock=False))
        self._n, self._fault, self._wait_s = n, error, wait_s

    def deliver(self, buffer, stopping):
        for n in range(self._n):
            buffer.push([n] * 6)
        if self._fault is not None:
            raise self._fault
        stopping.wait(self._wait_s)


def ended(source):
    """Wait for the end of its thread."""
    source._thread.join(20)
    return source.health()


def test_threaded_source_end_and_fault_are_in_its_health():
    source, sink = Counting(), Sink()
    assert isinstance(source, WrenchSource)
    assert source.health() == Health(running=False)
    source.start(sink)
    assert ended(source) == Health(running=False, finished=True)
    assert len(sink.rows) == 10
    dying = Counting(error=OSError("unplugged"))
    dying.start(Sink())
    assert ended(dying) == Health(running=False, error="OSError: unplugged")
    for used in (source, dying):
        used.stop()
        with pytest.raises(RuntimeError, match="counting runs once"):
            used.start(sink)


def test_threaded_source_hanging_driver_is_a_warning(monkeypatch):
    release = threading.Event()

    class Hanging(Counting):
        def deliver(self, buffer, stopping):
            buffer.push([0.0] * 6)
            release.wait(20)

    monkeypatch.setattr("granular_id.live.source._STOP_S", 0.01)
    with (
        pytest.warns(RuntimeWarning, match=r"counting did not stop within 0\.01 s: its driver hangs"),
        pytest.raises(ZeroDivisionError),  # what happened is not replaced
        opened(source := Hanging()),
    ):
        raise ZeroDivisionError
    assert source._thread.daemon
    release.set()
    assert not ended(source).running


def test_pace_that_cannot_be_kept_makes_the_clock_wait(monkeypatch):
    now = [10**9]
    monkeypatch.setattr("granular_id.live.source.host_ns", lambda: now[0])
    real, fast = (Pace(SourceInfo("x", 500, device_clock=True, speed=speed)) for speed in (1, 1000))
    assert (real.due(0), fast.due(0)) == (1, 1)
    now[0] += 10**9
    assert (real.due(1), fast.due(1)) == (50, 50_000)
    assert real.due(51) == 50, "the rest is made up for"
    assert fast.due(50_001) == 0, "the rest comes later"
    now[0] += 10**6
    assert fast.due(50_001) == 500


@pytest.mark.parametrize(
    ("source", "options", "error", "match"),
    [
        (partial(Counting, 0, wait_s=20), {"first_row_s": 0.1}, TimeoutError, r"nothing within 0\.1 s"),
        (partial(Counting, 0), {}, ConnectionError, "counting came to its end before its first row"),
        (partial(Counting, 0, OSError("no route")), {}, ConnectionError, "counting: OSError: no route"),
        (Counting, {"seconds": 0}, ValueError, "seconds must be positive"),
        (Counting, {"first_row_s": 0}, ValueError, "first_row_s must be positive"),
        (int, {}, TypeError, "source must be a URL or have info, start, stop and health, got int"),
    ],
)
def test_opened_source_without_rows_is_refused(source, options, error, match):
    with pytest.raises(error, match=match), opened(source(), **options):
        pass


def test_opened_source_of_nan_rows_names_them():
    class Broken(Counting):
        def deliver(self, buffer, stopping):
            buffer.push_block(np.full((3, 6), np.nan))
            stopping.wait(20)

    text = "^counting delivered nothing within 0.1 s; 3 rows with NaN or infinity were left out$"
    with pytest.raises(TimeoutError, match=text), opened(Broken(), first_row_s=0.1):
        pass


def test_replay_gives_the_samples_back(tmp_path):
    data = synthesize(["rice", "fine sugar"], n_per_class=2, duration_s=0.4)
    flags = np.zeros(200, dtype=np.uint8)
    flags[7] = SampleFlag.SATURATED
    data = Dataset([*data[:3], Recording(data[3].wrench, rate_hz=500, label="fine sugar", flags=flags)])
    source = open_source(f"replay:{save(data, tmp_path / 'set.npz')}?speed=50&pause_s=0.1")
    info = source.info
    assert (info.name, info.synthetic, info.rate_hz) == ("replay of 4 recordings", True, 500)
    assert info.repeats
    assert source.replays
    assert source.truth == "rice"
    sink = Sink()
    source.start(sink)
    assert ended(source).finished
    assert np.array_equal(sink.wrench, np.concatenate([r.wrench for r in data]))
    assert np.flatnonzero(sink.flags).tolist() == [607]
    starts = np.arange(4) * 0.5
    assert np.allclose(sink.time_s.reshape(4, 200), starts[:, np.newaxis] + np.arange(200) / 500)
    assert sink.epochs == [200, 400, 600], "silence is no loss"
    assert source.truth == "fine sugar"


def test_replay_is_paced_and_stops():
    source, sink = ReplaySource(synthesize(["rice"], n_per_class=1, duration_s=0.4), speed=0.001), Sink()
    source.start(sink)
    sink.wait(1)
    source.stop()
    assert len(sink.rows) < 200
    assert source.health() == Health(running=False)


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


@pytest.mark.parametrize(
    ("kind", "robot", "trigger", "name"),
    [
        ("sim", "auto", "auto", "motion"),
        ("sim", None, "auto", "force"),
        ("sim", "auto", "force", "force"),
        ("sim", "none", "manual", "manual"),
        ("sim", ManualRobot(), "auto", "force"),
        ("marked", "auto", "auto", "time"),
        ("bare", "auto", "auto", "force"),
        ("marked", "auto", "force", "force"),
    ],
)
def test_setup_of_trigger_follows_from_source_and_robot(kind, robot, trigger, name):
    """Recordings that are played again know where their motion began, if they were marked."""
    data = synthesize(["rice"], n_per_class=2, duration_s=0.4)
    bare = Dataset([Recording(r.wrench, rate_hz=500, label="rice") for r in data])
    source = {"sim": SimSource("rice", seed=1), "marked": ReplaySource(data), "bare": ReplaySource(bare)}[
        kind
    ]
    setup = setup_of(source, robot, trigger)
    assert setup.trigger().name == name
    assert setup.robot is robot or not isinstance(robot, ManualRobot)
