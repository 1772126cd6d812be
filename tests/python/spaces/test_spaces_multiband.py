"""The definition of multi-band features: passed on, kept by copies, and in what is said of short recordings."""

import pickle

import numpy as np
import pytest
from sklearn.base import clone

import multiband_twin as twin
from granular_id._core import MultiBandExtractor
from granular_id.spaces.multiband import ALL_BLOCKS, MultiBand
from spaces_cases import recordings


@pytest.mark.parametrize("definition", twin.DEFINITIONS)
def test_features_are_those_of_the_definition_and_copies_keep_it(definition):
    X = recordings()
    space = MultiBand(blocks=ALL_BLOCKS, definition=definition).fit(X)
    scales, levels = twin.learned_scales(X, definition)
    wanted = [twin.features(x, scales, levels, definition=definition) for x in X]
    np.testing.assert_allclose(space.transform(X), wanted, atol=2e-5)
    assert space.bands_[2].n_samples == twin.band_lengths(X.shape[1], definition)[2]
    same = pickle.loads(pickle.dumps(space))
    assert same.extractor_ == space.extractor_
    assert same.extractor_.definition == definition
    for copy in (same, clone(space)):
        assert copy.get_params() == space.get_params()
        assert repr(copy) == repr(space)


def test_the_default_is_that_of_the_core():
    default = MultiBandExtractor(1, 1).definition
    assert MultiBand().definition == default
    assert "definition" not in repr(MultiBand(definition=default))
    for other in set(twin.DEFINITIONS) - {default}:
        assert repr(MultiBand(definition=other)) == f"MultiBand(definition={other})"


@pytest.mark.parametrize(
    ("definition", "error"), [(0, ValueError), (3, ValueError), ("2", TypeError), (True, TypeError)]
)
def test_other_definitions_are_refused_by_fit(definition, error):
    with pytest.raises(error, match="definition must be an int"):
        MultiBand(definition=definition).fit(recordings())


@pytest.mark.parametrize("definition", twin.DEFINITIONS)
def test_bands_without_couplings_are_counted(definition):
    space = MultiBand(definition=definition).fit(recordings())
    lengths = twin.band_lengths(300, definition)
    without = sum(n < twin.least_samples(b, 6, 300, definition) for b, n in enumerate(lengths))
    assert space.dropped_ == (
        f"recordings of 300 samples are too short for couplings of axes in the lowest {without} bands"
    )
