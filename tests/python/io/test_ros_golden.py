"""Bags in the repository stay readable, whatever the libraries write today."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

from granular_id.io import load

pytest.importorskip("mcap")
pytest.importorskip("ruamel.yaml")

HERE = Path(__file__).parents[2] / "data" / "ros"
MADE = runpy.run_path(str(HERE / "make_ros_bags.py"))


@pytest.mark.parametrize("name", ["ros1.bag", "bag", "bag/bag.mcap"])
def test_bags_of_rosbags(name):
    wrench, stamps = MADE["expected"]()
    (recording,) = load(HERE / name)
    assert recording.wrench.tobytes() == wrench.tobytes()
    assert recording.rate_hz == 500
    assert recording.start_time == stamps[0] / 10**9
    assert recording.meta["frame"] == "ft_link"


def test_a_file_of_our_own_first_version():
    data = load(HERE / "own.mcap")
    assert data[0] == MADE["own"]()
    assert data.history[0].step == "made"
