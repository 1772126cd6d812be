"""StreamingExtractor against batches; sliding windows against scipy's filter of the whole stream and numpy's counts."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import features_twin as twin
from core_cases import fill
from effort import cases
from granular_id import FeatureSpec, extract_features
from granular_id._core import StreamingExtractor

X = np.random.default_rng(51).standard_normal((40, 6))
LARGEST = 1e100  # of the values that streams take


@st.composite
def streams(draw, longest=300):
    """A specification with any options, a stream for it, and sizes of blocks."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    n_axes = draw(st.sampled_from([6, 6, 1, 2, 9]))
    options = twin.some_options(rng, n_axes)
    rows = twin.a_wrench(rng, (1, draw(st.integers(1, longest)), n_axes))[0].clip(-LARGEST, LARGEST)
    blocks = draw(st.lists(st.integers(0, 70), min_size=1, max_size=12))
    return options, rows, blocks


@settings(max_examples=cases(30))
@given(streams())
def test_a_stream_equals_the_batch(case):
    options, rows, blocks = case
    wanted = extract_features(rows, **options)
    stream = StreamingExtractor(FeatureSpec(**options), n_samples=len(rows), n_axes=rows.shape[1])
    for _ in range(2):
        assert fill(stream, rows, blocks) == len(rows) == stream.n_seen
        assert stream.push(rows) == 0
        assert twin.differing_bits(stream.features(), wanted) == 0
        stream.reset()
        assert stream.n_seen == 0


@settings(max_examples=cases(30))
@given(streams(), st.integers(1, 60), st.integers(1, 80))
def test_sliding_windows_equal_scipy_and_numpy(case, n_samples, hop):
    options, rows, blocks = case
    n_axes = rows.shape[1]
    stream = StreamingExtractor(FeatureSpec(**options), n_samples=n_samples, n_axes=n_axes, hop=hop)
    filtered = twin.high_passed(rows[None], **options)[0]
    ranges = np.broadcast_to(options["bin_range"], (n_axes, 2))
    rules = {name: options[name] for name in ("outside", "density")}
    taken = 0
    for first in range(0, len(rows) - n_samples + 1, hop):
        taken += fill(stream, rows[taken:], blocks)
        assert (stream.first_row, taken) == (first, first + n_samples)
        window = slice(first, first + n_samples)
        parts = [np.zeros(0)]
        if options["raw"]:
            parts.append(rows[window].T.ravel())
        if options["hfmh"]:
            parts += [
                twin.counts(filtered[window, axis], options["n_bins"], *ranges[axis], **rules)
                for axis in range(n_axes)
            ]
        assert twin.differing_bits(stream.features(), np.concatenate(parts)) == 0
        stream.next()
    taken += fill(stream, rows[taken:], blocks)
    assert taken == len(rows)
    assert not stream.is_complete


def test_rows_come_singly_or_not_at_all():
    stream = StreamingExtractor(FeatureSpec(), n_samples=40)
    assert [stream.push(row) for row in X[:39]] == [1] * 39
    assert stream.push(np.zeros((0, 6))) == 0
    assert stream.push(X[39].tolist()) == 1
    assert np.array_equal(stream.features(), extract_features(X))
    one = StreamingExtractor(FeatureSpec(initial="steady"), n_samples=1)
    assert one.push(X) == 1
    assert np.array_equal(one.features(), extract_features(X[:1], initial="steady"))


def test_features_into_an_array_of_ones_own():
    stream = StreamingExtractor(FeatureSpec(n_bins=10), n_samples=40)
    stream.push(X)
    out = np.full(300, np.nan)
    assert stream.features(out) is out
    assert np.array_equal(out, stream.features(out=None))


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


def test_it_says_what_it_is():
    spec = FeatureSpec(n_bins=10)
    stream = StreamingExtractor(spec, n_samples=40, n_axes=3, hop=5)
    assert (stream.spec, stream.n_samples, stream.n_axes, stream.hop) == (spec, 40, 3, 5)
    assert stream.n_features == 150
    assert repr(stream) == f"StreamingExtractor({spec!r}, n_samples=40, n_axes=3, hop=5)"
