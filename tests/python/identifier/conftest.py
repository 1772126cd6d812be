"""Recordings and models of them that many tests read and none changes."""

from dataclasses import replace

import numpy as np
import pytest

from evaluation_cases import LABELS, make_data
from granular_id.identifier import Identifier
from granular_id.recording import Dataset


@pytest.fixture(scope="session")
def data():
    return make_data(8)


@pytest.fixture(scope="session")
def new():
    return make_data(5, seed=9)


@pytest.fixture(scope="session")
def levels():
    """Materials that differ in level, with some pushes off theirs."""
    rng = np.random.default_rng(0)

    def wrench(r):
        level = LABELS.index(r.label)
        return rng.normal(level + rng.normal(0, 0.24), 0.3, (60, 6))

    return Dataset([replace(r, wrench=wrench(r)) for r in make_data(8)])


@pytest.fixture(scope="session")
def leveled(levels):
    """A model of these, with an early rule."""
    return Identifier.fit(levels, "raw+hfmh", target_error=0.3)


@pytest.fixture(scope="session")
def models(data):
    """Models of plain features, and of multi-band ones with and without a choice; all with rules."""
    settings = {"coverage": 0.8, "share_known": 0.9, "target_error": 0.2}
    spaces = ("hfmh", "raw", "raw+hfmh", "multiband", "best")
    return {space: Identifier.fit(data, space, **settings) for space in spaces}


@pytest.fixture(scope="session")
def plain(models):
    return models["raw+hfmh"]


@pytest.fixture(scope="session")
def best(models):
    return models["best"]
