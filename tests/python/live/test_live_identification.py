"""Pushes named while they happen: the same answers as from whole recordings, and honest failures."""

import time
from dataclasses import replace
from itertools import takewhile

import numpy as np
import pytest

import granular_id as gid
from faulty_sim import Fault, FaultySource
from granular_id.identifier import N_CHECKPOINTS, Decision
from granular_id.live import (
    CaptureError,
    FailureReason,
    LiveIdentifier,
    Recorder,
    SimSource,
    opened,
    setup_of,
)
from granular_id.live.replay import ReplaySource
from granular_id.recording import Dataset
from live_view_cases import pushes_and_model

MATERIALS = ("rice", "fine sugar")


@pytest.fixture(scope="module")
def pushes():
    return pushes_and_model()[0]


@pytest.fixture(scope="module")
def model():
    return pushes_and_model()[1]


@pytest.fixture(scope="module")
def strict(pushes):
    """A model that calls nearly everything unknown."""
    return gid.Identifier.fit(pushes, "hfmh", share_known=0.01)


class Kept:
    """A view that keeps what it is shown."""

    def __init__(self):
        self.snapshots = []

    def wants_snapshot(self):
        return True

    def publish(self, snapshot):
        self.snapshots.append(snapshot)


def simulated(*faults, materials="rice", seed=3, speed=10):
    source = FaultySource(materials, seed=seed, speed=speed)
    for fault in faults:
        source.inject(fault)
    return source


def replayed(recordings):
    return ReplaySource(Dataset(recordings), speed=5, pause_s=0.5)


def test_rows_that_come_late_are_warned_of(model):
    with opened(simulated(Fault("stall", after_s=0.1, stall_s=0.3), speed=1)) as stream:
        push = LiveIdentifier(stream, model).push()
    assert push.decision.final
    assert push.decision.warnings == ("lag",)
    assert push.decision.label == push.truth


def test_time_counts_from_the_call(model):
    with opened(simulated(speed=5)) as stream:
        live = LiveIdentifier(stream, model, timeout_s=5.0)
        for _ in range(2):
            time.sleep(1.5)  # 7.5 s of the sensor's time
            assert live.push().text == ""


def test_a_model_may_be_a_path(model, tmp_path):
    model.save(tmp_path / "m.safetensors")
    with opened(simulated(speed=20)) as stream:
        for path in (tmp_path / "m.safetensors", str(tmp_path / "m.safetensors")):
            assert LiveIdentifier(stream, path).model.classes == model.classes


@pytest.mark.parametrize("name", ["n_samples", "max_gaps"])
def test_limits_that_there_are_none_of_are_refused(model, name):
    with (
        opened(simulated(speed=20)) as stream,
        pytest.raises(TypeError, match=f"^{name} is not known here; known limits: max_gap, allow_"),
    ):
        LiveIdentifier(stream, model, **{name: 3})


def test_provisional_answers_grow_into_the_final_one_which_is_right_and_views_see_them(model):
    seen, kept = [], Kept()
    with opened(simulated(materials=MATERIALS, speed=5)) as stream:
        live = LiveIdentifier(stream, model, views=kept)
        pushes = [live.push(seen.append), live.push()]
    assert [push.truth for push in pushes] == [push.decision.label for push in pushes]
    assert (live.n_pushes, live.n_answered, live.n_right) == (2, 2, 2)
    assert live.summary() == "SYNTHETIC: 2 answers, 2 right (100 %)"
    n_seen = [decision.n_seen for decision in seen]
    assert n_seen == sorted(set(n_seen))
    assert len(n_seen) > 3
    assert [decision.final for decision in seen] == [False] * (len(seen) - 1) + [True]
    assert seen[-1] == pushes[0].decision
    assert seen[-1].seconds == model.n_samples / model.rate_hz
    assert {"arming", "triggered"} & {snapshot.state for snapshot in kept.snapshots}
    last = kept.snapshots[-1]
    assert (last.state, last.decision, last.synthetic) == ("complete", pushes[1].decision, True)
    assert last.counts.sum() <= 6 * model.n_samples
    assert (last.n_captures, last.n_correct) == (2, 2)


