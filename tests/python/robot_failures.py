"""Reader of the robot-failure sets: six integers a row, 15 rows an instance, no rate of 500 Hz, unbalanced classes."""

import numpy as np

from granular_id.recording import Dataset, Recording

N_SAMPLES = 15
RATE_HZ = N_SAMPLES / 0.315
SETS = ("lp1", "lp2", "lp3", "lp4", "lp5")


def load_failures(folder, name):
    """Read one set, for instance "lp1", from the folder ``robot_failures``."""
    recordings = []
    for block in (folder / f"{name}.data").read_text().split("\n\n"):
        if not block.strip():
            continue
        label, *rows = block.strip().splitlines()
        wrench = np.array([row.split() for row in rows], dtype=np.float64)
        assert wrench.shape == (N_SAMPLES, 6), (name, len(recordings))
        recordings.append(
            Recording(wrench, rate_hz=RATE_HZ, label=label, name=f"{name}_{len(recordings) + 1:03d}")
        )
    return Dataset(recordings)
