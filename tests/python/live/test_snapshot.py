"""Snapshots tell the truth about the rows they were made of, and say it in words once for all views."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from granular_id import FeatureSpec, extract_features
from granular_id.live import FailureReason, Push, Snapshot, SnapshotBuilder
from granular_id.live.snapshot_builder import outline
from granular_id.signal import butter, sosfilt, sosfilt_zi
from live_view_cases import CLASSES, answer, block, listening, push

ROWS, WRENCH = push()
SPECS = {
    "paper": FeatureSpec(),
    "clipped, steady": FeatureSpec(outside="clip", initial="steady", bin_range=(-0.1, 0.1), n_bins=7),
    "ranges by axis": FeatureSpec(bin_range=[(-1, 1)] * 3 + [(-0.1, 0.2)] * 3, order=3, cutoff_hz=40),
}


@pytest.mark.parametrize("spec", SPECS.values(), ids=SPECS)
def test_the_histogram_of_a_whole_capture_is_that_of_its_features(spec):
    builder = SnapshotBuilder(500.0, spec)
    builder.captured(WRENCH[:100])
    builder.begin_capture()
    for piece in np.split(WRENCH, [0, 1, 7, 7, 500, 1599]):
        builder.captured(piece)
    counts = builder.build("complete").counts
    assert np.array_equal(counts.ravel(), extract_features(WRENCH, spec=spec)[WRENCH.size :])


def high_passed(rows):
    sections = butter(8, 23, "highpass", fs=500)
    return sosfilt(sections, rows, axis=0, zi=sosfilt_zi(sections)[:, :, None] * rows[0])[0]


@given(
    st.lists(st.integers(0, len(ROWS)), max_size=30).map(sorted),
    st.dictionaries(st.integers(1, len(ROWS) - 1), st.integers(1, 1200), max_size=4),
)
def test_traces_do_not_depend_on_how_the_rows_arrive_and_are_interrupted_where_some_never_did(borders, gaps):
    builder = SnapshotBuilder(500.0, view_s=1.0)
    at = 0
    for piece in np.split(ROWS, borders):
        inside = {row - at: n for row, n in gaps.items() if at <= row < at + len(piece)}
        builder.rows(block(piece, at + sum(n for row, n in gaps.items() if row < at), missing_before=inside))
        at += len(piece)
    seen = builder.build("armed")
    rows, left = [], []
    for row, piece in zip([0, *sorted(gaps)], np.split(ROWS, sorted(gaps)), strict=True):
        nothing = np.full((gaps.get(row, 0), 6), np.nan)
        rows += [nothing, piece]
        left += [nothing, high_passed(piece)]  # what lies in a gap nobody saw
    assert np.array_equal(seen.wrench, np.vstack(rows)[-500:], equal_nan=True)
    assert np.array_equal(seen.residual, np.vstack(left)[-500:], equal_nan=True)
    assert np.array_equal(seen.latest, ROWS[-1])
    assert seen.time_s == (len(ROWS) + sum(gaps.values()) - 1) / 500
    assert np.allclose(seen.row_age_s, np.arange(499, -1, -1) / 500)
    assert seen.lost == seen.counters["missing"] == sum(gaps.values())


def test_a_long_view_is_thinned_and_keeps_every_peak():
    builder = SnapshotBuilder(500.0, view_s=20.0)
    rows = np.random.default_rng(0).normal(size=(15_000, 6))
    rows[9_000], rows[9_001] = 50.0, -60.0
    for start in range(0, len(rows), 1000):
        builder.rows(block(rows[start : start + 1000], start))
    seen = builder.build("armed")
    assert len(seen.wrench) <= 600
    assert (seen.wrench.max(0) == 50.0).all()
    assert (seen.wrench.min(0) == -60.0).all()
    assert seen.row_age_s[-1] < 0.1
    assert (np.diff(seen.row_age_s) <= 0).all()


@given(
    st.lists(st.one_of(st.floats(-1e9, 1e9), st.just(np.nan)), max_size=60),
    st.integers(0, 50),
    st.integers(1, 9),
)
def test_outline_is_the_extremes_of_each_piece(values, first, step):
    """Pieces begin at multiples of `step` in the whole stream: a trace that moves on keeps its shape."""
    rows = np.array(values, float).reshape(-1, 1)
    places, kept = outline(rows, first, step)
    if step == 1:
        assert np.array_equal(kept, rows, equal_nan=True)
        return
    pieces = {}
    for i, value in enumerate(values):
        pieces.setdefault((first + i) // step, []).append(value)
    if first % step:
        pieces.pop(first // step, None)
    wanted = []
    for piece in pieces.values():
        known = [value for value in piece if not np.isnan(value)]
        wanted.append((min(known), max(known)) if known else (np.nan, np.nan))
    got = [(min(pair), max(pair)) for pair in kept.reshape(-1, 2).tolist()]
    assert np.array_equal(np.array(got).reshape(-1, 2), np.array(wanted).reshape(-1, 2), equal_nan=True)
    assert (np.diff(places) >= 0).all()
    assert np.allclose(np.diff(places)[:-2], step / 2), (
        "evenly spread, but for the last piece, which may be short"
    )


def test_rows_that_were_overwritten_are_a_gap_and_not_missing_and_an_epoch_begins_anew():
    builder = SnapshotBuilder(500.0, view_s=1.0)
    builder.rows(block(np.zeros((100, 6))))
    builder.rows(block(np.full((50, 6), 5.0), 140, missed=40))
    seen = builder.build("armed")
    assert np.isnan(seen.wrench[100:140]).all()
    assert np.isfinite(np.delete(seen.wrench, slice(100, 140), axis=0)).all()
    assert abs(seen.residual[140:]).max() < 1e-9
    assert (seen.counters["missing"], seen.counters["missed"], seen.counters["rows"]) == (0, 40, 150)
    assert seen.lost == 40
    builder.rows(block(np.full((5, 6), -7.0), epoch=1, missed=9))
    seen = builder.build("armed")
    assert len(seen.wrench) == 5, "those were of the epoch before"
    assert abs(seen.residual).max() < 1e-9  # the high-pass begins anew: the step to it is none
    assert seen.counters["epochs"] == 2
    builder.rows(block(np.ones((1, 6)), missing_before={0: 4_000_000_000}, epoch=1))
    assert np.isnan(builder.build("armed").wrench[:-1]).all()


def test_histogram_and_ranking_stand_until_rows_of_the_next_capture_come():
    builder, seen = listening(1.0, step=50)
    times, losses = seen.ranking_history
    assert times.tolist() == pytest.approx(np.arange(1, 11) / 10)
    assert dict(zip(CLASSES, losses[-1].tolist(), strict=True)) == dict(seen.decision.ranking)
    assert len(builder.build("triggered", seen.decision).ranking_history[0]) == 10, (
        "the same answer is no news"
    )
    builder.begin_capture()
    armed = builder.build("armed")
    assert len(armed.ranking_history[0]) == 10
    assert np.array_equal(armed.counts, seen.counts)
    builder.captured(WRENCH[:1])
    again = builder.build("triggered")
    assert len(again.ranking_history[0]) == 0
    assert again.counts.sum() <= 6
    assert len(seen.ranking_history[0]) == 10  # snapshots do not change
    assert seen.counts.sum() > 0


def test_a_session_that_goes_on_for_ever_stays_small():
    builder = SnapshotBuilder(500.0, classes=CLASSES)
    for i in range(700):
        seen = builder.build("triggered", answer(i / 10))
    assert len(seen.ranking_history[0]) <= 240
    assert seen.ranking_history[0][-1] == pytest.approx(69.9)
    assert builder.build("triggered", answer(0.1)).ranking_history[0].tolist() == [0.1], "it begins anew"
    assert builder.build("armed").held is None
    pushes = [Push(answer(3.2, final=True)) for _ in range(100)]
    for one in pushes:
        builder.end_capture(one)
    seen = builder.build("armed")
    assert [outcome.push for outcome in seen.history] == pushes[-40:]
    assert [outcome.number for outcome in seen.history] == list(range(61, 101))
    held = {state: builder.build(state).held for state in ("idle", "arming", "armed", "ended")}
    assert all(outcome.push is pushes[-1] for outcome in held.values())
    assert all(builder.build(state).held is None for state in ("triggered", "complete", "failed"))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"rate_hz": 0.0}, "rate_hz must be positive"),
        ({"rate_hz": 1000.0, "spec": FeatureSpec()}, "rate_hz is 1000, but spec was made for 500 Hz"),
        ({"view_s": -1.0}, "view_s must be above 0"),
        ({"view_s": 1e9}, "view_s must be above 0 and hold at most"),
        ({"n_samples": 0}, "n_samples must be at least 1"),
    ],
)
def test_sessions_that_cannot_be_are_refused(options, words):
    with pytest.raises(ValueError, match=words):
        SnapshotBuilder(**{"rate_hz": 500.0} | options)


def test_rows_and_answers_that_do_not_fit_are_refused():
    builder = SnapshotBuilder(500.0, classes=["a"])
    with pytest.raises(ValueError, match=r"block.wrench has shape \(4, 3\)"):
        builder.rows(block(np.zeros((4, 3))))
    with pytest.raises(ValueError, match="rows holds values that are not finite"):
        builder.captured(np.full((4, 6), np.nan))
    with pytest.raises(ValueError, match="ranks other materials"):
        builder.build("armed", answer(1.0))


def test_a_slow_source_has_a_lower_cutoff():
    assert SnapshotBuilder(40.0).build("idle").cutoff_hz == 10.0


MIDDLE, END = listening(1.7)[1], listening(3.2)[1]
PROVISIONAL, FINAL = "provisional, 1.70 s of 3.20 s", "final, after 3.20 s"
LEAD = f"margin {END.decision.margin:.3f} ahead of cat litter"
EARLY_LEAD = f"margin {MIDDLE.decision.margin:.3f} ahead of {MIDDLE.decision.ranking[1][0]}"


@pytest.mark.parametrize(
    ("snapshot", "said"),
    [
        (Snapshot("idle", hint="press Enter"), ("none", "no answer yet", "press Enter", "")),
        (Snapshot("armed"), ("none", "no answer yet", "armed", "")),
        (Snapshot("complete"), ("none", "recorded", "done", "")),
        (Snapshot("ended", hint="it is over"), ("none", "no more pushes", "it is over", "")),
        (Snapshot("failed", hint="a gap"), ("failed", "no answer", "the capture failed", "a gap")),
    ],
)
def test_without_an_answer_the_words_say_what_is_going_on(snapshot, said):
    words = snapshot.words
    assert words.answer == said
    assert (f"{words.state}: {snapshot.hint}" if snapshot.hint else words.state) in words.line


@pytest.mark.parametrize(
    ("state", "known", "said"),
    [
        ("triggered", {}, ("provisional", PROVISIONAL, EARLY_LEAD)),
        ("triggered", {"sure": True}, ("provisional", f"{PROVISIONAL}, sure enough to stop", EARLY_LEAD)),
        ("complete", {"sure": True}, ("final", "early, 1.70 s of 3.20 s, sure enough to stop", EARLY_LEAD)),
        ("complete", {"final": True}, ("final", FINAL, LEAD)),
        ("complete", {"final": True, "probability": 0.934}, ("final", FINAL, f"{LEAD}, probability 93 %")),
        ("complete", {"final": True, "candidates": ("rice",)}, ("final", FINAL, LEAD)),
        ("complete", {"final": True, "candidates": ("a", "b")}, ("final", FINAL, f"{LEAD}, may be a or b")),
        (
            "complete",
            {"final": True, "candidates": CLASSES},
            ("final", FINAL, f"{LEAD}, may be {' or '.join(CLASSES[:6])} or {len(CLASSES) - 6} more"),
        ),
        ("complete", {"final": True, "unknown": True}, ("unknown", FINAL, f"nearest: fine sugar, {LEAD}")),
    ],
)
def test_answers_in_words(state, known, said):
    decision = answer(3.2 if known.get("final") else 1.7, **known)
    words = replace(END, state=state, decision=decision).words
    kind, stage, detail = said
    title = "like no known material" if kind == "unknown" else "fine sugar"
    assert words.answer == (kind, title, stage, detail)
    assert f"{words.state}: {title} ({stage}, {detail})" in words.line


def test_a_line_has_all_that_matters():
    seen = replace(END, time_s=2.1, lag_s=0.03, counters={"missing": 3}, warnings=("gap", "the tool slipped"))
    assert seen.words.line == (
        f"SYNTHETIC  2.100 s  Done: fine sugar ({FINAL}, {LEAD})  |  lag 30.0 ms (!), lost 3 (!)"
        "  |  12 of 12 right  |  warning: gap: missing rows were filled in  |  warning: the tool slipped"
    )
    assert replace(seen, n_correct=None).words.score == "12 captures"


def test_lag_and_loss_are_always_told_other_troubles_where_there_are_any_and_each_may_be_an_alarm():
    assert Snapshot("armed").words.figures == (("lag", "-", False), ("lost", "0", False))
    worrying = ["gaps", "late", "saturated", "bad_status", "non_finite"]
    harmless = ["stale", "duplicates", "reordered"]
    seen = replace(END, lag_s=0.021, counters=dict.fromkeys(["missed", *worrying, *harmless], 1234))
    figures = {name.replace("not finite", "non finite"): alarm for name, _, alarm in seen.words.figures}
    assert figures.pop("lag")
    assert figures.pop("lost")
    assert figures == {name.replace("_", " "): name in worrying for name in (*worrying, *harmless)}
    assert {value for _, value, _ in seen.words.figures} == {"21.0 ms", "1,234"}


def test_the_last_outcome_is_held_and_spoken_until_the_next_push_begins():
    builder, _ = listening(1.0)
    builder.end_capture(Push(answer(3.2, final=True, warnings=("gap",)), truth="rice"))
    words = builder.build("armed", hint="push now").words
    assert words.answer[:2] == ("final", "fine sugar")
    assert re.fullmatch(rf"{FINAL}, at \d\d:\d\d:\d\d", words.answer.stage)
    assert words.answer.stage.endswith(words.history[0].clock)
    assert words.state == "Armed: push now"
    assert words.warnings == ("gap: missing rows were filled in",)
    assert words.ranking[0][0] == "fine sugar"
    begin = f"wrong, it was rice, {LEAD}"
    assert words.spoken == f"Push 1. Final answer: fine sugar, {begin}, gap: missing rows were filled in"
    assert "Armed: push now  |" in words.line
    builder.end_capture(Push(None, FailureReason.GAP, "12 rows are missing"))
    words = builder.build("triggered", answer(1.0)).words
    assert (words.answer.kind, words.state, words.warnings) == ("provisional", "Listening", ())
    assert words.spoken == "Push 2. no answer, 12 rows are missing"
    builder.end_capture(Push(answer(3.2, final=True, unknown=True), truth="macaroni brine"))
    builder.end_capture(Push(answer(3.2, final=True), truth="fine sugar"))
    details = [entry.detail for entry in builder.build("armed").words.history]
    assert details[0] == f"right, {LEAD}"
    assert details[1] == f"right, it was macaroni brine, nearest: fine sugar, {LEAD}"


def test_a_push_in_one_line():
    answered, refused = answer(3.2, final=True), answer(3.2, final=True, unknown=True)
    elsewhere = "it was macaroni brine, which the model does not know"
    for decision, truth, said in [
        (answered, None, ""),
        (answered, "fine sugar", "  right"),
        (answered, "rice", "  WRONG, it was rice"),
        (answered, "macaroni brine", f"  WRONG, {elsewhere}"),
        (refused, "macaroni brine", f"  right, {elsewhere}"),
        (refused, "rice", "  WRONG, it was rice"),
    ]:
        one = Push(decision, truth=truth)
        assert str(one) == f"{decision}{said}"
        assert one.to_dict() == {"decision": decision.to_dict(), "failure": None, "truth": truth}
    failed = Push(None, FailureReason.GAP, "12 rows are missing")
    assert str(failed) == "no answer: 12 rows are missing"
    assert failed.to_dict() == {
        "decision": None,
        "failure": {"reason": "gap", "text": failed.text},
        "truth": None,
    }
