"""What scikit-learn estimators answer."""

import numpy as np
import pytest
from sklearn.linear_model import SGDClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from granular_id._estimators import learns, named_errors, real_steps, routed, seeded_clone
from granular_id.spaces import BestClassifier, RawSignal


def test_open_random_states_alone_are_set_from_the_seed():
    seed = np.random.SeedSequence(0)
    assert seeded_clone(SGDClassifier(), seed).random_state == 2968811710
    assert seeded_clone(SGDClassifier(random_state=7), seed).random_state == 7
    inner = seeded_clone(make_pipeline(StandardScaler(), SGDClassifier()), seed)
    assert inner[-1].random_state == 2968811710


def test_what_fit_takes_goes_to_the_last_step():
    known = {"order": None, "weather": "dry"}
    assert routed(BestClassifier(), known) == {"order": None}
    assert routed(make_pipeline(BestClassifier()), known) == {"bestclassifier__order": None}


def test_a_pipeline_learns_when_one_of_its_steps_does():
    assert not learns(RawSignal())
    assert not learns(make_pipeline(RawSignal(), make_pipeline("passthrough", None)))
    assert learns(make_pipeline(RawSignal(), StandardScaler()))
    assert [type(step) for step in real_steps(make_pipeline(make_pipeline(RawSignal(), None)))] == [RawSignal]


def test_errors_say_whose_they_are_once():
    with pytest.raises(ValueError, match=r"^feature space 'raw': no good$"), named_errors("raw"):
        raise ValueError("no good")
    with pytest.raises(ValueError, match=r"^'raw' is no good$"), named_errors("raw"):
        raise ValueError("'raw' is no good")