@pytest.mark.parametrize(("material", "is_right"), [("macaroni", True), ("rice", False)])
def test_only_the_final_answer_says_that_a_push_is_like_none_and_that_counts_as_an_answer(
    strict, material, is_right
):
    said = []
    with opened(simulated(materials=material, speed=5)) as stream:
        live = LiveIdentifier(stream, strict)
        push = live.push(said.append)
    assert (push.decision.unknown, push.is_right) == (True, is_right)
    assert (live.n_answered, live.n_right, live.n_unknown) == (1, int(is_right), 1)
    assert live.summary().endswith("; 1 like no known material")
    provisional = [decision for decision in said if not decision.final]
    assert provisional
    assert all(decision.unknown is None and decision.candidates == () for decision in provisional)


def test_a_replay_is_named_as_its_recordings_are_bit_for_bit(model, pushes):
    chosen = Dataset([pushes[k] for k in (0, 13, 5)])
    with opened(replayed(chosen)) as stream:
        live = LiveIdentifier(stream, model)
        for recording, expected in zip(chosen, model.losses(chosen.X), strict=True):
            push = live.push()
            assert push.text == ""
            assert push.decision.label == recording.label == push.truth
            losses = dict(push.decision.ranking)
            assert [losses[name] for name in model.classes] == expected.tolist()


def test_recorded_and_live_windows_are_the_same_rows(model, tmp_path):
    """Same seed, same push: what the recorder stores gets the answer that was given live."""
    with opened(simulated(speed=20)) as stream:
        decision = LiveIdentifier(stream, model).push().decision
    with opened(simulated(speed=20)) as stream:
        robot, lengths = stream.source.robot(), {"n_samples": model.n_samples, "pre_s": model.lead_s}
        recording = Recorder(stream, robot, tmp_path, **lengths).record("rice").recording
    assert model.identify(recording).ranking == decision.ranking


@pytest.mark.parametrize(
    ("kind", "reason"),
    [
        ("gap", FailureReason.GAP),
        ("saturation", FailureReason.SATURATION),
        ("restart", FailureReason.RESTART),
        ("death", FailureReason.SOURCE),
    ],
)
def test_faults_fail_the_push_and_the_next_one_is_named(model, kind, reason):
    kept = Kept()
    with opened(simulated(Fault(kind, after_s=0.3))) as stream:
        live = LiveIdentifier(stream, model, views=kept)
        failed = live.push()
        assert (failed.decision, failed.reason) == (None, reason)
        assert failed.text
        last = kept.snapshots[-1]
        assert (last.state, last.hint) == ("failed", failed.text)
        if not reason.is_lasting:
            assert live.push().decision.label == "rice"
    assert live.n_answered == (not reason.is_lasting)
    assert live.summary().endswith("; 1 could not be captured")


def test_filled_gaps_and_saturation_are_warned_of_where_they_are_allowed(model):
    faults = Fault("gap", after_s=0.2, rows=2), Fault("saturation", after_s=0.4, rows=3)
    with opened(simulated(*faults)) as stream:
        push = LiveIdentifier(stream, model, max_gap=2, allow_saturated=True).push()
    assert push.decision.warnings == ("gap", "saturation")
    assert push.decision.final


def shown(snapshot):
    """What page and terminal show."""
    return snapshot.words.answer[:2]


def test_every_answer_stands_in_all_views_until_the_next_push_is_triggered(model):
    kept, pushes = Kept(), []
    source = simulated(materials=(*MATERIALS, "macaroni"), speed=4)
    with opened(source) as stream:
        live = LiveIdentifier(stream, model, views=kept)
        for k in range(5):
            if k == 2:
                source.inject(Fault("gap", after_s=0.3))
            pushes.append(live.push())
    assert pushes[2].decision is None
    ends = [i for i, s in enumerate(kept.snapshots) if s.state in ("complete", "failed")]
    assert len(ends) == len(pushes)
    for k, (push, end, until) in enumerate(zip(pushes, ends, [*ends[1:], None], strict=True)):
        after = kept.snapshots[end:until]
        stands = list(takewhile(lambda snapshot: snapshot.state != "triggered", after))
        answer = ("failed", "no answer") if push.decision is None else ("final", push.decision.label)
        assert {shown(snapshot) for snapshot in stands} == {answer}
        assert k == 4 or {"arming", "armed"} & {snapshot.state for snapshot in stands}
        assert all(np.array_equal(snapshot.counts, after[0].counts) for snapshot in stands)
        assert all([one.push for one in snapshot.history] == pushes[: k + 1] for snapshot in after)
        assert {shown(snapshot)[0] for snapshot in after[len(stands) :]} <= {"none", "provisional"}


