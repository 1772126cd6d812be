"""Writes the bags beside this script: eight messages each, by rosbags.

Run with ``python tests/data/ros/make_ros_bags.py``. Written with rosbags 0.11.9.
What is in them says ``expected`` below, which the tests run.
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


def main():
    """Write both."""
    sys.path.insert(0, str(HERE.parents[1] / "python"))
    import ros_cases as ros

    wrench, stamps = expected()
    ros.write_bag1(HERE / "ros1.bag", ros.one_topic(ros.ROS1, wrench, stamps), "LZ4", node="/driver")
    ros.write_bag2(HERE / "bag", ros.one_topic(ros.ROS2, wrench, stamps), ros.MCAP, "STORAGE")


if __name__ == "__main__":
    main()
