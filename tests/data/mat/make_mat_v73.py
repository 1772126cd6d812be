"""Writes the golden .mat files of version 7.3 in this folder; hdf5storage 0.2.2 made those committed.

Values are those of make_mat.m. hdf5storage writes what MATLAB writes: classes as attributes, sizes in reverse,
cells as references.
"""

from pathlib import Path

import hdf5storage
import numpy as np

HERE = Path(__file__).parent


def push(i, n_samples):
    t, c = np.meshgrid(np.arange(1, n_samples + 1), np.arange(1, 7), indexing="ij")
    return 1000.0 * i + t + c / 8


def cells(items):
    """A column of cells."""
    column = np.empty((len(items), 1), object)
    column[:, 0] = items
    return column


def save(name, variables):
    path = HERE / name
    path.unlink(missing_ok=True)
    hdf5storage.savemat(
        str(path), variables, appendmat=False, format="7.3", store_python_metadata=False,
        structured_numpy_ndarray_as_struct=True, compress_size_threshold=1000, oned_as="row",
    )  # fmt: skip


X = np.stack([push(i, 24) for i in range(1, 6)])
names = ["rice", "peas", "oat flakes"]
y = cells([names[i] for i in (0, 1, 2, 0, 1)])
save("single_t6n_v73.mat", {"force": X.transpose(1, 2, 0).astype(np.float32), "labels": y, "fs": 500.0})
save(
    "ragged_cell_v73.mat",
    {"pushes": cells([push(i, 24 + i) for i in (1, 2, 3)]), "label": cells(names), "rate_hz": 500.0},
)

records = np.zeros((1, 2), dtype=[(name, object) for name in ("wrench", "label", "session", "rate_hz")])
for i in range(1, 3):
    records[0, i - 1] = (push(i, 24 + i), names[i - 1], f"day{i}", np.array([[500.0]]))
save("struct_array_v73.mat", {"data": records})
