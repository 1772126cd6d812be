"""Answers that go on: each hop one about the newest window, for models of any axes, as over a stored recording."""

from types import SimpleNamespace

import numpy as np
import pytest
from sklearn.pipeline import make_pipeline

from granular_id import HFMH, ECOCClassifier
from granular_id.identifier import Identifier
from granular_id.live import CaptureError, FailureReason, HopIdentifier, LiveIdentifier, ReplaySource, opened
from granular_id.live.rows import HoppingWindows
from granular_id.live.source import Health, SourceInfo, WrenchBuffer
from granular_id.recording import Dataset, Recording
from world import Shown, World

RATE, N = 100.0, 50
GROUNDS = ("asphalt", "grass", "gravel")
UNITS = {"wx": "rad/s", "wy": "rad/s", "wz": "rad/s", "ax": "m/s2", "ay": "m/s2", "az": "m/s2", "mx": "uT"}
IMU, THREE, SEVEN = tuple(UNITS)[:6], ("ax", "ay", "az"), tuple(UNITS)


def recording(samples, axes, **fields):
    meta = {"units": {axis: UNITS[axis] for axis in axes}}
    return Recording(samples, rate_hz=RATE, axes=axes, meta=meta, **fields)


def noise(k, axes, seconds, seed):
    return np.random.default_rng(seed).normal(0, 0.3 * (k + 1), (round(seconds * RATE), len(axes)))


def drive(k, axes, **fields):
    """One second on one ground."""
    return recording(noise(k, axes, 1, 50 + k), axes, label=GROUNDS[k], **fields)


def mixed(axes):
    """Three seconds on each ground."""
    return recording(np.concatenate([noise(k, axes, 3, 100 + k) for k in range(3)]), axes)


def played(*recordings):
    """Play recordings fast."""
    return ReplaySource(Dataset(recordings), speed=200.0, pause_s=0.1)


def fitted(axes):
    about = [
        (k, 100 * k + i, {"label": GROUNDS[k], "session": str(i % 3)}) for k in range(3) for i in range(24)
    ]
    windows = [recording(noise(k, axes, 0.5, seed), axes, **fields) for k, seed, fields in about]
    space = make_pipeline(HFMH(cutoff_hz=10), ECOCClassifier())
    return Identifier.fit(Dataset(windows), space, target_error=None)


@pytest.fixture(scope="module")
def models():
    return {axes: fitted(axes) for axes in (IMU, THREE, SEVEN)}


def stamped(rate_hz=RATE, lose=1000):
    """A source that states `RATE`, stamps its rows at another rate, and loses one of every so many."""
    ticks = np.flatnonzero(np.arange(900) % lose != lose - 1)
    units = tuple(UNITS.values())[:6]
    return SimpleNamespace(
        info=SourceInfo("stamped", RATE, device_clock=True, axes=IMU, units=units, speed=100),
        start=lambda buffer: buffer.push_block(mixed(IMU).wrench[ticks], ticks / rate_hz),
        stop=lambda: None,
        health=lambda: Health(running=False, finished=True),
    )


def answers(source, model, hop_s, n=None, **options):
    with opened(source) as stream:
        live = HopIdentifier(stream, model, hop_s, **options)
        return list(live.pushes(n)), live


@pytest.mark.parametrize("axes", [IMU, THREE, SEVEN], ids=len)
@pytest.mark.parametrize("hop_s", [0.2, 0.7])
def test_live_answers_are_those_over_the_stored_recording(models, axes, hop_s):
    model, file = models[axes], mixed(axes)
    expected = model.predict_over(file, hop_s)
    pushes, _ = answers(played(file), model, hop_s)
    assert [push.decision.label for push in pushes] == expected.labels.tolist()
    assert [push.decision.unknown for push in pushes] == expected.unknown.tolist()
    losses = [[dict(push.decision.ranking)[name] for name in model.classes] for push in pushes]
    assert losses == expected.losses.tolist()
    # device time of the newest row is one period before the end of the window
    assert [push.time_s for push in pushes] == pytest.approx((expected.times_s - 1 / RATE).tolist())


def test_truth_is_that_of_the_window_however_late_it_is_read(models):
    source = played(drive(0, IMU), drive(2, IMU))
    with opened(source) as stream:
        source._thread.join(20)  # all of it was played
        pushes = list(HopIdentifier(stream, models[IMU], 0.25).pushes())
    assert [push.truth for push in pushes] == ["asphalt"] * 3 + ["gravel"] * 3  # each begins anew


