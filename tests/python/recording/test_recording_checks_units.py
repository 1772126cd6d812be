"""Readings too large for their unit, and sets too small to be judged."""

import numpy as np
import pytest

from granular_id.recording import Dataset, Recording
from granular_id.synthetic import synthesize


def scaled(data, factor):
    return Dataset(
        [
            Recording(r.wrench * factor, rate_hz=r.rate_hz, label=r.label, session=r.session, name=r.name)
            for r in data
        ]
    )


def test_newtons_and_newton_metres_are_fine():
    data = synthesize(n_per_class=2)
    assert "units" not in data.check().counts


@pytest.mark.parametrize("factor", [1e3, 1e6])
def test_millinewtons_are_noticed(factor):
    report = scaled(synthesize(["rice", "fine sugar"], n_per_class=6), factor).check()
    assert report.counts["units"] == 12
    (finding,) = [finding for finding in report if finding.code == "units"]
    assert "are they in mN, N mm or counts?" in finding.message
    assert finding.severity == "warning"


def test_other_units_are_their_own_affair():
    rng = np.random.default_rng(0)
    depth = [
        Recording(rng.normal(size=(50, 1)) * 1e4, rate_hz=50, label="ab"[i % 2], axes=("depth",),
                  meta={"units": {"depth": "mm"}})
        for i in range(6)
    ]  # fmt: skip
    assert "units" not in Dataset(depth).check().counts


def test_few_recordings_are_said_to_be_too_few():
    few = synthesize(["rice", "fine sugar"], n_per_class=3)
    assert "few" in few.check().counts
    assert "few" not in synthesize(["rice", "fine sugar"], n_per_class=6).check().counts
    assert few.check().worst == "ok"
