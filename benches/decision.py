"""From the last sample to the name of the material: ours beside extraction and prediction with scipy and scikit-learn.

Run: python benches/decision.py [--materials 11] [--rounds 60]. Every figure comes from this one run. A recording of
1600 x 6 arrives in blocks of ten rows; the clock starts when its last row is there and stops when the answer is. The
peers then filter, count and predict; ours has done so while the rows came, and pushes the last one. Rows of the table
alternate, so that a change in the machine's speed meets all alike. The answers of all are compared.

`warm`: a provisional decision 30 times a second, as in a live view. `cold`: none before the last sample, so that the
weights have left the caches. `bands`: the same for a model of multi-band features, of which octaves, products and
counts are worked out as rows come, the rest when it is asked; its answers are compared with those of its own whole
recordings. `with rules`: the model also names candidates and says whether the recording is like none of the materials.
"""

from __future__ import annotations

import argparse
import platform
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import scipy
import sklearn
from scipy.signal import sosfilt
from sklearn.multiclass import OneVsOneClassifier
from sklearn.svm import SVC

import granular_id as gid
from granular_id._files import write_json
from granular_id.identifier import Identifier, StreamingIdentifier
from granular_id.signal import butter
from granular_id.synthetic import PAPER_MATERIALS

N_BINS, LOW, HIGH = 100, -1.5, 1.5
BLOCK, EVERY = 10, 16  # rows of a block; rows between provisional decisions
OURS, BANDS = "ours, warm", "ours, bands, warm"
RULED, RULED_BANDS = "ours, warm, with rules", "ours, bands, cold, with rules"
WHOLE_BANDS = "multi-band Model.scores, whole"


def extracted(recording: np.ndarray, sos: np.ndarray) -> np.ndarray:
    """The paper's features as they are written with scipy and numpy: one row."""
    filtered = sosfilt(sos, recording, axis=0)
    counts = [np.histogram(filtered[:, axis], N_BINS, (LOW, HIGH))[0] for axis in range(recording.shape[1])]
    return np.concatenate([recording.T.ravel(), *counts])[None]


def by_hand(row: np.ndarray, ecoc: gid.ECOCClassifier) -> str:
    """The least that a prediction can be: one product, hinge losses, the smallest mean."""
    scores = row @ ecoc.coef_.T + ecoc.intercept_
    codes = ecoc.coding_matrix_
    losses = (np.abs(codes) * np.maximum(0.0, 1.0 - codes * scores)).sum(axis=1) / np.abs(codes).sum(axis=1)
    return str(ecoc.classes_[losses.argmin()])


