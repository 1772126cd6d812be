"""Answers that go on: each hop one about the newest window, for models of any axes, as over a stored recording."""

import math
import time
from io import StringIO

import numpy as np
import pytest
from rich.console import Console

import granular_id as gid
from granular_id.identifier import Identifier
from granular_id.live import CaptureError, FailureReason, LiveIdentifier, Push, identification, opened
from granular_id.live.monitor import frame
from granular_id.live.replay import ReplaySource
from granular_id.live.rows import HoppingWindows, Rows
from granular_id.live.setup import Setup
from granular_id.live.source import SourceInfo, ThreadedSource
from granular_id.live.terminal import screen
from granular_id.live.trigger import ManualTrigger
from granular_id.recording import Dataset, Recording

RATE, N = 100.0, 50
GROUNDS = ("asphalt", "grass", "gravel")
AXES = {
    "imu": ("wx", "wy", "wz", "ax", "ay", "az"),
    "three": ("ax", "ay", "az"),
    "nine": ("wx", "wy", "wz", "ax", "ay", "az", "mx", "my", "mz"),
}
UNITS = {"w": "rad/s", "a": "m/s2", "m": "uT"}


def drive(k, axes, seconds, seed, **fields):
    rng = np.random.default_rng(seed)
    samples = rng.normal(0, 0.3 * (k + 1), (round(seconds * RATE), len(axes)))
    units = {axis: UNITS[axis[0]] for axis in axes}
    return Recording(samples, rate_hz=RATE, axes=axes, meta={"units": units}, **fields)


def grounds(axes):
    each = [(k, i, drive(k, axes, 4, 10 * k + i, label=GROUNDS[k])) for k in range(3) for i in range(3)]
    cut = [
        Recording(
            one.wrench[j : j + N], rate_hz=RATE, axes=axes, label=one.label, session=f"{k} {i}", meta=one.meta
        )
        for k, i, one in each
        for j in range(0, one.n_samples, N)
    ]
    return Dataset(cut)


@pytest.fixture(scope="module")
def models():
    return {
        name: Identifier.fit(grounds(axes), "hfmh", cutoff_hz=10, early=False) for name, axes in AXES.items()
    }


def mixed(axes, **fields):
    parts = [drive(k, axes, 3, 100 + k).wrench for k in range(3)]
    return Recording(
        np.concatenate(parts), rate_hz=RATE, axes=axes, name="mixed", meta=drive(0, axes, 1, 0).meta, **fields
    )


def replayed(*recordings, speed=20.0):
    return ReplaySource(Dataset(recordings), speed=speed, pause_s=0.1)


class Stamped(ThreadedSource):
    """States `RATE`, stamps its samples at another rate, and loses one of every so many."""

    def __init__(self, rate_hz=RATE, lose=None):
        axes = AXES["imu"]
        units = tuple(UNITS[axis[0]] for axis in axes)
        super().__init__(SourceInfo("stamped", RATE, device_clock=True, axes=axes, units=units, speed=100))
        self.rate_hz, self.lose = rate_hz, lose

    def deliver(self, buffer, stopping):
        samples = mixed(AXES["imu"]).wrench
        kept = np.ones(len(samples), bool)
        if self.lose:
            kept[self.lose :: self.lose] = False
        buffer.push_block(samples[kept], np.flatnonzero(kept) / self.rate_hz)


class Kept:
    def __init__(self):
        self.snapshots = []

    def wants_snapshot(self):
        return True

    def publish(self, snapshot):
        self.snapshots.append(snapshot)


