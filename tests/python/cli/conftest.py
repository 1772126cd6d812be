"""Made once for all tests of the command line, and never modified: recordings, and a small model of them."""

import pytest

from cli_cases import SMALL_MODEL, ended_well, make, saved


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    """30 recordings of 60 samples at 125 Hz as CSV files, with an index."""
    return saved(make(), tmp_path_factory.mktemp("cli") / "uniform")


@pytest.fixture(scope="session")
def model(folder, tmp_path_factory):
    """What `train` makes of that folder."""
    file = tmp_path_factory.mktemp("model") / "m.safetensors"
    ended_well("train", folder, "-o", file, *SMALL_MODEL, "--quiet")
    return file


@pytest.fixture
def no_pictures(monkeypatch):
    """Drawing takes most of the time of a report, and its words do not depend on it."""
    monkeypatch.setattr("granular_id.report.page.pictures", lambda *_: [])
