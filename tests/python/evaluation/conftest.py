"""Recordings and an evaluation of them that many tests read and none changes."""

import pytest

from evaluation_cases import THREE, make_data
from granular_id.evaluation import evaluate


@pytest.fixture(scope="session")
def data():
    return make_data()


@pytest.fixture(scope="session")
def evaluated(data):
    return evaluate(data, THREE, progress=False)
