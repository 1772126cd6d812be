"""What recorders refuse: faults of the sensor, and of whoever waits."""

from __future__ import annotations

import threading
import time
from dataclasses import replace

import numpy as np
import pytest

import granular_id as gid
from granular_id.live.capture_state import CaptureError, CaptureState, FailureReason
from granular_id.live.recorder import Recorder
from granular_id.live.sim import SimSource
from granular_id.live.sim_faults import Fault
from granular_id.live.source import SourceInfo
from granular_id.live.source_thread import ThreadedSource
from granular_id.live.stream import opened
from granular_id.live.trigger import ManualTrigger, MotionTrigger
from recorder_cases import SHORT, Watched, bench, files

FAULTS = {
    "gap": (Fault("gap", after_s=0.2, rows=3), FailureReason.GAP, "3 samples .* are missing"),
    "saturation": (Fault("saturation", after_s=0.2), FailureReason.SATURATION, "end of its range"),
    "restart": (Fault("restart", after_s=0.2), FailureReason.RESTART, "time began anew"),
    "death": (Fault("death", after_s=0.2), FailureReason.SOURCE, "told to die"),
    "silence": (Fault("stall", after_s=0.2, stall_s=60), FailureReason.NO_ROWS, "delivered nothing for 1 s"),
    "restart before the motion": (
        Fault("restart", after_s=-0.2),
        FailureReason.RESTART,
        "time began anew after the motion was commanded",
    ),
    "gap before the trigger": (Fault("gap", after_s=-0.05, rows=2), FailureReason.GAP, "triggered after"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_faults_fail_the_recording(tmp_path, name):
    fault, reason, text = FAULTS[name]
    with bench(tmp_path) as (source, robot, recorder):
        source.inject(fault)
        with pytest.raises(CaptureError, match=text) as raised:
            recorder.record("rice")
        assert raised.value.reason is reason
        assert robot.n_stops == 1
        assert files(tmp_path) == []
        if reason not in (FailureReason.SOURCE, FailureReason.NO_ROWS):
            recorder.record("rice")
            assert len(gid.load(tmp_path / "data")) == 1


def test_a_gap_at_rest_is_waited_out(tmp_path):
    """The robot is held until both were read: sent off between them, it would rightly fail at the restart."""
    epochs = [0]

    class Patient(MotionTrigger):
        def arm(self, rest):
            return "the sensor has yet to begin anew" if epochs[-1] == 0 else super().arm(rest)

    def watch(step, _):
        epochs.extend([step.block.epoch] if len(step.block) else [])

    with bench(tmp_path, trigger=Patient, on_step=watch) as (source, _, recorder):
        source.inject(Fault("gap", rows=5))
        source.inject(Fault("restart"))
        assert recorder.record("rice").recording.n_samples == 300


def test_a_gap_that_may_be_filled(tmp_path):
    with bench(tmp_path, max_gap=3) as (source, _, recorder):
        source.inject(Fault("gap", after_s=0.2, rows=3))
        recorded = recorder.record("rice")
    loaded = gid.load(recorded.path)[0]
    assert np.count_nonzero(loaded.flags == gid.SampleFlag.GAP_FILLED) == 3


def test_rows_that_come_late_and_complete_are_a_good_recording_that_says_so(tmp_path):
    with bench(tmp_path, speed=1) as (source, robot, recorder):
        source.inject(Fault("stall", after_s=0.1, stall_s=0.4))
        recorded = recorder.record("rice")
    assert robot.n_stops == 0
    late = gid.load(recorded.path)[0]
    assert late.meta["late_s"] > 0.2
    with bench(tmp_path, speed=20) as (_, _, recorder):
        punctual = recorder.record("rice").recording
    assert "late_s" not in punctual.meta
    assert np.array_equal(late.wrench, punctual.wrench), "neither rows nor trigger are moved"


def test_lag_without_a_clock_of_the_sensor(tmp_path):
    with bench(tmp_path, speed=1) as (source, robot, recorder):
        source._info = replace(source.info, device_clock=False)
        source.inject(Fault("stall", after_s=0.1, stall_s=0.4))
        with pytest.raises(CaptureError, match="late; wanted at most 20 ms") as raised:
            recorder.record("rice")
    assert raised.value.reason is FailureReason.LAG
    assert robot.n_stops == 1


def test_overflow(tmp_path):
    source = SimSource("rice", seed=1, speed=20)
    slow = threading.Event()

    def dawdle(step, capture):
        if capture.state is CaptureState.TRIGGERED and not slow.is_set():
            slow.set()
            time.sleep(0.3)

    with opened(source, seconds=0.05) as stream:
        recorder = Recorder(stream, Watched(source), tmp_path / "data", on_step=dawdle, n_samples=1600)
        with pytest.raises(CaptureError, match="rows were overwritten") as raised:
            recorder.record("rice")
    assert raised.value.reason is FailureReason.OVERFLOW
    assert files(tmp_path) == []


def test_trigger_before_the_rest_is_there(tmp_path):
    trigger = ManualTrigger()
    trigger.fire()
    with bench(tmp_path, trigger=lambda: trigger) as (_, robot, recorder):
        with pytest.raises(CaptureError, match="rows at rest, wanted 50") as raised:
            recorder.record("rice")
        assert raised.value.reason is FailureReason.TRIGGER_TOO_EARLY
        assert robot.n_stops == 1


def test_nobody_moves(tmp_path):
    with opened("sim:rice?seed=1&speed=20") as stream:
        recorder = Recorder(stream, None, tmp_path / "data", timeout_s=2.0, **SHORT)
        with pytest.raises(CaptureError, match="nothing triggered within 2 s") as raised:
            recorder.record("rice")
    assert raised.value.reason is FailureReason.NO_TRIGGER


class Silent(ThreadedSource):
    def __init__(self, fault=None):
        super().__init__(SourceInfo("silent", 500, device_clock=True))
        self._fault = fault

    def deliver(self, buffer, stopping):
        if self._fault is not None:
            raise self._fault
        stopping.wait(20)


def test_sources_that_do_not_begin():
    with (
        pytest.raises(TimeoutError, match=r"silent delivered nothing within 0\.1 s"),
        opened(Silent(), first_row_s=0.1),
    ):
        pass
    for option in ("seconds", "first_row_s"):
        with pytest.raises(ValueError, match=f"{option} must be positive"), opened(Silent(), **{option: 0}):
            pass

    class Ended(Silent):
        def deliver(self, buffer, stopping):
            """Nothing to deliver."""

    with pytest.raises(ConnectionError, match="silent came to its end before its first row"), opened(Ended()):
        pass
    dead = Silent(OSError("no route"))
    with pytest.raises(ConnectionError, match="silent: OSError: no route"), opened(dead):
        pass
    with (
        pytest.raises(TypeError, match="source must be a URL or have info, start, stop and health, got int"),
        opened(3),
    ):
        pass


def test_a_stream_is_stopped_whatever_happens():
    source = SimSource("rice", seed=1)

    def use():
        with opened(source) as stream:
            assert stream.health().running
            assert stream.health().counters["written"] > 0
            assert 0 <= stream.lag_s() < 5
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        use()
    assert not source.health().running
