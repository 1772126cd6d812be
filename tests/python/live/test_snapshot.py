"""Snapshots tell the truth about the rows they were made of, and say it in words once for all views."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from granular_id import Decision, FeatureSpec, extract_features
from granular_id.live import FailureReason, Push, Snapshot, SnapshotBuilder
from granular_id.live.traces import RecentRows, outline
from granular_id.signal import butter, sosfilt, sosfilt_zi
from live_view_cases import CLASSES, answer, block, listening, push

ROWS, WRENCH = push()
SPECS = {
    "paper": FeatureSpec(),
    "clipped, steady": FeatureSpec(outside="clip", initial="steady", bin_range=(-0.1, 0.1), n_bins=7),
    "ranges by axis": FeatureSpec(bin_range=[(-1, 1)] * 3 + [(-0.1, 0.2)] * 3, order=3, cutoff_hz=40),
}


@st.composite
def cuts(draw, n):
    """Borders of the blocks into which n rows are cut; some are empty."""
    return sorted(draw(st.lists(st.integers(0, n), max_size=30)))


@pytest.mark.parametrize("spec", SPECS.values(), ids=SPECS)
@given(borders=cuts(len(WRENCH)))
def test_the_histogram_of_a_whole_capture_is_that_of_its_features(spec, borders):
    builder = SnapshotBuilder(500.0, spec)
    builder.captured(WRENCH[:100])
    builder.begin_capture()
    for piece in np.split(WRENCH, borders):
        builder.captured(piece)
    counts = builder.build("complete").counts
    assert np.array_equal(counts.ravel(), extract_features(WRENCH, spec=spec)[WRENCH.size :])


@given(borders=cuts(len(ROWS)))
def test_traces_do_not_depend_on_how_the_rows_arrive(borders):
    builder = SnapshotBuilder(500.0, view_s=1.0)
    at = 0
    for piece in np.split(ROWS, borders):
        builder.rows(block(piece, at))
        at += len(piece)
    seen = builder.build("armed")
    sections = butter(8, 23, "highpass", fs=500)
    left, _ = sosfilt(sections, ROWS, axis=0, zi=sosfilt_zi(sections)[:, :, None] * ROWS[0])
    assert np.array_equal(seen.wrench, ROWS[-500:])
    assert np.array_equal(seen.residual, left[-500:])
    assert np.array_equal(seen.latest, ROWS[-1])
    assert seen.time_s == (len(ROWS) - 1) / 500
    assert np.allclose(seen.row_age_s, np.arange(499, -1, -1) / 500)


def test_a_long_view_is_thinned_and_keeps_every_peak():
    builder = SnapshotBuilder(500.0, view_s=20.0)
    rows = np.random.default_rng(0).normal(size=(15_000, 6))
    rows[9_000] = 50.0
    rows[9_001] = -60.0
    for start in range(0, len(rows), 1000):
        builder.rows(block(rows[start : start + 1000], start))
    seen = builder.build("armed")
    assert len(seen.wrench) <= 600
    assert (seen.wrench.max(0) == 50.0).all()
    assert (seen.wrench.min(0) == -60.0).all()
    assert seen.row_age_s[-1] < 0.1
    assert np.array_equal(np.sort(seen.row_age_s)[::-1], seen.row_age_s)


def test_a_trace_that_moves_on_keeps_its_shape():
    rows = np.random.default_rng(0).normal(size=(4000, 1))
    early, late = outline(rows[:3000], 0, 9), outline(rows[500:3500], 500, 9)
    assert set(early[1][200:-4].ravel()) <= set(late[1].ravel())


@given(
    st.lists(st.one_of(st.floats(-1e9, 1e9), st.just(np.nan)), max_size=60),
    st.integers(0, 50),
    st.integers(1, 9),
)
def test_outline_is_the_extremes_of_each_piece(values, first, step):
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


@given(st.lists(st.tuples(st.booleans(), st.integers(0, 25)), max_size=20), st.integers(1, 12))
def test_recent_rows_are_the_end_of_all_rows(steps, capacity):
    recent, every = RecentRows(capacity, 1), []
    for number, (there, n) in enumerate(steps):
        if there:
            recent.add(np.full((n, 1), float(number)))
        else:
            recent.skip(n)
        every += [[float(number) if there else np.nan]] * n
    assert recent.total == len(every)
    wanted = np.array(every[-capacity:], float).reshape(-1, 1)
    assert np.array_equal(recent.last(capacity), wanted, equal_nan=True)


def test_what_never_came_is_a_gap_and_the_filter_starts_anew_behind_it():
    builder = SnapshotBuilder(500.0, view_s=1.0)
    rows = np.vstack([np.zeros((100, 6)), np.full((100, 6), 5.0)])
    builder.rows(block(rows, missing_before={100: 30}, missed=7))
    seen = builder.build("armed")
    assert np.isnan(seen.wrench[100:130]).all()
    assert np.isfinite(seen.wrench[:100]).all()
    assert np.isfinite(seen.wrench[130:]).all()
    assert len(seen.wrench) == 230
    assert abs(seen.residual[130:]).max() < 1e-9  # the step lies in the gap: nobody saw it
    assert seen.lost == 37
    builder.rows(block(rows[:1], missing_before={0: 4_000_000_000}))
    assert np.isnan(builder.build("armed").wrench[:-1]).all()


def test_rows_that_were_overwritten_are_a_gap_and_not_missing():
    builder = SnapshotBuilder(500.0, view_s=1.0)
    builder.rows(block(np.zeros((100, 6))))
    builder.rows(block(np.full((50, 6), 5.0), 140, missed=40))
    seen = builder.build("armed")
    assert np.isnan(seen.wrench[100:140]).all()
    assert np.isfinite(np.delete(seen.wrench, slice(100, 140), axis=0)).all()
    assert abs(seen.residual[140:]).max() < 1e-9
    assert (seen.counters["missing"], seen.counters["missed"], seen.counters["rows"]) == (0, 40, 150)
    builder.rows(block(np.full((5, 6), -7.0), epoch=1, missed=9))
    seen = builder.build("armed")
    assert len(seen.wrench) == 5, "those were of the epoch before"
    assert abs(seen.residual).max() < 1e-9  # the high-pass begins anew: the step to it is none
    assert seen.counters["epochs"] == 2


def test_histogram_and_ranking_stand_until_rows_of_the_next_capture_come():
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
    assert again.counts.sum() <= 6
    assert len(seen.ranking_history[0]) == 10  # snapshots do not change
    assert seen.counts.sum() > 0


def test_a_ranking_that_grows_for_ever_stays_small():
    builder = SnapshotBuilder(500.0, classes=CLASSES)
    for i in range(700):
        seen = builder.build("triggered", answer(i / 10))
    assert len(seen.ranking_history[0]) <= 240
    assert seen.ranking_history[0][-1] == pytest.approx(69.9)


def test_the_history_is_short_and_counts_all():
    builder = SnapshotBuilder(500.0, classes=CLASSES)
    assert builder.build("armed").held is None
    pushes = [Push(answer(3.2, final=True)) for _ in range(100)]
    for one in pushes:
        builder.end_capture(one)
    seen = builder.build("armed")
    assert [outcome.push for outcome in seen.history] == pushes[-40:]
    assert [outcome.number for outcome in seen.history] == list(range(61, 101))
    for state in ("idle", "arming", "armed", "ended"):
        assert builder.build(state).held.push is pushes[-1]
    for state in ("triggered", "complete", "failed"):
        assert builder.build(state).held is None


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: SnapshotBuilder(0.0), "rate_hz must be positive"),
        (lambda: SnapshotBuilder(1000.0, FeatureSpec()), "rate_hz is 1000, but spec was made for 500 Hz"),
        (lambda: SnapshotBuilder(500.0, view_s=-1.0), "view_s must be above 0"),
        (lambda: SnapshotBuilder(500.0, view_s=1e9), "view_s must be above 0 and hold at most"),
        (lambda: SnapshotBuilder(500.0, n_samples=0), "n_samples must be at least 1"),
        (lambda: SnapshotBuilder(500.0).rows(block(np.zeros((4, 3)))), r"block.wrench has shape \(4, 3\)"),
        (
            lambda: SnapshotBuilder(500.0).captured(np.full((4, 6), np.nan)),
            "rows holds values that are not finite",
        ),
        (lambda: SnapshotBuilder(500.0, classes=["a"]).build("armed", answer(1.0)), "ranks other materials"),
    ],
)
def test_what_does_not_fit_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_a_slow_source_has_a_lower_cutoff():
    assert SnapshotBuilder(40.0).build("idle").cutoff_hz == 10.0


MIDDLE, END = listening(1.7)[1], listening(3.2)[1]
PROVISIONAL = "provisional, 1.70 s of 3.20 s"
LEAD = rf"margin {END.decision.margin:.3f} ahead of cat litter"


def middle(state="triggered", **options):
    return replace(MIDDLE, state=state, decision=answer(1.7, **options))


def end(**options):
    return replace(END, decision=answer(3.2, final=True, **options))


@pytest.mark.parametrize(
    ("snapshot", "kind", "title", "stage", "detail"),
    [
        (Snapshot("idle", hint="press Enter"), "none", "no answer yet", "press Enter", ""),
        (Snapshot("armed"), "none", "no answer yet", "armed", ""),
        (Snapshot("complete"), "none", "recorded", "done", ""),
        (Snapshot("ended", hint="it is over"), "none", "no more pushes", "it is over", ""),
        (Snapshot("failed", hint="a gap"), "failed", "no answer", "the capture failed", "a gap"),
        (middle(), "provisional", "fine sugar", PROVISIONAL, "margin"),
        (middle(sure=True), "provisional", "fine sugar", f"{PROVISIONAL}, sure enough to stop", "margin"),
        (
            middle(settled=True),
            "provisional",
            "fine sugar",
            f"{PROVISIONAL}, can no longer change (forces as in training)",
            "margin",
        ),
        (
            middle("complete", sure=True),
            "final",
            "fine sugar",
            "early, 1.70 s of 3.20 s, sure enough to stop",
            "margin",
        ),
        (end(), "final", "fine sugar", "final, after 3.20 s", LEAD),
        (end(probability=0.934), "final", "fine sugar", "final, after 3.20 s", f"{LEAD}, probability 93 %"),
        (end(candidates=("rice",)), "final", "fine sugar", "final, after 3.20 s", LEAD),
        (end(candidates=("a", "b")), "final", "fine sugar", "final, after 3.20 s", f"{LEAD}, may be a or b"),
        (
            end(candidates=CLASSES),
            "final",
            "fine sugar",
            "final, after 3.20 s",
            f"{LEAD}, may be {' or '.join(CLASSES[:6])} or {len(CLASSES) - 6} more",
        ),
        (
            end(unknown=True),
            "unknown",
            "like no known material",
            "final, after 3.20 s",
            f"nearest: fine sugar, {LEAD}",
        ),
    ],
)
def test_answers_in_words(snapshot, kind, title, stage, detail):
    words = snapshot.words
    assert words.answer[:3] == (kind, title, stage)
    assert words.answer.detail == detail or (detail == "margin" and words.answer.detail.startswith("margin"))
    given = f"{words.state}: {title} ({stage}, {words.answer.detail})"
    hint = f"{words.state}: {snapshot.hint}" if snapshot.hint else words.state
    assert (hint if kind in ("none", "failed") else given) in words.line


def test_a_line_has_all_that_matters():
    seen = replace(END, time_s=2.1, lag_s=0.03, counters={"missing": 3}, warnings=("gap", "the tool slipped"))
    assert seen.words.line == (
        f"SYNTHETIC  2.100 s  Done: fine sugar (final, after 3.20 s, {LEAD})  |  lag 30.0 ms (!), lost 3 (!)"
        "  |  12 of 12 right  |  warning: gap: missing rows were filled in  |  warning: the tool slipped"
    )
    assert replace(seen, n_correct=None).words.score == "12 captures"


def test_the_last_outcome_is_held_and_spoken_until_the_next_push_begins():
    builder, _ = listening(1.0)
    builder.end_capture(Push(answer(3.2, final=True, warnings=("gap",)), truth="rice"))
    words = builder.build("armed", hint="push now").words
    assert words.answer[:2] == ("final", "fine sugar")
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


def decided(**options):
    return Decision("rice", (("rice", 0.1), ("salt", 0.3)), 0.2, seconds=3.2, final=True, **options)


@pytest.mark.parametrize(
    ("push", "said"),
    [
        (Push(decided()), ""),
        (Push(decided(), truth="rice"), "  right"),
        (Push(decided(), truth="salt"), "  WRONG, it was salt"),
        (Push(decided(), truth="macaroni"), "  WRONG, it was macaroni, which the model does not know"),
        (
            Push(decided(unknown=True), truth="macaroni"),
            "  right, it was macaroni, which the model does not know",
        ),
        (Push(decided(unknown=True), truth="rice"), "  WRONG, it was rice"),
    ],
)
def test_a_push_in_one_line(push, said):
    assert str(push) == f"{push.decision}{said}"
    assert push.to_dict() == {"decision": push.decision.to_dict(), "failure": None, "truth": push.truth}


def test_a_push_without_an_answer():
    push = Push(None, FailureReason.GAP, "12 rows are missing")
    assert str(push) == "no answer: 12 rows are missing"
    assert push.to_dict() == {
        "decision": None,
        "failure": {"reason": "gap", "text": push.text},
        "truth": None,
    }