def test_pushes_of_any_axes_are_named_however_late_they_are_read(models):
    model, pushes = models[THREE], [drive(k, THREE, trigger_index=20) for k in range(3)]
    source = played(*pushes)
    with opened(source) as stream:
        source._thread.join(20)  # all of it was played
        live = LiveIdentifier(stream, model, pre_s=0.2)
        named = [live.push() for _ in pushes]
    assert [one.truth for one in named] == list(GROUNDS)
    expected = model.predict(np.stack([one.wrench[:N] for one in pushes]))
    assert [one.decision.label for one in named] == list(expected)


def test_samples_at_another_rate_than_stated_get_no_answer(models):
    pushes, live = answers(stamped(101), models[IMU], 0.5)
    assert {(push.decision, push.reason) for push in pushes} == {(None, FailureReason.RATE)}
    assert live.summary() == f"0 answers; {len(pushes)} could not be captured"
    assert "measured 101 Hz" in live.why_none
    tolerated, _ = answers(stamped(101), models[IMU], 0.5, rate_tolerance=0.02)
    assert [push.reason for push in tolerated] == [None] * len(pushes)


def test_loss_without_any_answer_is_a_failure(models):
    (push,), live = answers(stamped(lose=40), models[IMU], 0.5)
    assert (push.decision, push.reason, push.text) == (None, FailureReason.GAP, live.lost)
    assert live.lost.startswith("rows were lost 22 times")


@pytest.mark.parametrize(("lose", "max_gap", "lost"), [(40, 1, ""), (60, 0, "rows were lost 14 times")])
def test_loss_is_filled_flagged_or_counted_beside_answers(models, lose, max_gap, lost):
    pushes, live = answers(stamped(lose=lose), models[IMU], 0.5, max_gap=max_gap)
    assert {"gap" in push.decision.warnings for push in pushes} == {bool(max_gap)}
    assert live.lost == lost


def test_windows_begin_anew_where_rows_were_overwritten():
    buffer, windows, begins = WrenchBuffer(0.08, rate_hz=RATE), HoppingWindows(4, 3), []
    reader = buffer.reader(from_oldest=True)
    for first, end in ((0, 5), (5, 8), (8, 50)):
        buffer.push_block(np.arange(first, end)[:, None] * np.ones(6), np.arange(first, end) / RATE)
        begins += [window.wrench[0, 0] for window in windows.feed(reader.read())]
    first = 50 - buffer.capacity
    assert begins == [0, 3, *range(first, 47, 3)]
    assert windows.n_lost == 1


@pytest.mark.parametrize(("pause_s", "at_s"), [(0.0, 7.0), (3.0, 10.0)])
def test_a_silent_source_fails_after_its_own_pause(models, pause_s, at_s):
    world = World(rate_hz=RATE, axes=IMU, units=tuple(UNITS.values())[:6])
    world.sensor.pause_s = pause_s
    world.after(2, lambda: setattr(world.sensor, "silent", True))
    with pytest.raises(CaptureError) as caught:
        list(HopIdentifier(world.stream, models[IMU], 0.5).pushes())
    assert caught.value.reason is FailureReason.NO_ROWS
    assert world.s == pytest.approx(at_s, abs=0.1)


def test_views_get_axes_answers_and_only_changes_in_the_history(models):
    shown = Shown()
    pushes, _ = answers(played(mixed(SEVEN)), models[SEVEN], 0.1, views=shown)
    last = shown.snapshots[-1]
    assert (last.state, last.axes, last.units) == ("ended", SEVEN, tuple(UNITS.values()))
    names = [None if one.decision.unknown else one.decision.label for one in pushes]
    changes = [name for name, before in zip(names, [..., *names], strict=False) if name != before]
    history = [one.push.decision for one in last.history]
    assert [None if one.unknown else one.label for one in history] == changes[-len(history) :]


def test_the_number_of_answers_ends_it_and_too_few_fail(models):
    assert len(answers(played(mixed(IMU)), models[IMU], 0.2, 3)[0]) == 3
    with pytest.raises(CaptureError, match="after 3 answers"):
        answers(played(mixed(IMU)), models[IMU], 3, 5)


def test_what_does_not_fit_is_refused(models):
    in_g = Recording(np.ones((99, 3)), rate_hz=RATE, axes=THREE, meta={"units": dict.fromkeys(THREE, "g")})
    with pytest.raises(ValueError, match=r"units 'ax: g'.*accept"):
        answers(played(in_g), models[THREE], 0.5)
    with pytest.raises(ValueError, match="is less than a sample"):
        answers(played(mixed(THREE)), models[THREE], 0.001)
    with opened(played(mixed(IMU))) as stream, pytest.raises(ValueError, match="needs hop_s"):
        LiveIdentifier(stream, models[IMU], pre_s=0.1)
