"""Write recordings, a model file, and the scores and losses that plain numpy computes for them.

    python tests/data/make_model_golden.py                  # tests/data/model, small
    python tests/data/make_model_golden.py FOLDER 100000    # as many rows, for a long run of tests/model.rs

``tests/model.rs`` reads the folder with the Rust crate alone and compares every bit. Numbers are little-endian float64,
row by row. Made with numpy 2.4.
"""

import sys
from pathlib import Path

import numpy as np

import granular_id as gid

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "python"))

import model_twin  # noqa: E402  # only now can it be found
from granular_id._core import FeatureSpec  # noqa: E402
from granular_id.ecoc import decode  # noqa: E402
from model_cases import random_model  # noqa: E402

N_SAMPLES, N_AXES, N_CLASSES = 20, 6, 5
AT_A_TIME = 10_000


def main(folder=HERE / "model", n_rows=12):
    folder.mkdir(parents=True, exist_ok=True)
    spec = FeatureSpec(n_bins=10, order=4, bin_range=(-1.0, 1.0))
    trained = '{"about": "random weights"}'
    model = random_model(20, N_CLASSES, N_SAMPLES, N_AXES, spec, scale=0.3, metadata={"trained": trained})
    (folder / "model.safetensors").write_bytes(model.to_bytes())
    rng = np.random.default_rng(21)
    files = [(folder / f"{name}.f64").open("wb") for name in ("wrench", "scores", "losses")]
    for start in range(0, n_rows, AT_A_TIME):
        wrench = rng.normal(size=(min(AT_A_TIME, n_rows - start), N_SAMPLES, N_AXES))
        scores = model_twin.scores(model, wrench)
        losses = -decode(scores, model.coding_matrix)
        for file, values in zip(files, (wrench, scores, losses), strict=True):
            file.write(values.astype("<f8").tobytes())
        if start == 0:
            gid.save(
                gid.Dataset([gid.Recording(push, rate_hz=spec.rate_hz) for push in wrench[:2]]),
                folder / "pushes.npz",
            )
    for file in files:
        file.close()
    print(f"{n_rows} recordings in {folder}")


if __name__ == "__main__":
    main(*(convert(text) for convert, text in zip((Path, int), sys.argv[1:], strict=False)))
