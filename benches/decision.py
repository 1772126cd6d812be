"""From the last sample to the name of the material: ours beside extraction and prediction with scipy and scikit-learn.

Eleven SYNTHETIC materials. Every figure comes from this one run. A recording of 1600 x 6 arrives in blocks of ten rows;
the clock starts when its last row is there and stops when the answer is. The peers then filter, count and predict; ours
has done so while the rows came, and pushes the last one. Rows of the table alternate, so that a change in the machine's
speed meets all alike. The answers of all are compared.

`warm`: a provisional decision 30 times a second, as in a live view. `cold`: none before the last sample, so that the
weights have left the caches. `bands`: the same for a model of multi-band features, of which octaves, products and
counts are worked out as rows come, the rest for an answer; its answers are compared with those of its own whole
recordings. `with rules`: the model also names candidates and says whether the recording is like none of the materials.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.signal import sosfilt
from sklearn.svm import SVC

import granular_id as gid
from granular_id._files import write_json
from granular_id.identifier import Identifier, StreamingIdentifier
from granular_id.signal import butter

N_BINS, LOW, HIGH = 100, -1.5, 1.5
BLOCK, EVERY = 10, 16  # rows of a block; rows between provisional decisions
OURS, BANDS = "ours, warm", "ours, bands, warm"
PEER, WHOLE = "scipy + numpy, ECOCClassifier.predict", "multi-band, whole recordings"


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
    pushing, answered = 0.0, 0
    for start in range(0, len(recording) - 1, BLOCK):
        block = recording[start : min(start + BLOCK, len(recording) - 1)]
        before = time.perf_counter()
        stream.push(block)
        pushing += time.perf_counter() - before
        if warm and start - answered >= EVERY:
            stream.decision()
            answered = start
    last = recording[-1:]
    before = time.perf_counter()
    stream.push(last)
    label = stream.decision().label
    return pushing / (len(recording) - 1), time.perf_counter() - before, label


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=60, help="recordings to identify (default 60)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the figures as JSON, too")
    options = parser.parse_args()
    train = gid.synthesize(n_per_class=12, seed=0)
    test = gid.synthesize(n_per_class=-(-options.rounds // len(train.labels)), seed=1)
    sos = butter(8, 23.0, "highpass", fs=500.0)
    rows = np.concatenate([extracted(x, sos) for x in train.X])
    ecoc, svc = gid.ECOCClassifier().fit(rows, train.y), SVC(kernel="linear").fit(rows, train.y)
    banded = Identifier.fit(train, "multiband", estimate=False)
    stream = StreamingIdentifier(Identifier.fit(train, "raw+hfmh", estimate=False))
    bands = StreamingIdentifier(banded)
    streams = {  # and whether each answers while samples come
        OURS: (stream, True),
        "ours, cold": (stream, False),
        "ours, warm, with rules": (StreamingIdentifier(Identifier.fit(train, "raw+hfmh")), True),
        BANDS: (bands, True),
        "ours, bands, cold": (bands, False),
        "ours, bands, cold, with rules": (StreamingIdentifier(Identifier.fit(train, "multiband")), False),
    }
    peers: dict[str, Callable[[np.ndarray], str]] = {
        PEER: lambda x: ecoc.predict(extracted(x, sos))[0],
        "scipy + numpy, SVC.predict": lambda x: svc.predict(extracted(x, sos))[0],
        "scipy + numpy, scores by hand": lambda x: by_hand(extracted(x, sos), ecoc),
        WHOLE: lambda x: banded.predict(x[None])[0],
    }
    seconds: dict[str, list[float]] = {name: [] for name in (*streams, *peers)}
    labels: dict[str, list[str]] = {name: [] for name in seconds}
    per_row: dict[str, list[float]] = {OURS: [], BANDS: []}
    for recording in np.random.default_rng(2).permutation(test.X)[: options.rounds]:
        for name, (own, warm) in streams.items():
            pushing, deciding, label = streamed(own, recording, warm)
            per_row.get(name, []).append(pushing)
            seconds[name].append(deciding)
            labels[name].append(label)
        for name, answer in peers.items():
            start = time.perf_counter()
            label = answer(recording)
            seconds[name].append(time.perf_counter() - start)
            labels[name].append(str(label))
    for name, twin in ((OURS, PEER), ("ours, cold", PEER), (BANDS, WHOLE), ("ours, bands, cold", WHOLE)):
        if labels[name] != labels[twin]:
            sys.exit(f"the labels of {name} differ from those of {twin}")
    us, row_us = (
        {name: 1e6 * statistics.median(times) for name, times in all_times.items()}
        for all_times in (seconds, per_row)
    )
    for name, median in us.items():
        print(f"{name:<40}{median:>10.1f} µs, {median / us[OURS]:>6.1f}x")
    for name, median in row_us.items():
        print(f"{name}: {median:.2f} µs per row pushed, in blocks of {BLOCK}")
    if options.out:
        write_json(options.out, {"microseconds": us, "microseconds per row pushed": row_us})


if __name__ == "__main__":
    main()