def streamed(stream: StreamingIdentifier, recording: np.ndarray, warm: bool) -> tuple[float, float, str]:
    """Seconds per row of pushing all but the last, seconds from the last to the decision, and its label."""
    stream.reset()
    pushing, asked = 0.0, 0
    for start in range(0, len(recording) - 1, BLOCK):
        block = recording[start : min(start + BLOCK, len(recording) - 1)]
        before = time.perf_counter()
        stream.push(block)
        pushing += time.perf_counter() - before
        if warm and start - asked >= EVERY:
            stream.decision()
            asked = start
    last = recording[-1:]
    before = time.perf_counter()
    stream.push(last)
    label = stream.decision().label
    return pushing / (len(recording) - 1), time.perf_counter() - before, label


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--materials", type=int, default=11, help="materials (default 11)")
    parser.add_argument("--rounds", type=int, default=60, help="recordings to identify (default 60)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the figures as JSON, too")
    options = parser.parse_args()
    materials = list(PAPER_MATERIALS)[: options.materials]
    train = gid.synthesize(materials, n_per_class=12, seed=0)
    test = gid.synthesize(materials, n_per_class=-(-options.rounds // len(materials)), seed=1)
    X, y = train.X, train.y
    sos = butter(8, 23.0, "highpass", fs=500.0)
    rows = np.concatenate([extracted(x, sos) for x in X])
    ecoc = gid.ECOCClassifier().fit(rows, y)
    one_vs_one = OneVsOneClassifier(SVC(kernel="linear")).fit(rows, y)
    svc = SVC(kernel="linear").fit(rows, y)
    identifier = Identifier.fit(train, "raw+hfmh", estimate=False)
    stream = StreamingIdentifier(identifier)
    ruled = StreamingIdentifier(Identifier.fit(train, "raw+hfmh"))
    banded = Identifier.fit(train, "multiband", estimate=False)
    bands = StreamingIdentifier(banded)
    ruled_bands = StreamingIdentifier(Identifier.fit(train, "multiband"))
    streams = {
        OURS: (stream, True),
        "ours, cold": (stream, False),
        RULED: (ruled, True),
        BANDS: (bands, True),
        "ours, bands, cold": (bands, False),
        RULED_BANDS: (ruled_bands, False),
    }

    peers: dict[str, Callable[[np.ndarray], str]] = {
        "scipy + numpy, ECOCClassifier.predict": lambda x: ecoc.predict(extracted(x, sos))[0],
        "scipy + numpy, SVC.predict": lambda x: svc.predict(extracted(x, sos))[0],
        "scipy + numpy, OneVsOneClassifier.predict": lambda x: one_vs_one.predict(extracted(x, sos))[0],
        "scipy + numpy, scores by hand": lambda x: by_hand(extracted(x, sos), ecoc),
        "extract_features + Model.scores, whole": lambda x: identifier.predict(x[None])[0],
        WHOLE_BANDS: lambda x: banded.predict(x[None])[0],
    }
    seconds: dict[str, list[float]] = {name: [] for name in (*streams, *peers)}
    labels: dict[str, list[str]] = {name: [] for name in seconds}
    per_row: dict[str, list[float]] = {OURS: [], BANDS: []}
    for recording in np.random.default_rng(2).permutation(test.X)[: options.rounds]:
        for name, (own, warm) in streams.items():
            pushing, deciding, label = streamed(own, recording, warm)
            if name in per_row:
                per_row[name].append(pushing)
            seconds[name].append(deciding)
            labels[name].append(label)
        for name, answer in peers.items():
            start = time.perf_counter()
            label = answer(recording)
            seconds[name].append(time.perf_counter() - start)
            labels[name].append(str(label))
    if (
        not labels[OURS]
        == labels["ours, cold"]
        == labels[RULED]
        == labels["scipy + numpy, ECOCClassifier.predict"]
    ):
        sys.exit("the labels of the stream differ from those of ECOCClassifier")
    if not labels[BANDS] == labels["ours, bands, cold"] == labels[WHOLE_BANDS]:
        sys.exit("the labels of the stream of multi-band features differ from those of whole recordings")
    report(seconds, labels, per_row, len(materials))
    if options.out:
        medians = {name: 1e6 * statistics.median(times) for name, times in seconds.items()}
        rows = {name: 1e6 * statistics.median(times) for name, times in per_row.items()}
        write_json(options.out, {"microseconds": medians, "microseconds per row pushed": rows})


def report(
    seconds: dict[str, list[float]],
    labels: dict[str, list[str]],
    per_row: dict[str, list[float]],
    n_materials: int,
) -> None:
    versions = f"numpy {np.__version__}, scipy {scipy.__version__}, scikit-learn {sklearn.__version__}"
    print(f"{platform.machine()}, Python {platform.python_version()}, {versions}")
    print(f"{n_materials} materials (SYNTHETIC), {len(seconds[OURS])} recordings of 1600 x 6")
    print(f"\n{'microseconds, last sample to label':<44}{'median':>10}{'95 %':>10}{'we are':>10}{'agree':>8}")
    ours = statistics.median(seconds[OURS])
    for name, times in seconds.items():
        median, high = statistics.median(times), float(np.quantile(times, 0.95))
        agree = sum(a == b for a, b in zip(labels[name], labels[OURS], strict=True))
        print(f"{name:<44}{1e6 * median:>10.1f}{1e6 * high:>10.1f}{median / ours:>9.0f}x{agree:>8}")
    for name, pushing in per_row.items():
        row = 1e6 * statistics.median(pushing)
        print(f"{name}: pushing blocks of {BLOCK} rows takes {row:.2f} microseconds per row")


if __name__ == "__main__":
    main()
