"""Arguments of a model: refusals name them, the others come back."""

import copy
import pickle

import numpy as np
import pytest

from granular_id._core import FeatureSpec, Model, ModelFileError
from model_cases import N_AXES, N_SAMPLES, random_model, small_model

SPEC = FeatureSpec(hfmh=False)
PARTS = {
    "spec": SPEC,
    "coef": [[0.0, 2.0, 0.0]],
    "intercept": [-1.0],
    "coding_matrix": [[1], [-1]],
    "classes": ["rice", "salt"],
    "n_samples": 3,
    "n_axes": 1,
}


def made(**changes):
    return Model(**{**PARTS, **changes})


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"spec": None}, TypeError, "spec"),
        ({"coef": [[1.0, 2.0]]}, ValueError, r"coef must have shape \(1, 3\)"),
        ({"coding_matrix": [[1], [2]]}, ValueError, r"coding_matrix\[1, 0\] must be -1, 0 or 1"),
        ({"classes": "ab"}, TypeError, "(?s)str.*classes"),
        ({"classes": 5}, TypeError, "(?s)int.*classes"),
        ({"loss": "quadratic"}, ValueError, "loss must be 'hinge' or 'root'"),
        ({"n_axes": 257}, ValueError, "n_axes must be .*, got 257"),
        ({"metadata": {"trained": 1}}, TypeError, "(?s)int.*metadata"),
        ({"metadata": {"classes": "[]"}}, ValueError, "unknown entry 'classes'"),
        ({"metadata": {"trained": "NaN"}}, ValueError, "trained: must be a JSON object"),
        ({"metadata": {"trained": '{"a": "' + "x" * (1 << 20) + '"}'}}, ValueError, "the header has"),
    ],
)
def test_a_bad_part_is_named(changes, error, message):
    """What a file can hold as well is refused like there: see ``model_bad_files.py``."""
    with pytest.raises(error, match=message) as caught:
        made(**changes)
    assert caught.type is not ModelFileError
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize(
    ("wrench", "error", "message"),
    [
        (np.zeros((3, 2)), ValueError, r"must have shape \(3, 1\), or one more dimension .* got \(3, 2\)"),
        (np.zeros(3), ValueError, r"got \(3,\)"),
        (np.zeros((0, 3, 1)), ValueError, "wrench must not be empty"),
        ([[1.0], ["x"], [2.0]], (TypeError, ValueError), "wrench must"),
        ([[1.0], [np.nan], [2.0]], ValueError, "got NaN at recording 0, sample 1, axis 0"),
        ([[0.0], [1e308], [0.0]], ValueError, "score of learner 0 of recording 0 must be finite, got inf"),
    ],
)
def test_a_bad_recording_is_refused(wrench, error, message):
    with pytest.raises(error, match=message):
        made().scores(wrench)


def test_the_bad_recording_of_a_batch_is_named():
    wrench = np.zeros((300, 3, 1))
    wrench[211, 2] = np.inf
    with pytest.raises(ValueError, match="got inf at recording 211, sample 2, axis 0"):
        made().scores(wrench)
    wrench[211, 2] = 0.0
    wrench[[299, 47], 1] = 1.5e308
    with pytest.raises(ValueError, match="score of learner 0 of recording 47"):
        made().scores(wrench, threads=2)


@pytest.mark.parametrize(
    ("scores", "message"),
    [
        (np.zeros((2, 2)), r"scores must have shape \(n, 1\) or \(1,\), one per learner"),
        (1.0, r"scores must have shape \(n, 1\) or \(1,\), one per learner"),
        ([[0.0], [np.nan]], "score of learner 0 of recording 1 must be finite, got NaN"),
    ],
)
def test_bad_scores_are_refused(scores, message):
    with pytest.raises(ValueError, match=message):
        made().losses(scores)
    assert made().losses(np.zeros((0, 1))).shape == (0, 2)


def test_parts_come_back():
    model = small_model()
    assert (model.n_samples, model.n_axes, model.n_learners, model.n_classes) == (N_SAMPLES, N_AXES, 3, 3)
    assert model.coef.shape == (3, model.n_features)
    assert model.coding_matrix.dtype == np.int8
    assert model.classes == ("material 0", "material 1", "material 2")
    assert model.loss == "hinge"
    np.testing.assert_array_equal(model.early, [[2, 0.5], [4, 0.0]])
    np.testing.assert_array_equal(model.raw_mean, np.zeros(10))
    assert model.metadata["trained"] == '{"C": 1.0, "note": "Grüße"}'
    plain = made()
    for name in ("raw_mean", "early", "novelty"):
        assert getattr(plain, name) is None
    assert plain.metadata["axes"] == '["axis0"]'
    assert made(n_axes=1, metadata={"lead_s": "0.250"}).metadata["lead_s"] == "0.25"


def test_arrays_are_copies():
    coef = np.array(PARTS["coef"])
    model = made(coef=coef)
    coef[:] = 7.0
    model.coef[:] = 8.0
    np.testing.assert_array_equal(model.coef, PARTS["coef"])


@pytest.mark.parametrize(
    "copied", [copy.copy, copy.deepcopy, lambda model: pickle.loads(pickle.dumps(model))]
)
def test_copies_are_equal(copied):
    for model in (small_model(), made(), random_model(3, 12, 9, 6)):
        assert copied(model) == model
        assert copied(model).to_bytes() == model.to_bytes()
    assert made() != made(loss="root")
    assert made() != 5
    with pytest.raises(TypeError, match="unhashable"):
        hash(made())
