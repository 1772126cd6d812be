"""The set is neither trivial nor hopeless. Wide bands on purpose: it is no evidence about real accuracy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal
from sklearn.model_selection import StratifiedShuffleSplit
from sklearn.svm import SVC

from granular_id.synthetic import synthesize


@pytest.fixture(scope="module")
def data():
    return synthesize(n_per_class=30)


@pytest.fixture(scope="module")
def spaces(data):
    """Gram matrices of the three feature spaces, from scipy and numpy alone, and the labels."""
    X = data.X
    residual = signal.sosfilt(signal.butter(8, 23, "high", fs=500, output="sos"), X, axis=1)
    bins = np.floor((residual + 1.5) / 0.03).astype(np.int64)
    inside = (bins >= 0) & (bins < 100)
    recording, _, axis = np.nonzero(inside)
    histogram = np.zeros((len(X), 6, 100))
    np.add.at(histogram, (recording, axis, bins[inside]), 1.0)
    raw, counts = X.reshape(len(X), -1), histogram.reshape(len(X), -1)
    grams = {"raw": raw @ raw.T, "hfmh": counts @ counts.T}
    return {**grams, "raw+hfmh": grams["raw"] + grams["hfmh"]}, data.y


def _accuracy(gram, labels):
    split = StratifiedShuffleSplit(5, train_size=264, test_size=66, random_state=0)
    hits = []
    for train, test in split.split(labels, labels):
        classifier = SVC(kernel="precomputed").fit(gram[np.ix_(train, train)], labels[train])
        hits.append(classifier.predict(gram[np.ix_(test, train)]) == labels[test])
    return float(np.mean(hits))


def test_each_space_is_well_above_chance_and_no_single_one_solves_it(spaces):
    grams, labels = spaces
    accuracy = {name: _accuracy(gram, labels) for name, gram in grams.items()}
    assert 0.60 < accuracy["raw"] < 0.95
    assert 0.70 < accuracy["hfmh"] < 0.97
    assert accuracy["raw+hfmh"] > max(accuracy["raw"], accuracy["hfmh"])


def test_shuffled_labels_give_chance(spaces):
    grams, labels = spaces
    shuffled = np.random.default_rng(0).permutation(labels)
    # 330 trials at 1/11: three standard deviations are 0.047
    assert _accuracy(grams["raw+hfmh"], shuffled) == pytest.approx(1 / 11, abs=0.05)


def test_the_rest_before_the_motion_gives_nothing_away(data):
    rest = data.X[:, :50].mean(axis=1)
    rest = (rest - rest.mean(axis=0)) / rest.std(axis=0)
    first = np.arange(len(rest)) % 30 < 20
    classifier = SVC(kernel="linear").fit(rest[first], data.y[first])
    assert np.mean(classifier.predict(rest[~first]) == data.y[~first]) < 0.25
