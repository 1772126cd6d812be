"""Snapshots tell the truth about the rows they were made of, and say it in words once for all views."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from granular_id import FeatureSpec, extract_features
from granular_id.live import FailureReason, Push
from granular_id.signal import butter, sosfilt, sosfilt_zi
from live_view_cases import CLASSES, answer, block, hopping, listening, new_builder, push

ROWS, WRENCH = push()
SPECS = {
    "paper": FeatureSpec(),
    "other": FeatureSpec(outside="clip", bin_range=[(-1, 1)] * 3 + [(-0.1, 0.2)] * 3, order=3, n_bins=7),
}


@pytest.mark.parametrize("spec", SPECS.values(), ids=SPECS)
def test_counts_whole_capture_equal_features(spec):
    builder = new_builder(spec=spec)
    builder.captured(WRENCH[:100])
    builder.begin_capture()
    for piece in np.split(WRENCH, [0, 1, 7, 7, 500, 1599]):
        builder.captured(piece)
    counts = builder.build("complete").counts
    assert np.array_equal(counts.ravel(), extract_features(WRENCH, spec=spec)[WRENCH.size :])


def high_passed(rows):
    sections = butter(8, 23, "highpass", fs=500)
    return sosfilt(sections, rows, axis=0, zi=sosfilt_zi(sections)[:, :, None] * rows[0])[0]


def extremes(rows):
    """Smallest and largest of each of the last 200 pieces of 13 rows."""
    rows = np.vstack([np.full((2600, 6), np.nan), rows])
    pieces = rows[: len(rows) // 13 * 13][-2600:].reshape(-1, 13, 6)
    return np.stack([np.fmin.reduce(pieces, 1), np.fmax.reduce(pieces, 1)], 1).reshape(-1, 6)


@settings(max_examples=40)
@given(
    st.lists(st.integers(0, len(ROWS)), max_size=30).map(sorted),
    st.dictionaries(st.integers(1, len(ROWS) - 1), st.integers(1, 4000), max_size=4),
)
def test_traces_any_pieces_and_gaps_keep_the_extremes(borders, gaps):
    builder, at = new_builder(), 0
    for piece in np.split(ROWS, borders):
        inside = {row - at: n for row, n in gaps.items() if at <= row < at + len(piece)}
        builder.rows(block(piece, at + sum(n for row, n in gaps.items() if row < at), missing_before=inside))
        at += len(piece)
    seen = builder.build("armed")
    rows, residual = [], []
    for row, piece in zip([0, *sorted(gaps)], np.split(ROWS, sorted(gaps)), strict=True):
        nothing = np.full((min(gaps.get(row, 0), 2600), 6), np.nan)
        rows += [nothing, piece]
        residual += [nothing, high_passed(piece)]
    assert np.array_equal(seen.wrench, extremes(np.vstack(rows)), equal_nan=True)
    assert np.array_equal(seen.residual, extremes(np.vstack(residual)), equal_nan=True)
    assert np.array_equal(seen.latest, ROWS[-1])
    assert seen.time_s == (len(ROWS) + sum(gaps.values()) - 1) / 500
    assert 0 <= seen.row_age_s[-1] < 26 / 500 < 5 < seen.row_age_s[0] < 5.3
    assert (np.diff(seen.row_age_s) <= 0).all()


def test_rows_missed_are_lost_and_an_epoch_clears_the_traces():
    builder = new_builder()
    builder.rows(block(np.zeros((100, 6))))
    builder.rows(block(np.full((50, 6), 5.0), 140, missed=40))
    seen = builder.build("armed", counters={"missing": 2})
    assert seen.lost == 42
    assert np.nanmax(abs(seen.residual)) < 1e-9  # the high-pass begins anew: the step is none
    assert np.isnan(seen.wrench).all(axis=1).sum() > 2
    builder.rows(block(np.full((15, 6), -7.0), epoch=1, missed=9))
    seen = builder.build("armed")
    assert set(seen.wrench[np.isfinite(seen.wrench)]) == {-7.0}, "others are of the epoch before"


def test_histogram_stays_until_the_next_capture_has_rows():
    builder, seen = listening(1.0, step=50)
    times, losses = seen.ranking_history
    assert times.tolist() == pytest.approx(np.arange(1, 11) / 10)
    assert dict(zip(CLASSES, losses[-1].tolist(), strict=True)) == dict(seen.decision.ranking)
    builder.begin_capture()
    armed = builder.build("armed")
    assert len(armed.ranking_history[0]) == 10
    assert np.array_equal(armed.counts, seen.counts)
    builder.captured(WRENCH[:1])
    again = builder.build("triggered")
    assert len(again.ranking_history[0]) == 0
    assert again.counts.sum() <= 6 < seen.counts.sum()
    assert len(seen.ranking_history[0]) == 10  # snapshots do not change


def test_long_sessions_stay_small_and_the_last_outcome_is_held():
    builder = new_builder(classes=CLASSES)
    for i in range(700):
        seen = builder.build("triggered", answer(i / 10))
    assert len(seen.ranking_history[0]) <= 33
    assert builder.build("triggered", answer(0.1)).ranking_history[0].tolist() == [0.1], "it begins anew"
    for _ in range(100):
        builder.end_capture(Push(answer(3.2, final=True)))
    assert [outcome.number for outcome in builder.build("armed").history] == list(range(61, 101))
    states = ("idle", "armed", "ended", "triggered", "complete")
    assert [bool(builder.build(state).held) for state in states] == [True, True, True, False, False]


def test_hops_ranking_is_that_of_the_last_half_minute():
    seen = hopping()
    times, losses = seen.ranking_history
    assert (*times[[0, -1]], len(losses)) == pytest.approx((0.0, 30.0, 61))
    assert seen.words.answer.stage == "about the last 1.70 s"
    assert new_builder(40.0).build("idle").cutoff_hz == 10.0


END = listening(3.2)[1]
FINAL = "final, after 3.20 s"
LEAD = f"margin {END.decision.margin:.3f} ahead of cat litter"


@pytest.mark.parametrize(
    ("state", "known", "kind", "title"),
    [
        ("armed", None, "none", "no answer yet"),
        ("ended", None, "none", "no more pushes"),
        ("failed", None, "failed", "no answer"),
        ("triggered", {}, "provisional", "fine sugar"),
        ("complete", {}, "final", "fine sugar"),
        ("complete", {"unknown": True}, "unknown", "like no known material"),
    ],
)
def test_answer_in_words(state, known, kind, title):
    decision = None if known is None else answer(1.7, **known)
    words = replace(END, state=state, decision=decision, history=()).words
    assert words.answer[:2] == (kind, title)
    assert known is None or f": {title} (" in words.line


def test_line_has_all_that_matters():
    seen = replace(END, time_s=2.1, lag_s=0.03, counters={"missing": 3}, warnings=("gap", "the tool slipped"))
    assert seen.words.line == (
        f"SYNTHETIC  2.100 s  Done: fine sugar ({FINAL}, {LEAD})  |  lag 30.0 ms (!), lost 3 (!)"
        "  |  12 of 12 right  |  warning: gap: missing rows were filled in  |  warning: the tool slipped"
    )
    assert replace(seen, n_correct=None).words.score == "12 captures"


def test_last_outcome_is_shown_and_spoken_until_the_next_push():
    builder, _ = listening(1.0)
    builder.end_capture(Push(answer(3.2, final=True, warnings=("gap",)), truth="rice"))
    words = builder.build("armed", hint="push now").words
    assert (words.answer[:2], words.state) == (("final", "fine sugar"), "Armed: push now")
    sentence = "gap: missing rows were filled in"
    assert words.warnings == [sentence]
    assert words.spoken == f"Push 1. Final answer: fine sugar, wrong, it was rice, {LEAD}, {sentence}"
    builder.end_capture(Push(None, FailureReason.GAP, "12 rows are missing"))
    words = builder.build("triggered", answer(1.0)).words
    assert (words.answer.kind, words.state, words.warnings) == ("provisional", "Listening", [])
    assert words.spoken == "Push 2. no answer, 12 rows are missing"
    builder.end_capture(Push(answer(3.2, final=True, unknown=True), truth="macaroni brine"))
    (entry, *_) = builder.build("armed").words.history
    assert entry.detail == f"right, it was macaroni brine, nearest: fine sugar, {LEAD}"
