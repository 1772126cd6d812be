"""The reader on a thousand real recordings, beside the plain numpy call."""

import numpy as np
import pytest

from granular_id.io import load, save

pytestmark = pytest.mark.data


@pytest.fixture(scope="module")
def sliding(data_dir):
    return load(data_dir / "sliding_wrench")


def test_samples_and_stamps_are_those_of_loadtxt(sliding, data_dir):
    assert len(sliding) == 1000
    for recording in sliding.select(indices=range(0, 1000, 97)):
        plain = np.loadtxt(data_dir / "sliding_wrench" / recording.name, delimiter=",", skiprows=1)
        assert recording.wrench.tobytes() == np.ascontiguousarray(plain[:, 1:]).tobytes()
        np.testing.assert_array_equal(recording.time_s, plain[:, 0] - plain[0, 0])
        assert recording.start_time == plain[0, 0]
        assert recording.name.startswith(recording.label)


def test_it_notices_what_is_odd_about_them(sliding):
    assert sliding.history[-1].totals["irregular"] == 1000
    assert {r.n_samples for r in sliding} >= {64, 876}
    part = sliding.select(indices=np.flatnonzero(np.isin(sliding.y, ["mat01", "mat02", "mat10"])))
    codes = {finding.code: finding.message for finding in part.check()}
    assert "record the labels in turn" in codes["leak-clock"]
    assert "leak-length" in codes
    assert "0.909 s in 'mat10/mat10_45.csv'" in codes["gaps"]
    assert part.chronological_order()[1] == "start_time"


def test_round_trip(sliding, tmp_path):
    part = sliding.select(indices=range(0, 1000, 50))
    assert load(save(part, tmp_path / "part", "csv")) == part
