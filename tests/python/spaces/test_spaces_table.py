"""The paper's table of feature spaces."""

import numpy as np
from sklearn.pipeline import FeatureUnion

from granular_id.spaces import all_spaces, feature_spaces, paper_spaces
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
    for name in ("pca", "pca+rica"):
        spaces[name].transformer.set_params(pca__n_components=3)
    spaces["pca+rica"].transformer.set_params(rica__n_components=2, rica__random_state=0)
    return spaces


def test_spaces_are_the_papers_then_ours_then_the_control():
    spaces = feature_spaces()
    assert list(spaces) == [*PAPER, *OURS, "time-permuted"]
    assert all_spaces(spaces) == [*OURS[::-1], *PAPER]
    assert paper_spaces(spaces) == [*PAPER, "time-permuted"]
    for name, space in spaces.items():
        assert space.name == name
        assert space.paper_accuracy == PAPER.get(name)
        assert space.control == (name == "time-permuted")
        assert (space.classifier is not None) == (name in OURS)


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
        names = space.transformer.get_feature_names_out()
        assert len(set(names)) == len(names) == there.shape[1]


def test_normalised_spaces_normalise_the_raw_block_only():
    X = recordings()
    spaces = feature_spaces()
    for name, other in (("norm-raw+hfmh", "hfmh"), ("norm-raw+dft", "dft")):
        union = spaces[name].transformer
        assert isinstance(union, FeatureUnion)
        parts = [spaces[part].transformer.fit_transform(X) for part in ("norm-raw", other)]
        np.testing.assert_array_equal(union.fit_transform(X), np.hstack(parts))