@pytest.mark.parametrize("kind", list(AXES))
@pytest.mark.parametrize("hop_s", [0.2, 0.7])
def test_live_answers_are_those_over_the_stored_recording(models, kind, hop_s):
    recording, model = mixed(AXES[kind]), models[kind]
    expected = model.predict_over(recording, hop_s)
    with opened(replayed(recording)) as stream:
        live = LiveIdentifier(stream, model, hop_s=hop_s)
        pushes = list(live.pushes())
    assert [push.decision.label for push in pushes] == expected.labels.tolist()
    assert [push.decision.unknown for push in pushes] == expected.unknown.tolist()
    assert [dict(push.decision.ranking) for push in pushes] == [
        dict(zip(model.classes, losses, strict=True)) for losses in expected.losses.tolist()
    ]
    # device time of the newest row is one period before the end of the window
    assert [push.time_s for push in pushes] == pytest.approx((expected.times_s - 1 / RATE).tolist())
    assert live.n_answered == len(expected)


def test_pushes_of_any_axes_are_captured_where_recordings_say_when_they_began(models):
    axes = AXES["three"]
    pushes = [drive(k, axes, 1.0, 7 + k, label=GROUNDS[k], trigger_index=20) for k in range(3)]
    with opened(replayed(*pushes)) as stream:
        live = LiveIdentifier(stream, models["three"], pre_s=0.2)
        answers = [live.push() for _ in pushes]
    for push, recording in zip(answers, pushes, strict=True):
        assert push.decision.label == models["three"].predict(recording.wrench[None, :N])[0]
        assert push.truth == recording.label


def test_without_a_trigger_and_without_forces_the_way_out_is_a_hop(models):
    with (
        opened(replayed(mixed(AXES["imu"]))) as stream,
        pytest.raises(ValueError, match="at each hop, needs hop_s"),
    ):
        LiveIdentifier(stream, models["imu"], pre_s=0.1)


def test_each_recording_begins_anew_and_its_label_is_the_truth(models):
    axes = AXES["imu"]
    two = [drive(k, axes, 1.0, 50 + k, label=GROUNDS[k]) for k in (0, 2)]
    with opened(replayed(*two, speed=5)) as stream:
        live = LiveIdentifier(stream, models["imu"], hop_s=0.25)
        pushes = list(live.pushes())
    assert [push.truth for push in pushes] == ["asphalt"] * 3 + ["gravel"] * 3
    assert live.summary().startswith("6 answers, ")


def test_samples_at_another_rate_than_stated_get_no_answer(models):
    said = "measured 101 Hz, wanted 100 Hz within 0.1 %"
    with opened(Stamped(101)) as stream:
        live = LiveIdentifier(stream, models["imu"], hop_s=0.5)
        pushes = list(live.pushes())
    assert [(push.decision, push.reason, push.text) for push in pushes] == [
        (None, FailureReason.RATE, said)
    ] * len(pushes)
    assert pushes[0].time_s == pytest.approx(49 / 101)
    assert live.summary() == f"0 answers; {len(pushes)} could not be captured"
    assert live.why_none == f"the source came to its end without an answer: {said}"
    with pytest.raises(CaptureError, match="measured 101 Hz"):
        list(gid.identify(Stamped(101), models["imu"], hop_s=0.5))
    assert not list(gid.identify(Stamped(101), models["imu"], hop_s=0.5, on_failure="skip"))
    answers = list(gid.identify(Stamped(101), models["imu"], hop_s=0.5, rate_tolerance=0.02))
    assert len(answers) == len(pushes)


def test_views_show_why_there_is_no_answer(models):
    kept = Kept()
    with opened(Stamped(101)) as stream:
        live = LiveIdentifier(stream, models["imu"], hop_s=0.5, views=kept)
        for _ in live.pushes():
            pass
        live._show_hop("answering", Push(None, FailureReason.RATE, "measured 101 Hz"))
    answer = kept.snapshots[-1].words.answer
    assert (answer.title, answer.detail) == ("no answer", "measured 101 Hz")
    assert len(kept.snapshots[-1].history) == 1


def test_the_truth_is_that_of_the_window_however_late_it_is_read(models):
    two = [drive(k, AXES["imu"], 1.0, 50 + k, label=GROUNDS[k]) for k in (0, 2)]
    with opened(replayed(*two, speed=20)) as stream:
        live, truths = LiveIdentifier(stream, models["imu"], hop_s=0.25), []
        for push in live.pushes():
            truths.append(push.truth)
            time.sleep(0.1)
    assert truths == ["asphalt"] * 3 + ["gravel"] * 3
    assert stream.truth_at(0.99) == "asphalt"
    assert stream.truth_at(1.1) == "gravel"


