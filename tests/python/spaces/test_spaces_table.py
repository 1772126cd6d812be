"""The paper's table of feature spaces."""

import numpy as np
import pytest
from sklearn.pipeline import FeatureUnion

from granular_id.spaces import FeatureSpace, feature_spaces
from spaces_cases import recordings

PAPER = {
    "raw+hfmh": 0.9705,
    "norm-raw+hfmh": 0.9303,
    "norm-raw": 0.8731,
    "hfmh": 0.8705,
    "raw+dft": 0.7712,
    "norm-raw+dft": 0.7686,
    "dft": 0.7621,
    "raw": 0.7614,
    "pca+rica": 0.7602,
    "pca": 0.7527,
    "raw-histogram": 0.7072,
}
OURS = ("multiband", "best")


def small(spaces):
    """The same, with fewer components than recordings, and one start of RICA."""
    for name, few in (("pca", {"pca__n_components": 3}), ("pca+rica", {"pca__n_components": 3})):
        spaces[name].transformer.set_params(**few)
    spaces["pca+rica"].transformer.set_params(rica__n_components=2, rica__random_state=0)
    return spaces


def test_spaces_are_the_papers_then_ours_then_the_control():
    spaces = feature_spaces()
    assert list(spaces)[: len(PAPER)] == list(PAPER)
    assert {name: spaces[name].paper_accuracy for name in PAPER} == PAPER
    for name, space in list(spaces.items())[len(PAPER) : -1]:
        assert space.paper_accuracy is None
        assert "not in the paper" in space.note, name
    assert all(spaces[name].classifier is not None for name in OURS)
    assert list(spaces)[-1] == "time-permuted"
    assert spaces["time-permuted"].paper_accuracy is None
    assert "20 %" in spaces["time-permuted"].note
    assert all(isinstance(space, FeatureSpace) and space.name == name for name, space in spaces.items())


@pytest.mark.parametrize("tare_s", [None, 0.1])
@pytest.mark.parametrize("name", feature_spaces())
def test_each_space_gives_named_features_of_other_recordings(name, tare_s):
    space = small(feature_spaces(tare_s=tare_s, threads=1))[name]
    transformer = space.transformer.fit(recordings())
    features = transformer.transform(recordings(n=2, seed=1))
    names = transformer.get_feature_names_out()
    assert features.shape == (2, len(names))
    assert features.dtype == np.float64
    assert len(set(names)) == len(names)


def test_spaces_share_no_transformer():
    spaces = feature_spaces()
    spaces["norm-raw+dft"].transformer.set_params(dft__kind="magnitude")
    assert spaces["raw+dft"].transformer.get_params()["dft__kind"] == "complex"
    assert spaces["dft"].transformer.kind == "complex"
    parts = [
        id(value)
        for space in spaces.values()
        for value in (space.transformer, *space.transformer.get_params().values())
        if hasattr(value, "fit")
    ]
    assert len(set(parts)) == len(parts)


@pytest.mark.parametrize(
    ("how", "more"),
    [
        ({}, set()),
        ({"bin_range": "auto"}, {"raw+hfmh", "norm-raw+hfmh", "hfmh"}),
        ({"block_weights": "unit"}, {"raw+hfmh"}),
    ],
)
def test_what_learns(how, more):
    learning = {name for name, space in feature_spaces(**how).items() if space.learns}
    assert learning == {*OURS, "pca", "pca+rica", "raw-histogram"} | more


def test_parameters_reach_every_space():
    own = {"rate_hz": 100.0, "cutoff_hz": 9.0, "order": 4, "initial": "steady", "threads": 1}
    ranges = [[-0.5, 0.5]] * 3 + [[-0.1, 0.1]] * 3
    spaces = feature_spaces(**own, n_bins=20, bin_range=ranges, tare_s=0.3, block_weights=(1.0, 0.5))
    seen = {key: set() for key in (*own, "n_bins", "tare_s")}
    for space in spaces.values():
        for name, value in space.transformer.get_params(deep=True).items():
            key = name.rpartition("__")[2]
            if key in seen:
                seen[key].add(value)
            if key == "bin_range":
                assert value is ranges or value == "auto"
            if key == "block_weights":
                assert value == (1.0, 0.5)
    assert seen == {key: {value} for key, value in {**own, "n_bins": 20, "tare_s": 0.3}.items()}


def test_tare_takes_the_offset_out_of_every_space():
    X = recordings()
    offset = np.array([5.0, -3.0, 8.0, 0.25, 0.5, -0.25])
    # Offsets and samples on a grid of 2**-20: sums and differences are exact, and so must be the features.
    X = np.round(X * 2**20) / 2**20
    X[:, :50] = 0.0
    for name, space in small(feature_spaces(tare_s=0.1)).items():
        there = space.transformer.fit_transform(X + offset)
        np.testing.assert_allclose(there, space.transformer.fit_transform(X), atol=1e-9, err_msg=name)


def test_normalised_spaces_normalise_the_raw_block_only():
    X = recordings()
    spaces = feature_spaces()
    for name, other in (("norm-raw+hfmh", "hfmh"), ("norm-raw+dft", "dft")):
        union = spaces[name].transformer
        assert isinstance(union, FeatureUnion)
        both = union.fit_transform(X)
        np.testing.assert_array_equal(both[:, :1800], spaces["norm-raw"].transformer.fit_transform(X))
        np.testing.assert_array_equal(both[:, 1800:], spaces[other].transformer.fit_transform(X))
