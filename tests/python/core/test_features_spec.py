"""FeatureSpec: one checked, immutable, comparable, picklable value, and one clear error for each bad one."""

import copy
import pickle

import joblib
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from granular_id import FeatureSpec
from granular_id.features import extract_features, feature_names

WRENCH = np.random.default_rng(0).standard_normal((2, 20, 6))

PARAMETERS = {
    "rate_hz": 100.0,
    "cutoff_hz": 9.25,
    "order": 3,
    "n_bins": 17,
    "bin_range": ((-1.0, 1.0), (0.1, 0.30000000000000004)),
    "raw": False,
    "hfmh": True,
    "outside": "clip",
    "density": True,
    "initial": "steady",
}


@st.composite
def specs(draw):
    rate_hz = draw(st.floats(1e-3, 1e6))
    low = draw(st.floats(-1e3, 1e3))
    pair = st.floats(0.01, 1e3).map(lambda width: (low, low + width))
    return FeatureSpec(
        rate_hz=rate_hz,
        cutoff_hz=rate_hz * draw(st.floats(0.01, 0.49)),
        order=draw(st.integers(1, 32)),
        n_bins=draw(st.integers(1, 32_768)),
        bin_range=draw(pair | st.lists(pair, min_size=1, max_size=7)),
        raw=draw(st.booleans()),
        hfmh=True,
        outside=draw(st.sampled_from(["drop", "clip"])),
        density=draw(st.booleans()),
        initial=draw(st.sampled_from(["zero", "steady"])),
    )


@settings(max_examples=40)
@given(specs())
def test_repr_pickle_and_copies_give_an_equal_spec(spec):
    same = [eval(repr(spec), {"FeatureSpec": FeatureSpec}), copy.copy(spec), copy.deepcopy(spec)]
    same += [pickle.loads(pickle.dumps(spec, protocol)) for protocol in range(2, pickle.HIGHEST_PROTOCOL + 1)]
    for other in same:
        assert type(other) is FeatureSpec
        assert other == spec
        assert not other != spec  # noqa: SIM202 - the two operators are two functions
        assert hash(other) == hash(spec)
        assert repr(other) == repr(spec)
    assert {joblib.hash(other) for other in same} == {joblib.hash(spec)}


def test_the_default_is_the_paper():
    assert FeatureSpec() == FeatureSpec(
        rate_hz=500.0,
        cutoff_hz=23.0,
        order=8,
        n_bins=100,
        bin_range=(-1.5, 1.5),
        raw=True,
        hfmh=True,
        outside="drop",
        density=False,
        initial="zero",
    )
    assert FeatureSpec().n_features(1600, 6) == len(feature_names()) == 10_200


@pytest.mark.parametrize("name", PARAMETERS)
def test_every_parameter_counts_and_stays(name):
    change = {name: PARAMETERS[name] if name != "hfmh" else False}
    spec = FeatureSpec(**change)
    assert getattr(spec, name) == change[name]
    assert spec != FeatureSpec()
    assert hash(spec) != hash(FeatureSpec())
    assert {spec: "a", FeatureSpec(): "b"}[FeatureSpec(**change)] == "a"
    with pytest.raises(AttributeError):
        setattr(spec, name, getattr(FeatureSpec(), name))
    with pytest.raises(AttributeError):
        delattr(spec, name)
    assert getattr(spec, name) == change[name]


def test_numbers_of_numpy_are_numbers():
    spec = FeatureSpec(
        rate_hz=np.float32(500),
        cutoff_hz=np.int64(23),
        order=np.uint8(8),
        n_bins=np.int16(100),
        bin_range=np.array([-1.5, 1.5], np.float32),
        raw=np.True_,
        density=np.False_,
    )
    assert spec == FeatureSpec()
    assert FeatureSpec(bin_range=[-0.0, 1]) == FeatureSpec(bin_range=(0.0, 1))
    assert hash(FeatureSpec(bin_range=[-0.0, 1])) == hash(FeatureSpec(bin_range=(0.0, 1)))


