"""Recordings, and two models of them, that many tests read and none changes."""

import pytest

from evaluation_cases import make_data
from granular_id.identifier import Identifier


@pytest.fixture(scope="session")
def data():
    return make_data(8)


@pytest.fixture(scope="session")
def new():
    return make_data(5, seed=9)


@pytest.fixture(scope="session")
def models(data):
    """One of plain features, and one of multi-band features that chose its classifier."""
    return {
        "raw+hfmh": Identifier.fit(data, "raw+hfmh", target_error=0.2),
        "best": Identifier.fit(data, "best", target_error=0.2),
    }


@pytest.fixture(scope="session")
def plain(models):
    return models["raw+hfmh"]


@pytest.fixture(scope="session")
def best(models):
    return models["best"]