def test_the_truth_of_a_push_is_that_of_its_samples(models):
    axes = AXES["three"]
    two = [drive(k, axes, 1.0, 7 + k, label=GROUNDS[k], trigger_index=20) for k in (0, 2)]
    with opened(replayed(*two)) as stream:
        live = LiveIdentifier(stream, models["three"], pre_s=0.2)
        time.sleep(0.5)  # both were played
        assert [live.push().truth for _ in two] == ["asphalt", "gravel"]


def test_regular_loss_is_said_where_no_answer_came(models):
    why = "rows were lost 22 times; a window needs 0.5 s without loss (max_gap)"
    kept = Kept()
    with opened(Stamped(lose=40)) as stream:
        live = LiveIdentifier(stream, models["imu"], hop_s=0.5, views=kept)
        (push,) = live.pushes()
        assert (push.decision, push.reason, push.text) == (None, FailureReason.GAP, why)
        assert live.summary() == f"0 answers; {why}"
        live._show_hop("answering", None)
    assert kept.snapshots[-1].hint == f"the first answer comes after 0.5 s of signal; {why}"
    with (
        opened(Stamped(lose=40)) as stream,
        pytest.raises(CaptureError, match="without an answer: rows were"),
    ):
        list(LiveIdentifier(stream, models["imu"], hop_s=0.5).pushes(1))
    with opened(Stamped(lose=40)) as stream:
        live = LiveIdentifier(stream, models["imu"], hop_s=0.5, max_gap=1)
        assert all("gap" in push.decision.warnings for push in live.pushes())
        assert live.summary().startswith("18 answers")
        assert "lost" not in live.summary()
    with opened(Stamped(lose=60)) as stream:
        live = LiveIdentifier(stream, models["imu"], hop_s=0.5)
        assert list(live.pushes())
        assert live.summary().endswith("; rows were lost 14 times")


def test_a_pause_of_the_source_is_no_silence(models, monkeypatch):
    monkeypatch.setattr(identification, "_SILENT_S", 0.3)
    axes = AXES["three"]
    two = [drive(k, axes, 1.0, 7 + k, label=GROUNDS[k], trigger_index=20) for k in (0, 2)]
    with opened(ReplaySource(Dataset(two), speed=2, pause_s=1.2)) as stream:
        assert len(list(LiveIdentifier(stream, models["three"], hop_s=0.5).pushes())) == 4
    with opened(ReplaySource(Dataset(two), speed=2, pause_s=2.8)) as stream:  # more than a silent second
        live = LiveIdentifier(stream, models["three"], pre_s=0.2)
        assert [live.push().truth for _ in two] == ["asphalt", "gravel"]


def test_views_see_the_axes_the_answers_and_only_changes_in_the_history(models):
    kept = Kept()
    with opened(replayed(mixed(AXES["nine"]), speed=10)) as stream:
        live = LiveIdentifier(stream, models["nine"], hop_s=0.1, views=kept)
        pushes = list(live.pushes())
    first, last = kept.snapshots[0], kept.snapshots[-1]
    assert (last.axes, last.units[0], last.units[-1]) == (AXES["nine"], "rad/s", "uT")
    assert {one.state for one in kept.snapshots} <= {"arming", "answering", "ended"}
    assert first.words.answer.stage == "the first answer comes after 0.5 s of signal"
    answering = next(one for one in reversed(kept.snapshots) if one.state == "answering")
    assert answering.words.answer.stage == "about the last 0.50 s"
    assert answering.words.score.endswith(" answers")
    said = [None if p.decision.unknown else p.decision.label for p in pushes]
    changes = [one for i, one in enumerate(said) if not i or one != said[i - 1]]
    history = [one.push.decision for one in last.history]
    assert [None if d.unknown else d.label for d in history] == changes[-40:]
    times, losses = answering.ranking_history
    assert (times.max(), len(losses)) == (answering.span_s, len(times))
    assert answering.counts.shape[0] == answering.wrench.shape[1] == 9
    assert b"its histogram" in frame(answering, 1)


