"""Pushes named while they happen: the same answers as from whole recordings, and honest failures."""

from dataclasses import replace

import numpy as np
import pytest

import granular_id as gid
from granular_id.identifier import N_CHECKPOINTS
from granular_id.live import CaptureError, FailureReason, ForceTrigger, LiveIdentifier, ReplaySource, opened
from granular_id.live.setup import Setup, setup_of
from granular_id.live.sim import SimSource
from granular_id.recording import Dataset, SampleFlag
from live_view_cases import pushes_and_model
from world import Shown, World

PUSHES, MODEL = pushes_and_model()  # of rice and of fine sugar
RICE, SUGAR = PUSHES[0], PUSHES[8]
CROP = {"trigger": "recorded", "lead_s": 0.1, "n_samples": 500}
MACARONI = gid.synthesize(["macaroni"], 1, duration_s=1.3).align(**CROP)[0]


def bench(*pushes, synthetic=True, **about):
    """A world whose arm pushes through these materials, one after another; it names their truth."""
    world, ahead = World(synthetic=synthetic, **about), iter(pushes)
    world.arm.goes_back()
    world.sensor.force = still = lambda _: pushes[0].wrench[0]

    def begin():
        push, begun_s = next(ahead), world.s
        rows = np.vstack([push.wrench[push.trigger_index :], push.wrench[:1]])
        world.sensor.truth = push.label
        world.sensor.force = lambda s: rows[min(round(500 * (s - begun_s)), len(rows) - 1)]

    world.arm.on.update(push=begin, stop=lambda: setattr(world.sensor, "force", still))
    return world


def named(world, model=MODEL, **options):
    options = {"setup": Setup(world.arm, setup_of(world.sensor, world.arm).trigger), **options}
    return LiveIdentifier(world.stream, model, **options)


def test_answers_are_those_of_the_recordings_to_the_bit():
    shown, decisions = Shown(), []
    live = named(bench(RICE, SUGAR), views=shown)
    pushes = [live.push(decisions.append), live.push()]
    for push, truth in zip(pushes, ("rice", "fine sugar"), strict=True):
        assert (push.decision.label, push.truth, push.recording.label) == (truth, truth, truth)
        assert MODEL.identify(push.recording).ranking == push.decision.ranking
        assert push.recording.meta["answer"]["label"] == truth
        assert (push.decision.final, push.decision.seconds, push.is_right) == (True, 1.0, True)
    assert live.summary() == "SYNTHETIC: 2 answers, 2 right (100 %)"
    n_seen = [decision.n_seen for decision in decisions]
    assert n_seen == sorted(set(n_seen))
    assert [decision.final for decision in decisions] == [False] * (len(decisions) - 1) + [True]
    assert decisions[-1] == pushes[0].decision
    last = shown.snapshots[-1]
    assert (last.state, last.decision, last.synthetic) == ("complete", pushes[1].decision, True)
    assert (last.n_captures, last.n_correct) == (2, 2)
    states = list(dict.fromkeys(one.state for one in shown.snapshots))
    assert states == ["arming", "armed", "triggered", "complete"]


def test_replay_is_named_to_its_end_as_its_recordings_are(tmp_path):
    MODEL.save(tmp_path / "m.safetensors")
    chosen, shown = PUSHES[[0, 13, 5]], Shown()
    with opened(ReplaySource(chosen, speed=20, pause_s=0.5)) as stream:
        live = LiveIdentifier(stream, tmp_path / "m.safetensors", views=shown)
        pushes = list(live.pushes())
    losses = [[dict(push.decision.ranking)[name] for name in MODEL.classes] for push in pushes]
    assert losses == MODEL.losses(chosen.X).tolist()
    assert [push.truth for push in pushes] == chosen.y.tolist()
    assert live.n_pushes == 3, "the end of the source is no push"
    assert shown.snapshots[-1].state == "ended"