BAD = [
    ({"rate_hz": 0}, ValueError, "rate_hz must be positive and finite, got 0"),
    ({"rate_hz": np.inf}, ValueError, "rate_hz must be positive and finite, got inf"),
    ({"rate_hz": 10**400}, ValueError, "rate_hz"),
    ({"cutoff_hz": 0}, ValueError, r"cutoff_hz must be in \(0, rate_hz / 2\) = \(0, 250\), got 0"),
    ({"cutoff_hz": 250}, ValueError, "cutoff_hz .* got 250 at rate_hz = 500"),
    ({"cutoff_hz": 30, "rate_hz": 50}, ValueError, r"cutoff_hz .*\(0, 25\), got 30 at rate_hz = 50"),
    ({"order": 10**5000}, ValueError, "order must be"),
    ({"bin_range": (1.5, -1.5)}, ValueError, r"bin_range .* finite with low < high, got \(1.5, -1.5\)"),
    ({"bin_range": (np.nan, 1)}, ValueError, r"bin_range must be finite .* got \(NaN, 1\.0\)"),
    ({"bin_range": ((0, 1), (2, 2))}, ValueError, r"bin_range .* got \(2\.0, 2\.0\)"),
    ({"bin_range": (1, 1 + 1e-15)}, ValueError, "bin_range must hold 100 bins of finite size"),
    ({"bin_range": (-1e308, 1e308)}, ValueError, "bin_range"),
    ({"bin_range": np.ones((0, 2))}, ValueError, r"bin_range must have shape .* got \(0, 2\)"),
    ({"raw": 1}, TypeError, "int.*raw"),
    ({"raw": False, "hfmh": False}, ValueError, "raw or hfmh must be true"),
    ({"outside": "Drop"}, ValueError, "outside must be 'drop' or 'clip', got .Drop."),
    ({"outside": 3}, TypeError, "int.*outside"),
    ({"initial": "rest"}, ValueError, "initial must be 'zero' or 'steady', got .rest."),
    ({"bins": 3}, TypeError, "unexpected keyword argument 'bins'"),
]
BAD_IDS = [f"{next(iter(keywords))}-{n}" for n, (keywords, *_) in enumerate(BAD)]


@pytest.mark.parametrize(("keywords", "error", "message"), BAD, ids=BAD_IDS)
def test_bad_parameters(keywords, error, message):
    calls = [
        lambda: FeatureSpec(**keywords),
        lambda: extract_features(WRENCH, **keywords),
        lambda: feature_names(**keywords),
    ]
    for call in calls:
        with pytest.raises(error, match=f"(?s){message}"):
            call()


def test_spec_or_keywords_but_not_both():
    spec = FeatureSpec(n_bins=5)
    for call in (lambda **k: extract_features(WRENCH, **k), feature_names):
        with pytest.raises(ValueError, match="not both: got spec and n_bins, order"):
            call(spec=spec, order=8, n_bins=5)
        for wrong in ({}, "FeatureSpec()", FeatureSpec, 0):
            with pytest.raises(TypeError, match="spec must be a FeatureSpec, got"):
                call(spec=wrong)
    by_spec = extract_features(WRENCH, spec=spec)
    assert np.array_equal(by_spec, extract_features(WRENCH, n_bins=5))
    with pytest.raises(TypeError):
        extract_features(WRENCH, spec)  # by keyword only


def test_histograms_alone_need_a_range_for_each_axis():
    ranges = [(-1, 1)] * 5
    with pytest.raises(ValueError, match=r"bin_range .* got 5 ranges for 6 axes"):
        extract_features(WRENCH, bin_range=ranges)
    assert extract_features(WRENCH, bin_range=ranges, hfmh=False).shape == (2, 120)


@pytest.mark.parametrize(
    "sizes", [{"n_samples": -1}, {"n_axes": -1}, {"n_samples": 10**30}, {"n_samples": 2**62}]
)
def test_impossible_sizes_are_refused(sizes):
    for call in (feature_names, FeatureSpec().n_features):
        with pytest.raises((ValueError, MemoryError), match="must"):
            call(**{"n_samples": 1600, "n_axes": 6} | sizes)