def test_a_terminal_shows_the_names_and_units_of_the_axes(models):
    kept = Kept()
    with opened(replayed(mixed(AXES["three"]), speed=10)) as stream:
        live = LiveIdentifier(stream, models["three"], hop_s=0.5, views=kept)
        list(live.pushes())
    console = Console(width=100, height=40, file=StringIO())
    console.print(screen(kept.snapshots[-1], 100))
    text = console.file.getvalue()
    assert "ax" in text
    assert "m/s2" in text


def test_the_number_of_answers_ends_it_and_too_few_samples_are_said(models):
    with opened(replayed(mixed(AXES["imu"]))) as stream:
        assert len(list(LiveIdentifier(stream, models["imu"], hop_s=0.2).pushes(3))) == 3
    with opened(replayed(mixed(AXES["imu"]))) as stream:
        live = LiveIdentifier(stream, models["imu"], hop_s=3)
        with pytest.raises(CaptureError, match="came to its end after 3 answers") as caught:
            list(live.pushes(5))
        assert caught.value.reason is FailureReason.SOURCE


def test_gid_identify_goes_on_with_a_hop(models):
    answers = gid.identify(replayed(mixed(AXES["imu"])), models["imu"], hop_s=0.5)
    assert len(list(answers)) == len(models["imu"].predict_over(mixed(AXES["imu"]), 0.5))


def test_an_answer_at_a_hop_says_when_and_a_push_does_not():
    decision = gid.Decision("grass", (("grass", 0.1), ("gravel", 0.3)), 0.2, final=True, seconds=0.5)
    at_hop = Push(decision, time_s=12.5)
    assert str(at_hop) == "12.50 s: grass, margin 0.200 ahead of gravel"
    assert at_hop.to_dict()["time_s"] == 12.5
    assert str(Push(decision)).startswith("grass after 0.50 s, final: margin 0.200")
    assert "time_s" not in Push(decision).to_dict()


REFUSED = [
    ({"hop_s": 0}, "hop_s must be positive"),
    ({"hop_s": 0.001}, "hop_s=0.001 is less than a sample: at least 0.01"),
    ({"hop_s": 0.5, "early": True}, "early is about pushes"),
    ({"hop_s": 0.5, "pre_s": 0.1}, "pre_s is about pushes"),
    ({"hop_s": 0.5, "setup": Setup(None, ManualTrigger)}, "setup is about pushes"),
    ({"hop_s": 0.5, "direction": (0, 1, 0)}, "direction is about pushes"),
    ({"hop_s": 0.5, "speed_m_s": 0.1}, "speed_m_s is about pushes"),
    ({"hop_s": 0.5, "timeout_s": -3}, "timeout_s is about pushes"),
    ({"hop_s": 0.5, "lag_patience_s": 1}, "lag_patience_s is about pushes"),
    ({"hop_s": 0.5, "allow_saturated": True}, "allow_saturated is about pushes"),
    ({"hop_s": 0.5, "max_gap": -1}, "max_gap must be at least 0"),
    ({"hop_s": 0.5, "rate_tolerance": "x"}, "rate_tolerance must be a number"),
    ({"hop_s": 0.5, "max_lag_s": -1}, "max_lag_s must not be negative"),
    ({"hop_s": 0.5, "tyop": 3}, "tyop"),
]


@pytest.mark.parametrize(("settings", "said"), REFUSED)
def test_what_does_not_go_with_a_hop_is_refused(models, settings, said):
    with opened(replayed(mixed(AXES["imu"]))) as stream, pytest.raises((ValueError, TypeError), match=said):
        LiveIdentifier(stream, models["imu"], **settings)