def test_without_a_number_it_waits_however_long_nobody_pushes_and_the_answer_stands(strict):
    kept, source = Kept(), simulated(speed=20)
    with opened(source) as stream:
        live = LiveIdentifier(stream, strict, views=kept)
        assert live.push().decision.unknown
        live._setup, live._limits = setup_of(source, None), {"timeout_s": 0.5}
        waited = [push.reason for push, _ in zip(live.pushes(), range(3), strict=False)]
        assert waited == [FailureReason.NO_TRIGGER] * 3
        end = next(i for i, s in enumerate(kept.snapshots) if s.state == "complete")
        assert {shown(snapshot) for snapshot in kept.snapshots[end:]} == {
            ("unknown", "like no known material")
        }
        assert len(kept.snapshots[-1].history) == 1
        with pytest.raises(CaptureError, match=r"nothing triggered within 0\.5 s"):
            next(live.pushes(1 + live.n_answered))


def test_pushes_end_with_the_source_unless_more_were_wanted(model, pushes, tmp_path):
    model.save(tmp_path / "m.safetensors")
    decisions = gid.identify(replayed(pushes[:2]), tmp_path / "m.safetensors")
    assert [decision.final for decision in decisions] == [True, True]
    with opened(replayed(pushes[:2])) as stream, pytest.raises(CaptureError, match="came to its end"):
        list(LiveIdentifier(stream, model).pushes(3))


def test_identify_ends_the_connection_to_a_robot_that_it_has_opened_and_to_no_other(model, monkeypatch):
    closed, source = [], simulated(speed=20)
    robot = source.robot()
    robot.close = lambda: closed.append(1)
    monkeypatch.setattr("granular_id.live.setup.open_robot", lambda url: robot)
    assert len(list(gid.identify(source, model, n=1, robot="gantry://here"))) == 1
    assert closed == [1]
    again = simulated(speed=20)
    robot = again.robot()
    robot.close = lambda: closed.append(2)
    assert len(list(gid.identify(again, model, n=1, robot=robot))) == 1
    assert closed == [1]


def test_identify_raises_or_skips_what_could_not_be_captured(model):
    gap = Fault("gap", after_s=0.3)
    with pytest.raises(CaptureError, match=r"missing|gap") as caught:
        next(gid.identify(simulated(gap), model, n=1))
    assert caught.value.reason is FailureReason.GAP
    (decision,) = gid.identify(simulated(gap), model, n=1, on_failure="skip")
    assert decision.final


@pytest.mark.parametrize(
    ("source", "options", "words"),
    [
        ("sim:rice?rate_hz=100", {}, "the model is for 500 Hz, simulated rice delivers 100 Hz"),
        ("sim:rice", {"on_failure": "stop"}, "on_failure must be 'raise' or 'skip', got 'stop'"),
        ("sim:rice", {"n": 0}, "n must be at least 1, got 0"),
        ("sim:rice", {"pre_s": 0.2}, "pre_s is 0.2, but the model was trained with 0.1 s of rest"),
    ],
)
def test_refusals_name_what_does_not_fit(model, source, options, words):
    with pytest.raises(ValueError, match=words):
        next(gid.identify(source, model, **options))


def test_other_axes_and_an_unknown_rest_are_refused(pushes):
    def fitted(axes, **known):
        options = {"rate_hz": 500, "axes": [pushes[0].axes[k] for k in axes], **known}
        turned = [gid.Recording(r.wrench[:, axes], label=r.label, **options) for r in pushes]
        return gid.Identifier.fit(Dataset(turned), "hfmh", estimate=False)

    with opened("sim:rice?seed=1") as stream:
        with pytest.raises(ValueError, match="for the axes tz ty tx fz fy fx;"):
            LiveIdentifier(stream, fitted([5, 4, 3, 2, 1, 0], trigger_index=50))
        with pytest.raises(ValueError, match="pre_s must be given"):
            LiveIdentifier(stream, fitted([0, 1, 2, 3, 4, 5]))


