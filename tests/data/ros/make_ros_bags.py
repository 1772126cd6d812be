"""Writes the bags beside this script: eight messages each, by rosbags, and one recording by this library.

Run with ``python tests/data/ros/make_ros_bags.py``. Written with rosbags 0.11.9, mcap 1.6.0 and granular-id 0.1.0.
What is in them say ``expected`` and ``own`` below, which the tests run.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
START_NS = 1_700_000_000_123_456_789
STEP_NS = 2_000_000


def expected():
    """Return the samples of every bag, shape (8, 6), and their stamps in ns."""
    wrench = (np.arange(48).reshape(8, 6) - 20) / 3
    return wrench, [START_NS + i * STEP_NS for i in range(8)]


def own():
    """Return the recording in ``own.mcap``."""
    from granular_id.recording import Recording

    return Recording(
        expected()[0],
        time_s=[0, 0.002, 0.004, 0.1, 0.2 + 1e-12, 0.3, 0.4, 1 / 3 + 1],
        label="oat flakes",
        session="2026-11-21",
        start_time=1_700_000_000.125,
        trigger_index=2,
        flags=[0, 0, 1, 2, 4, 8, 0, 15],
        meta={"frame": "ft", "tool": {"width_mm": 17, "names": ["a", None, True, 0.1]}},
        name="push 1",
    )


def main():
    """Write all of them."""
    sys.path.insert(0, str(HERE.parents[1] / "python"))
    import ros_cases as ros
    from granular_id.io.ros.mcap import save_mcap
    from granular_id.recording import Dataset, StepReport

    wrench, stamps = expected()
    ros.write_bag1(HERE / "ros1.bag", ros.one_topic(ros.ROS1, wrench, stamps), "LZ4", node="/driver")
    ros.write_bag2(HERE / "bag", ros.one_topic(ros.ROS2, wrench, stamps), ros.MCAP, "STORAGE")
    save_mcap(Dataset([own()], [StepReport("made", {"by": "make_ros_bags.py"})]), HERE / "own.mcap")


if __name__ == "__main__":
    main()
