"""Refusal by a trained model: the share of known recordings that new sessions lose, and background materials."""

import numpy as np
import pytest
from sklearn.metrics import roc_auc_score

import granular_id as gid
from granular_id import Identifier
from granular_id.identifier.rules import KEY
from granular_id.synthetic import PAPER_MATERIALS

KNOWN = ("rice", "fine sugar", "oat flakes", "macaroni")
MATERIALS = [material.name for material in PAPER_MATERIALS]


def pushes(materials, seed, n=18):
    """Six sessions of SYNTHETIC pushes; of another seed six others."""
    return gid.synthesize(materials, n, 6, seed=seed, duration_s=1.6, rate_hz=250.0)


def novelty(model, data):
    return model.core.scores_and_novelty(data.X)[1]


def auroc(model, known, unknown):
    truth = np.repeat([0, 1], [len(known), len(unknown)])
    return roc_auc_score(truth, np.r_[novelty(model, known), novelty(model, unknown)])


def refused(model, data):
    return (novelty(model, data) > model.trained[KEY]["unknown"]["threshold"]).mean()


@pytest.fixture(scope="module")
def draws():
    """Four known materials, four of background, three unknown; models without and with background; new sessions."""
    made = []
    for seed in range(3):
        names = np.random.default_rng(seed).permutation(MATERIALS).tolist()
        data, new = pushes(names, seed), pushes(names, 100 + seed)
        parts = names[:4], names[4:8], names[8:]
        models = [
            Identifier.fit(data.select(labels=parts[0]), "multiband", target_error=None),
            Identifier.fit(
                data.select(labels=names[:8]), "multiband", target_error=None, background=parts[1]
            ),
        ]
        made.append((models, parts, [new.select(labels=part) for part in parts]))
    return made


def test_known_materials_of_new_sessions_are_rarely_refused(draws):
    """Over twelve such draws 4.3 % in the mean, with the promise of 5 % at most; single ones vary."""
    for which in (0, 1):
        assert 0 <= np.mean([refused(models[which], new[0]) for models, _, new in draws]) < 0.08


def test_background_is_refused_and_never_named(draws):
    (_, model), (known, beside, _), new = draws[0]
    assert model.classes == tuple(sorted(known))
    assert model.trained["background"] == dict.fromkeys(sorted(beside), 18)
    assert model.trained["recordings"] == dict.fromkeys(sorted(known), 18)
    assert model.identify(new[1].X[0]).label in known
    shares = [[refused(model, new[1]) for model in models] for models, _, new in draws]
    without, with_background = np.mean(shares, axis=0)
    assert with_background > 0.8 > without


def test_background_tells_unknown_materials_better(draws):
    for models, _, (known, _, unknown) in draws:
        without, with_it = (auroc(model, known, unknown) for model in models)
        assert with_it > without + 0.02


def test_background_leaves_the_classifier_as_it_is(draws):
    for (without, with_it), _, _ in draws:
        old, new = without.core, with_it.core
        assert old.coef.tobytes() == new.coef.tobytes()
        assert [len(part) for part in old.novelty] == [2, 3, 4]
        assert [len(part) for part in new.novelty] == [2, 7, 4]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"background": "rice"}, "background must be a sequence of labels, got 'rice'"),
        ({"background": ["sand"]}, "background names 'sand', of which there is no recording"),
        ({"background": ["rice"], "share_known": None}, "background has no use where nothing is refused"),
        ({"background": ["rice"], "estimate": False}, "background has no use where nothing is refused"),
        ({"background": KNOWN[1:]}, "at least 2 classes"),
    ],
)
def test_background_that_has_no_use_is_refused(settings, message):
    data = gid.synthesize(KNOWN, 3, duration_s=0.4)
    with pytest.raises((TypeError, ValueError), match=message):
        Identifier.fit(data, "hfmh", **settings)