@pytest.mark.parametrize("mover", [{"robot": "manual"}, {"trigger": "force"}])
def test_identify_refuses_robot_and_trigger_with_a_hop(models, mover):
    with pytest.raises(ValueError, match=f"{next(iter(mover))} is about pushes"):
        gid.identify("sim:rice", models["imu"], hop_s=1, **mover)


def test_other_axes_and_units_than_the_model_are_refused(models):
    with (
        opened(replayed(mixed(AXES["three"]))) as stream,
        pytest.raises(ValueError, match=r"for the axes wx .* has ax"),
    ):
        LiveIdentifier(stream, models["imu"], hop_s=0.5)
    axes = AXES["three"]
    other = Recording(mixed(axes).wrench, rate_hz=RATE, axes=axes, meta={"units": dict.fromkeys(axes, "g")})
    with opened(replayed(other)) as stream:
        with pytest.raises(ValueError, match=r"units 'ax: g'.*accept"):
            LiveIdentifier(stream, models["three"], hop_s=0.5)
        assert LiveIdentifier(stream, models["three"], hop_s=0.5, accept="units").differences


def block(first, n, *, epoch=0, missed=0, missing=0):
    rows = Rows(
        np.arange(first, first + n)[:, None] * np.ones(2),
        np.arange(first, first + n) / RATE,
        np.zeros(n, np.int64),
        np.zeros(n, np.uint8),
        np.concatenate([[missing], np.zeros(n - 1, np.int64)]),
    )
    object.__setattr__(rows, "epoch", epoch)
    object.__setattr__(rows, "missed", missed)
    return rows


def begins(blocks, n=4, hop=3, max_gap=0):
    windows = HoppingWindows(n, hop, max_gap)
    return [window.wrench[0, 0] for one in blocks for window in windows.feed(one) if len(window) == n]


CUTS = [
    ("in one piece", [block(0, 12)], {}, [0, 3, 6]),
    ("row by row", [block(i, 1) for i in range(12)], {}, [0, 3, 6]),
    ("a hop longer than a window", [block(0, 5), block(5, 15)], {"hop": 7}, [0, 7, 14]),
    ("a gap", [block(0, 5), block(7, 8, missing=2)], {}, [0, 7, 10]),
    ("a gap that is filled", [block(0, 5), block(6, 6, missing=1)], {"max_gap": 1}, [0, 3, 6]),
    ("another epoch", [block(0, 5), block(0, 7, epoch=1)], {}, [0, 0, 3]),
    ("rows that were overwritten", [block(0, 5), block(20, 4, missed=15)], {}, [0, 20]),
]


def test_windows_count_losses_and_neither_new_recordings_nor_what_was_filled():
    windows = HoppingWindows(4, 3, 1)
    for one in (
        block(0, 5, missed=3),
        block(6, 5, missing=1),
        block(13, 5, missing=2),
        block(30, 5, missed=9),
    ):
        list(windows.feed(one))
    list(windows.feed(block(0, 5, epoch=1)))
    assert windows.n_lost == 2


@pytest.mark.parametrize(
    ("blocks", "settings", "expected"), [row[1:] for row in CUTS], ids=[row[0] for row in CUTS]
)
def test_windows_do_not_depend_on_pieces_and_begin_anew_where_rows_do_not_join(blocks, settings, expected):
    assert begins(blocks, **settings) == expected


def test_the_axes_of_a_source_are_kept_with_its_recordings_where_they_are_not_those_of_a_wrench():
    info = SourceInfo("imu", 100, device_clock=True, axes=AXES["three"], units=("m/s2",) * 3)
    assert info.to_dict()["axes"] == list(AXES["three"])
    assert "axes" not in SourceInfo("ft", 500, device_clock=True).to_dict()
    with pytest.raises(ValueError, match="units must be one for each of 3 axes, got 2"):
        SourceInfo("imu", 100, device_clock=True, axes=AXES["three"], units=("g", "g"))
    assert math.isclose(info.rate_hz, 100)
