"""A condition that is held out may leave a material without recordings that train."""

from dataclasses import replace

import numpy as np
import pytest

from granular_id import Identifier, confidence_study, synthesize
from granular_id.identifier.training import train
from granular_id.recording import Dataset


@pytest.fixture(scope="module")
def data():
    """Two grippers, of which fine sugar has met one."""
    made = synthesize(["fine sugar", "oat flakes", "rice"], n_per_class=8, sessions=4, duration_s=0.5)
    of = {"session 1": "a", "session 2": "a", "session 3": "b", "session 4": "b"}
    grippers = ["a" if one.label == "fine sugar" else of[one.session] for one in made]
    return Dataset(
        [replace(one, meta={**one.meta, "gripper": it}) for one, it in zip(made, grippers, strict=True)]
    )


@pytest.mark.filterwarnings("error")
def test_fit_without_a_material_in_a_fold_names_the_rest(data):
    found = train(data, "hfmh", by="gripper").held
    assert (found.winners[:, -1] == found.held.predicted).all()
    assert not np.isin(found.winners[found.held.fold == 0], 0).any()
    model = Identifier.fit(data, "hfmh", by="gripper")
    assert model.trained["estimate"]["untested"] == {"fine sugar": "no other gripper to train on"}
    assert np.isfinite(model.trained["confidence"]["unknown"]["threshold"])


@pytest.mark.filterwarnings("error")
def test_study_without_a_material_in_a_fold_tests_the_rest(data):
    assert [one.label for one in confidence_study(data, "hfmh", by="gripper").unknown] == [
        "oat flakes",
        "rice",
    ]
