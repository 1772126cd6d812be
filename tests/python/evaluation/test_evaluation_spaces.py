"""Every feature space through evaluate: the fast ways give the labels of the general way, odd data one clear answer."""

import numpy as np
import pytest
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.exceptions import ConvergenceWarning
from sklearn.naive_bayes import GaussianNB
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from evaluation_cases import SMALL, changed, flat, make_data
from granular_id._estimators import convergence_warnings
from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation import evaluate, features, in_paper_order
from granular_id.rica import RICA
from granular_id.spaces import PrincipalComponents, RawHFMH, RawSignal, feature_spaces

PRESETS = feature_spaces()
MORE = {
    "unit": RawHFMH(block_weights="unit"),
    "numbers": RawHFMH(block_weights=(2.0, 0.1)),
    "pca of a union": make_pipeline(RawHFMH(block_weights="unit"), PrincipalComponents(5)),
    "pca, scaled": make_pipeline(RawSignal(), PrincipalComponents(5), StandardScaler()),
    "pca+rica": make_pipeline(RawSignal(), PrincipalComponents(8), RICA(4, max_iter=30)),
}


def general():
    """The same classifier in a pipeline, where nobody knows that scalar products would do."""
    return make_pipeline(ECOCClassifier())


@pytest.fixture(scope="module")
def data():
    return make_data()


@pytest.fixture(scope="module")
def spaces():
    return {
        **{name: PRESETS[name] for name in in_paper_order(PRESETS)},
        **MORE,
        "permuted": PRESETS["time-permuted"],
    }


def labels(result):
    return [(p.protocol, p.space, p.partition, p.row, p.predicted) for p in result.predictions()]


def test_scalar_products_give_the_labels_of_features(data, spaces, monkeypatch):
    fast = evaluate(data, spaces, **SMALL)
    by_scores = evaluate(data, spaces, classifier=general(), **SMALL)
    monkeypatch.setattr(features, "plan_for", lambda *_: None)
    long = evaluate(data, spaces, classifier=general(), **SMALL)
    for name in spaces:
        assert 0.25 < fast.mean_accuracy(name) < 1.0
    assert labels(fast) == labels(long)
    assert labels(by_scores) == labels(long)
    for one, other in zip(fast.spaces, long.spaces, strict=True):
        assert one.n_features == other.n_features
        assert one.learns == other.learns


@pytest.mark.parametrize(
    "classifier", [KNeighborsClassifier(3), GaussianNB(), make_pipeline(StandardScaler(), ECOCClassifier())]
)
def test_any_classifier_follows_components(data, classifier):
    chosen = {"pca": make_pipeline(RawSignal(), PrincipalComponents(5))}
    result = evaluate(data, chosen, "paper", classifier=classifier, **SMALL)
    for partition, said in zip(result.partitions["paper"], result.predicted["paper", "pca"], strict=True):
        pipeline = chosen["pca"].fit(data.X[partition.train])
        train, test = (pipeline.transform(data.X[rows]) for rows in (partition.train, partition.test))
        expected = classifier.fit(train, data.y[partition.train]).predict(test)
        np.testing.assert_array_equal(np.array(result.labels)[said], expected)


def test_every_space_and_control_is_the_same_for_any_number_of_threads(data, spaces):
    one, two = (evaluate(data, spaces, n_jobs=n_jobs, **{**SMALL, "controls": True}) for n_jobs in (1, 2))
    assert labels(one) == labels(two)
    assert one.controls == two.controls


def test_an_open_seed_of_a_step_after_components_is_set_by_partition(data, monkeypatch):
    seeds = []
    original = RICA.fit
    monkeypatch.setattr(
        RICA, "fit", lambda self, X, y=None: (seeds.append(self.random_state), original(self, X, y))[1]
    )
    spaces = {"pca+rica": MORE["pca+rica"]}
    evaluate(data, spaces, "paper", **SMALL)
    evaluate(data, spaces, "paper", **{**SMALL, "random_state": 1})
    assert len(set(seeds)) == 6
    assert None not in seeds


def test_solvers_that_stop_early_are_a_note(data):
    result = evaluate(
        data,
        {"few": make_pipeline(RawSignal(), PrincipalComponents(8), RICA(4, max_iter=2))},
        "paper",
        **SMALL,
    )
    (note,) = [note for note in result.notes if note.startswith("few:")]
    assert "RICA" in note
    assert note.endswith("(3 times)")


def test_complaints_are_counted_and_other_warnings_pass():
    import warnings

    def complain():
        with convergence_warnings("raw") as lines:
            for k in range(6):
                warnings.warn(f"learner {k % 5}", ConvergenceWarning, stacklevel=1)
            warnings.warn("other", UserWarning, stacklevel=1)
        return lines

    with warnings.catch_warnings(record=True) as passed:
        warnings.simplefilter("always")
        lines = complain()
    assert [str(one.message) for one in passed] == ["other"]
    assert lines == [
        "raw: learner 0 (2 times)",
        "raw: learner 1",
        "raw: learner 2",
        "raw: 2 other warnings of this kind",
    ]


class Broken(TransformerMixin, BaseEstimator):
    def __init__(self, learns=False):
        self.learns = learns

    def fit(self, X, y=None):
        return self

    def transform(self, X):
        features = flat(X).copy()
        features[:, 3] = np.nan
        return features


@pytest.mark.parametrize("learns", [True, False])
@pytest.mark.parametrize("classifier", [None, general()])
def test_features_that_are_nan_name_the_space(data, learns, classifier):
    with pytest.raises(
        ValueError, match="feature space 'mine' must give finite features, got nan in column 3"
    ):
        evaluate(data, {"raw": RawSignal(), "mine": Broken(learns)}, classifier=classifier, **SMALL)


def silent(data, axis):
    wrenches = {r.name: r.wrench.copy() for r in data}
    for wrench in wrenches.values():
        wrench[:, axis] = 2.5
    return type(data)([type(r)(**{**vars(r), "wrench": wrenches[r.name]}) for r in data])


def test_a_constant_axis_changes_nothing_that_the_others_tell(data, spaces):
    result = evaluate(silent(data, 2), spaces, **SMALL)
    assert any("never changes (fz)" in note for note in result.notes)
    for name in spaces:
        if name != "permuted":
            assert result.mean_accuracy(name) > 0.3


def test_recordings_that_are_all_equal_are_named_by_the_space_that_cannot_be(data):
    equal = type(data)([type(r)(**{**vars(r), "wrench": data[0].wrench}) for r in data])
    with pytest.raises(ValueError, match=r"feature space 'pca': .*all rows are equal"):
        evaluate(equal, "pca", "paper", **SMALL)
    result = evaluate(equal, "raw", "paper", **SMALL)
    assert any("hold exactly the samples of another" in note for note in result.notes)
    assert result.mean_accuracy("raw") == 0.25  # whatever is said, it is said of all


def test_one_class_and_two_hundred():
    one = make_data(n=4).select(labels="oat")
    for protocol in ("auto", "paper", "session", "chronological", "kfold"):
        with pytest.raises(ValueError, match="at least 2 classes, got only 'oat'"):
            evaluate(one, "raw", protocol, **SMALL)
    count = iter(range(600))
    many = changed(make_data(n=150, samples=4), label=lambda r: f"m{next(count) // 3:03d}")
    components = {"pca": make_pipeline(RawSignal(), PrincipalComponents(5))}
    result = evaluate(many, components, "kfold", classifier=KNeighborsClassifier(1), **SMALL)
    assert len(result.labels) == 200
    assert result.confusion().shape == (200, 200)