def test_what_is_no_opened_source_is_refused_with_the_way_to_open_it(model, tmp_path):
    wanted = r"^stream must be an opened source \(with opened\(\.\.\.\) as stream\), got 'sim:rice'$"
    with pytest.raises(TypeError, match=wanted):
        LiveIdentifier("sim:rice", model)
    with pytest.raises(TypeError, match=wanted):
        Recorder("sim:rice", None, tmp_path)


@pytest.mark.parametrize(
    ("n", "error", "words"),
    [("3", TypeError, "n must be a whole number, got '3'"), (-1, ValueError, "n must be at least 1, got -1")],
)
def test_numbers_of_answers_that_cannot_be_are_refused_before_anything_moves(model, n, error, words):
    with opened(simulated(speed=20)) as stream, pytest.raises(error, match=f"^{words}$"):
        LiveIdentifier(stream, model).pushes(n)
    with pytest.raises(error, match=f"^{words}$"):
        gid.identify(simulated(), model, n=n)


class Arm(SimSource):
    """Not synthetic by its own account, as an arm's sensor is."""

    def __init__(self, **options):
        super().__init__("rice", seed=1, **options)
        self._info = replace(self._info, name="an arm", synthetic=False)


def test_a_model_of_simulated_recordings_is_called_so_on_every_view_of_a_real_sensor(model):
    kept = Kept()
    with opened(Arm(speed=20)) as stream:
        setup = setup_of(stream.source, "source")
        LiveIdentifier(stream, model, setup, views=kept).push()
    assert kept.snapshots
    for snapshot in kept.snapshots:
        assert not snapshot.synthetic
        assert "the model was trained on SYNTHETIC recordings" in " ".join(snapshot.warnings)


def test_the_early_rule_is_looked_at_as_often_as_when_it_was_calibrated(model):
    ranking = (("rice", 0.0),)
    with opened("sim:rice?seed=1") as stream:
        live = LiveIdentifier(stream, model, early=True)
        seen = range(1, model.n_samples + 1)
        sure = [live._is_answer(Decision("rice", ranking, 1.0, sure=True, n_seen=n)) for n in seen]
        assert sum(sure) == N_CHECKPOINTS


class Breaking(ReplaySource):
    """Broken where a replay is over."""

    def health(self):
        health = super().health()
        return replace(health, error="cable", finished=False) if health.finished else health


@pytest.mark.parametrize(("kind", "state"), [(ReplaySource, "ended"), (Breaking, "failed")])
def test_a_replay_that_is_over_is_shown_as_ended_and_a_broken_source_as_failed(model, pushes, kind, state):
    kept = Kept()
    with opened(kind(Dataset([pushes[0]]), speed=5, pause_s=0.5)) as stream:
        live = LiveIdentifier(stream, model, views=kept)
        if state == "ended":
            assert len(list(live.pushes())) == live.n_pushes == 1, "the end of the source is no push"
        else:
            with pytest.raises(CaptureError, match="cable"):
                list(live.pushes())
    last = kept.snapshots[-1]
    assert last.state == state
    assert last.words.state.startswith(state.capitalize())
    assert shown(last) == (("final", pushes[0].label) if state == "ended" else ("failed", "no answer"))
    assert last.history[0].push.decision.label == pushes[0].label


def test_no_machine_moves_unasked():
    assert setup_of(Arm()).robot is None
    assert setup_of(Arm()).trigger().name == "force"
    assert setup_of(Arm(), "source").robot is not None
    replay = ReplaySource(gid.synthesize(["rice"], 1))
    for source, options, error, words in [
        (
            replay,
            {"robot": "source"},
            ValueError,
            "robot='source' asks for the robot of the source, and replay",
        ),
        (
            Arm(),
            {"robot": "arm"},
            ValueError,
            "robot must be one of auto, none, manual, source, .* got 'arm'",
        ),
        (Arm(), {"robot": 3}, TypeError, "robot must have tcp_pose, move_line and stop, got int"),
    ]:
        with pytest.raises(error, match=words):
            setup_of(source, **options)


def test_early_answers_stop_the_robot(model):
    """An answer that is sure ends the push; the next one begins at rest."""
    with opened(simulated(seed=8, speed=5)) as stream:
        live = LiveIdentifier(stream, model, early=True)
        pushes = [live.push() for _ in range(2)]
    for push in pushes:
        assert push.reason is None
        assert push.decision.sure or push.decision.final
        assert push.decision.label == push.truth == "rice"
