"""Streams: their windows against scipy and numpy, their answers against those of whole recordings."""

import json
import pickle

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import features_twin as twin
from core_cases import N_THREADS, at_once, fill
from effort import cases
from granular_id import FeatureSpec, _core, extract_features
from granular_id._core import StreamingExtractor
from granular_id.ecoc import LOSSES, onevsall, onevsone
from granular_id.identifier import Decision, Identifier, StreamingIdentifier
from model_cases import random_model, small_model

X = np.random.default_rng(51).standard_normal((40, 6))


def test_rows_come_singly_or_not_at_all():
    stream = StreamingExtractor(FeatureSpec(), n_samples=40)
    assert [stream.push(row) for row in X[:39]] == [1] * 39
    assert stream.push(np.zeros((0, 6))) == 0
    assert stream.push(X[39].tolist()) == 1
    out = np.full(840, np.nan)
    assert stream.features(out) is out
    assert np.array_equal(out, extract_features(X))
    one = StreamingExtractor(FeatureSpec(initial="steady"), n_samples=1)
    assert one.push(X) == 1
    assert np.array_equal(one.features(), extract_features(X[:1], initial="steady"))


def test_a_refused_row_changes_nothing():
    stream = StreamingExtractor(FeatureSpec(), n_samples=40)
    stream.push(X[:10])
    before = stream.features()
    bad = X[10:].copy()
    bad[7, 4] = -np.inf
    with pytest.raises(ValueError, match="must be finite, got -inf in row 7, axis 4; no row was taken"):
        stream.push(bad)
    with pytest.raises(ValueError, match=r"wrench is too large: 1\.7e308 in row 7, axis 4"):
        stream.push(np.nan_to_num(bad, neginf=1.7e308))
    assert np.array_equal(stream.features(), before)
    assert stream.push(X[10:]) == 30


@pytest.mark.parametrize(
    ("keywords", "error", "message"),
    [
        ({"n_samples": 0}, ValueError, "n_samples must be .*, got 0"),
        ({"n_samples": 2**23}, ValueError, "a window must hold at most 16777216 values"),
        ({"n_axes": 3}, ValueError, "got 6 ranges for 3 axes"),
    ],
)
def test_impossible_windows_are_refused(keywords, error, message):
    spec = FeatureSpec(bin_range=[(-1, 1)] * 6) if "n_axes" in keywords else FeatureSpec()
    with pytest.raises(error, match=message):
        StreamingExtractor(spec, **keywords)


def test_next_without_a_complete_window_and_a_hop_is_refused():
    for hop, message in ((None, "a stream without hop has one window"), (7, "0 of 40 samples are there")):
        with pytest.raises(ValueError, match=message):
            StreamingExtractor(FeatureSpec(), n_samples=40, hop=hop).next()


def stream_of(core, **options):
    return StreamingIdentifier(Identifier(core), **options)


def scores_of(model, features, share=1.0, rest=0.0):
    """Scores from features in the promised order of addition; counts scaled and the rest of the raw sums given."""
    coef, n_raw = model.coef, model.n_samples * model.n_axes if model.spec.raw else 0
    by_time = np.arange(n_raw).reshape(model.n_axes, -1).T.ravel() if n_raw else []
    raw, hist = np.zeros(len(coef)), np.zeros(len(coef))
    for j in by_time:
        raw += coef[:, j] * features[j]
    for j in range(n_raw, len(features)):
        if features[j] != 0.0:
            hist += coef[:, j] * (features[j] * share)
    return (model.intercept + (raw + rest if n_raw else raw)) + hist


