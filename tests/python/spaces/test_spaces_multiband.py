"""Multi-band features of a space: those of the twin, kept by copies, and what is said of short recordings."""

import pickle

import numpy as np
from sklearn.base import clone

import multiband_twin as twin
from granular_id.spaces.multiband import ALL_BLOCKS, MultiBand
from spaces_cases import recordings


def test_features_are_those_of_the_twin_and_copies_keep_them():
    X = recordings()
    space = MultiBand(blocks=ALL_BLOCKS).fit(X)
    scales, levels = twin.learned_scales(X)
    wanted = [twin.features(x, scales, levels) for x in X]
    np.testing.assert_allclose(space.transform(X), wanted, atol=2e-5)
    assert space.bands_[2].n_samples == twin.band_lengths(X.shape[1])[2]
    same = pickle.loads(pickle.dumps(space))
    assert same.extractor_ == space.extractor_
    for copy in (same, clone(space)):
        assert copy.get_params() == space.get_params()
        assert repr(copy) == repr(space)


def test_bands_without_couplings_are_counted():
    space = MultiBand().fit(recordings())
    lengths = twin.band_lengths(300)
    without = sum(n < twin.least_samples(b, 6, 300) for b, n in enumerate(lengths))
    assert space.dropped_ == (
        f"recordings of 300 samples are too short for couplings of axes in the lowest {without} bands"
    )
