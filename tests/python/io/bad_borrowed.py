"""The bad files that the tests of single formats keep, for the tests of them all."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from bad_files import BadCase, written
from bad_mat import MAT_FILES
from bad_npz import NPY_FILES, NPZ_FILES
from bag_folder_attacks import FOLDER_ATTACKS
from mcap_attacks import MCAP_ATTACKS
from ros_attacks import BAG_ATTACKS, DB3_ATTACKS
from test_csv_bad_files import BAD as CSV_FILES

FILES = {"csv": CSV_FILES, "npy": NPY_FILES, "npz": NPZ_FILES, "mat v5": MAT_FILES}
"""By name: bytes, and what else those tests want to know."""

ATTACKS = {
    "mcap of others": MCAP_ATTACKS,
    "ros1": BAG_ATTACKS,
    "db3": DB3_ATTACKS,
    "ros2 mcap": FOLDER_ATTACKS,
}
"""By name: a function that writes into a folder and returns the path, and the message."""

NOT_ALONE = ("a name above", "an absolute name", "a link out")
"""Bags that bring a file beside them, which would be read as a recording of its own."""


def borrowed_cases() -> Iterator[tuple[str, BadCase]]:
    """Yield them all."""
    for kind, files in FILES.items():
        for what, (data, *_) in files.items():
            yield f"{kind} tests: {what}", BadCase(kind, partial(written, kind, data))
    for kind, attacks in ATTACKS.items():
        for what, (make, *_) in attacks.items():
            listed = what not in NOT_ALONE
            yield f"{kind} tests: {what}", BadCase(kind, make, listed=listed)