@st.composite
def identifications(draw, longest=80):
    """A model with any options, rows for it, and sizes of blocks."""
    seed = draw(st.integers(0, 2**32))
    rng = np.random.default_rng(seed)
    n_axes, n_samples = draw(st.sampled_from([6, 1, 3])), draw(st.integers(1, longest))
    n_classes = draw(st.integers(2, 6))
    matrix = draw(st.sampled_from([onevsone, onevsall]))(n_classes)
    model = random_model(
        seed,
        n_classes,
        n_samples,
        n_axes,
        FeatureSpec(**twin.some_options(rng, n_axes)),
        coding_matrix=matrix,
        loss=draw(st.sampled_from(sorted(LOSSES))),
    )
    rows = np.clip(twin.a_wrench(rng, (1, n_samples, n_axes))[0], -1e6, 1e6)
    return model, rows, draw(st.lists(st.integers(0, 40), min_size=1, max_size=8))


@settings(max_examples=cases(30))
@given(identifications())
def test_the_final_answer_is_that_of_the_whole_recording(case):
    model, rows, blocks = case
    scores = model.scores(rows)
    losses = model.losses(scores)[0]
    stream = stream_of(model)
    for _ in range(2):
        assert fill(stream, rows, blocks) == len(rows)
        decision = stream.decision()  # what provisional answers leave behind must not matter
        assert twin.differing_bits(stream.core.scores(), scores[0]) == 0
        assert twin.differing_bits(stream.core.losses(), losses) == 0
        order = np.argsort(losses, kind="stable")
        assert decision.ranking == tuple((model.classes[k], losses[k]) for k in order)
        assert decision.label == model.classes[losses.argmin()]
        assert decision.margin == losses[order[1]] - losses[order[0]]
        assert (decision.final, decision.n_seen) == (True, len(rows))
        assert decision.seconds == len(rows) / model.spec.rate_hz
        stream.reset()


@settings(max_examples=cases(20))
@given(identifications(longest=40), st.data())
def test_a_provisional_answer_fills_up_what_is_missing(case, data):
    model, rows, blocks = case
    n_samples, n_axes = rows.shape
    spec = model.spec
    mean = np.random.default_rng(1).normal(size=n_samples * n_axes)
    if spec.raw:
        parts, keywords = model.__getnewargs_ex__()
        model = type(model)(*parts, **{**keywords, "raw_mean": mean})
    n_seen = data.draw(st.integers(0, n_samples - 1))
    features = _core.StreamingExtractor(spec, n_samples=n_samples, n_axes=n_axes)
    stream = stream_of(model)
    for one in (features, stream):
        fill(one, rows[:n_seen], blocks)
    unseen = (np.arange(n_samples * n_axes) % n_samples) >= n_seen
    rest = model.coef[:, : len(mean)][:, unseen] @ mean[unseen] if spec.raw else 0.0
    share = 1.0 if spec.density else n_samples / max(n_seen, 1)
    wanted = scores_of(model, features.features(), share, rest)
    np.testing.assert_allclose(stream.core.scores(), wanted, rtol=1e-9, atol=1e-9)
    assert not stream.decision().final
    # ... and leaves no trace in the final one.
    stream.push(rows[n_seen:])
    assert twin.differing_bits(stream.core.scores(), model.scores(rows)[0]) == 0


def test_stream_has_the_features_and_scores_of_each_window():
    """With all options, rows and blocks they are compared in ``tests/core/stream.rs``."""
    model, taken = random_model(0, 4, 20, 6, FeatureSpec(n_bins=9)), 0
    features, stream = StreamingExtractor(model.spec, n_samples=20, hop=7), stream_of(model, hop=7)
    filtered = twin.high_passed(X[None])[0]
    for first in (0, 7, 14):
        fill(features, X[taken:], [3, 0, 5])
        taken += fill(stream, X[taken:], [2, 9])
        assert (features.first_row, taken) == (first, first + 20)
        window = slice(first, first + 20)
        counts = [twin.counts(filtered[window, axis], 9, -1.5, 1.5) for axis in range(6)]
        wanted = np.concatenate([X[window].T.ravel(), *counts])
        assert twin.differing_bits(features.features(), wanted) == 0
        assert twin.differing_bits(stream.core.scores(), scores_of(model, wanted)) == 0
        features.next()
        stream.next()
    assert taken + fill(stream, X[taken:], [9]) == len(X)
    assert not stream.is_complete