@pytest.mark.parametrize(("push", "is_right"), [(MACARONI, True), (RICE, False)])
def test_only_a_final_answer_may_be_like_none(push, is_right):
    strict = gid.Identifier.fit(PUSHES, "hfmh", share_known=0.01)  # calls nearly everything unknown
    decisions, live = [], named(bench(push), strict)
    answer = live.push(decisions.append)
    assert (answer.decision.unknown, answer.is_right) == (True, is_right)
    assert (live.n_answered, live.n_right, live.n_unknown) == (1, int(is_right), 1)
    assert live.summary().endswith("; 1 like no known material")
    assert all(one.unknown is None and one.candidates == () for one in decisions[:-1])


def test_early_rule_is_looked_at_as_often_as_calibrated():
    decisions, world = [], bench(RICE, RICE)
    live = named(world, gid.Identifier.fit(PUSHES, "hfmh", target_error=0.3), early=True)
    first = live.push(decisions.append)
    moments = [one.n_seen * N_CHECKPOINTS // MODEL.n_samples for one in decisions]
    due = [one for one, now, before in zip(decisions, moments, [0, *moments], strict=False) if now > before]
    sure = next(one for one in due if one.sure)
    assert (first.decision, first.reason, first.recording) == (sure, None, None)
    assert sure.n_seen < MODEL.n_samples
    assert world.arm.times("stop") == 1
    assert live.push().reason is None
    assert (world.arm.times("back"), live.n_answered) == (1, 2)


@pytest.mark.parametrize("reason", [FailureReason.GAP, FailureReason.SATURATION, FailureReason.SOURCE])
def test_push_that_fails_is_no_answer_and_the_next_is_named(reason):
    fault = {"gap": ("lose", 1), "saturation": ("flags", SampleFlag.SATURATED), "source": ("error", "cable")}
    shown, world = Shown(), bench(RICE, RICE)
    world.after(0.4, lambda: setattr(world.sensor, *fault[reason.value]))
    live = named(world, views=shown)
    push = live.push()
    assert (push.decision, push.reason, push.recording) == (None, reason, None)
    assert (shown.snapshots[-1].state, shown.snapshots[-1].hint) == ("failed", push.text)
    world.sensor.flags = 0
    if not reason.is_lasting:
        assert live.push().decision.label == "rice"
    assert live.n_answered == (not reason.is_lasting)
    assert live.summary().endswith("; 1 could not be captured")


@pytest.mark.parametrize(
    ("limits", "faults", "warning"),
    [
        ({"max_gap": 2}, [(0.4, "lose", 2)], "gap"),
        ({"allow_saturated": True}, [(0.4, "flags", SampleFlag.SATURATED), (0.41, "flags", 0)], "saturation"),
        ({}, [(0.4, "late_s", 0.05)], "lag"),
    ],
)
def test_answer_warns_of_what_was_allowed(limits, faults, warning):
    world = bench(RICE)
    for after_s, *fault in faults:
        world.after(after_s, lambda fault=fault: setattr(world.sensor, *fault))
    assert named(world, **limits).push().decision.warnings == (warning,)


def test_last_answer_stays_while_nobody_pushes():
    shown, world = Shown(), World()
    world.sensor.force = lambda s: 1.0 if s < 0.5 else 9.0
    live = LiveIdentifier(world.stream, MODEL, Setup(None, ForceTrigger), views=shown, timeout_s=0.7)
    first, *others = [push for push, _ in zip(live.pushes(), range(3), strict=False)]
    assert first.decision.final
    assert [push.reason for push in others] == [FailureReason.NO_TRIGGER] * 2
    end = next(k for k, one in enumerate(shown.snapshots) if one.state == "complete")
    assert {one.words.answer.title for one in shown.snapshots[end:]} == {first.decision.label}
    with pytest.raises(CaptureError, match=r"nothing triggered within 0\.7 s"):
        next(live.pushes(1 + live.n_answered))


def test_limit_ends_the_session_until_resume():
    world = bench(RICE, RICE)
    live = named(world, max_force_n=0.5)
    with pytest.raises(CaptureError, match=r"force of .* N from rest") as raised:
        next(live.pushes())
    assert raised.value.reason is FailureReason.LIMIT
    with pytest.raises(CaptureError, match="resume"):
        live.push()
    live.resume()
    assert live.push().reason is FailureReason.LIMIT
    assert world.arm.times("push") == 2


def test_limit_passed_by_hand_wins_over_an_early_answer(monkeypatch):
    world = World()
    world.sensor.force = lambda s: 1.0 if s < 0.5 else 9.0
    live = LiveIdentifier(world.stream, MODEL, Setup(None, ForceTrigger), early=True, max_force_n=5.0)
    decide = live._answer.decision
    monkeypatch.setattr(live._answer, "decision", lambda: replace(decide(), sure=True))
    push = live.push()
    assert (push.decision, push.reason) == (None, FailureReason.LIMIT)


def test_model_of_simulations_on_a_real_sensor_is_warned_of():
    shown, world = Shown(), bench(RICE, synthetic=False)
    named(world, views=shown).push()
    for one in shown.snapshots:
        assert not one.synthetic
        assert "the model was trained on SYNTHETIC recordings" in " ".join(one.warnings)


def test_identify_closes_a_robot_that_it_has_opened_only(monkeypatch):
    for mover, n_closed in (("gantry://here", 1), (None, 0)):
        closed, source = [], SimSource("rice", seed=3, speed=20)
        robot = source.robot()
        robot.close = lambda closed=closed: closed.append(1)
        monkeypatch.setattr("granular_id.live.setup.open_robot", lambda _, robot=robot: robot)
        assert len(list(gid.identify(source, MODEL, n=1, robot=mover or robot))) == 1
        assert len(closed) == n_closed


def test_identify_raises_or_skips_what_failed():
    flags = np.repeat([0, SampleFlag.SATURATED], [400, 100])
    played = Dataset([replace(RICE, flags=flags), SUGAR])
    with pytest.raises(CaptureError, match="end of its range"):
        next(gid.identify(ReplaySource(played, speed=20), MODEL))
    (decision,) = gid.identify(ReplaySource(played, speed=20), MODEL, on_failure="skip")
    assert decision.label == "fine sugar"


def fitted(axes, **known):
    options = {"rate_hz": 500, "axes": [RICE.axes[k] for k in axes], **known}
    turned = [gid.Recording(one.wrench[:, axes], label=one.label, **options) for one in PUSHES]
    return gid.Identifier.fit(Dataset(turned), "hfmh", estimate=False)


def replayed(model=MODEL, **options):
    return gid.identify(ReplaySource(PUSHES), model, **options)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: next(replayed(pre_s=0.2)), "pre_s is 0.2, but the model was trained with 0.1 s of rest"),
        (lambda: next(replayed(n_samples=3)), "n_samples"),
        (lambda: next(replayed(robot=3)), "robot must have move_line and stop, got int"),
        (lambda: next(replayed(trigger="motions")), "trigger must be one of"),
        (lambda: next(replayed(robot="source")), "asks for the robot of the source, and replay"),
        # before the first answer
        (lambda: replayed(n=0), "n must be at least 1, got 0"),
        (lambda: replayed(on_failure="stop"), "on_failure must be"),
        (lambda: replayed("missing.safetensors"), "missing"),
        (lambda: named(bench(RICE)).pushes(1.5), "whole number"),
        (lambda: named(bench(RICE, rate_hz=100.0)), "the model is for 500 Hz, bench delivers 100 Hz"),
        (
            lambda: named(bench(RICE), fitted([5, 4, 3, 2, 1, 0], trigger_index=50)),
            "the axes tz ty tx fz fy fx;",
        ),
        (lambda: named(bench(RICE), fitted([0, 1, 2, 3, 4, 5])), "pre_s must be given"),
    ],
)
def test_what_cannot_be_identified_is_refused_by_name(call, words):
    with pytest.raises((TypeError, ValueError, FileNotFoundError), match=words):
        call()