def test_sure_as_the_model_says():
    model = small_model(early=[[2, 0.0], [4, 1e300]])
    stream = stream_of(model)
    sure = []
    for _ in range(5):
        sure.append(stream.decision().sure)
        stream.push([0.1, -0.2])
    assert sure == [False, False, True, True, False]
    assert not stream.decision().sure
    assert not stream_of(small_model(early=None)).decision().sure


def test_warnings_last_as_long_as_the_spoilt_samples():
    stream = stream_of(random_model(0, 3, 4, 1, FeatureSpec(n_bins=4)), hop=2)
    stream.push(np.zeros((1, 1)))
    stream.warn("gap")
    stream.warn("gap")
    stream.push(np.zeros((2, 1)))
    stream.warn("saturation")
    assert stream.decision().warnings == ("gap", "saturation")
    stream.push(np.zeros((1, 1)))
    stream.next()
    assert stream.decision().warnings == ("saturation",)
    stream.reset()
    assert stream.decision().warnings == ()
    with pytest.raises(TypeError, match="what must be a str, got int"):
        stream.warn(3)


def test_scores_that_leave_float64_are_refused():
    model = random_model(0, 2, 2, 1, FeatureSpec(hfmh=False), scale=1e300)
    stream = stream_of(model)
    stream.push([1e99])
    with pytest.raises(ValueError, match="score"):
        stream.decision()
    stream.reset()
    assert stream.decision().n_seen == 0


def test_bad_arguments():
    model = small_model()
    with pytest.raises(TypeError, match="identifier must be an Identifier, got str"):
        StreamingIdentifier("rice")
    with pytest.raises(ValueError, match="hop must be an integer of at least 1, got 0"):
        stream_of(model, hop=0)
    with pytest.raises(ValueError, match=r"wrench must have shape \(k, 2\) or \(2,\), got \(3, 6\)"):
        stream_of(model).push(np.zeros((3, 6)))
    with pytest.raises(ValueError, match="a stream without hop has one window"):
        stream_of(model).next()
    assert repr(stream_of(model, hop=3)) == f"StreamingIdentifier({model!r}, hop=3)"
    assert repr(stream_of(model).core) == f"StreamingIdentifier({model!r}, hop=None)"


def test_decisions_from_other_threads_while_rows_arrive():
    model = random_model(0, 5, 4000, 6, FeatureSpec(n_bins=20))
    rows = np.random.default_rng(0).normal(size=(4000, 6))
    stream = stream_of(model)

    def watch():
        seen = [stream.decision().n_seen for _ in range(300)]
        return seen == sorted(seen)

    def push():
        return sum(stream.push(block) for block in np.array_split(rows, 400))

    results = at_once([push] + [watch] * (N_THREADS - 1))
    assert results == [4000] + [True] * (N_THREADS - 1)
    assert np.array_equal(stream.core.scores(), model.scores(rows)[0])


def test_decision_survives_json_and_pickle():
    ranking = (("rice", 0.1), ("salt", 0.3))
    known = {"probability": 0.5, "final": True, "n_seen": 1600, "seconds": 3.2, "warnings": ("gap",)}
    decision = Decision("rice", ranking, 0.2, **known)
    assert str(decision) == "rice after 3.20 s, final: margin 0.200 ahead of salt, probability 0.500 (gap)"
    again = pickle.loads(pickle.dumps(decision))
    assert again == decision
    stored = json.loads(json.dumps(decision.to_dict()))
    assert stored.pop("ranking") == [list(pair) for pair in ranking]
    assert stored == {
        "label": "rice",
        "margin": 0.2,
        "probability": 0.5,
        "final": True,
        "sure": False,
        "n_seen": 1600,
        "seconds": 3.2,
        "warnings": ["gap"],
        "candidates": [],
        "unknown": None,
    }
