"""ECOCClassifier beside scikit-learn's one-vs-one on 550 x 10200, 11 classes: seconds, memory, labels.

Every figure comes from this one run; each memory figure from a process of its own.

The data stand for the two ends of what recordings look like: `noise` (independent values, every row a
support vector) and `walk` (slow drift shared by few directions, few support vectors), which is the
case where a plain solver leaves the least to save.
"""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.multiclass import OneVsOneClassifier
from sklearn.svm import SVC

from granular_id._files import write_json
from granular_id.ecoc import ECOCClassifier

N_CLASSES, PER_CLASS, N_FEATURES = 11, 50, 10_200
MEGABYTE = 1e6
PEERS = {
    "OneVsOne(SVC(linear))": lambda: OneVsOneClassifier(SVC(kernel="linear")),
    "SVC(linear)": lambda: SVC(kernel="linear"),
    "ECOCClassifier": ECOCClassifier,
}


def recordings(kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Rows (550, 10200) and labels (550,)."""
    rng = np.random.default_rng(20)
    y = np.repeat(np.arange(N_CLASSES), PER_CLASS)
    rows = rng.standard_normal((len(y), N_FEATURES))
    means = rng.standard_normal((N_CLASSES, N_FEATURES))
    if kind == "noise":
        return rows + 0.05 * means[y], y
    return rows.cumsum(axis=1) / 100 + means.cumsum(axis=1)[y] / 30, y


def compare(kind: str) -> dict[str, float]:
    """Print seconds and equal labels; return the seconds."""
    X, y = recordings(kind)
    X_new = X + np.random.default_rng(21).standard_normal(X.shape) * X.std() * 0.3
    seconds, labels = dict[str, float](), dict[str, np.ndarray]()
    for name, make in PEERS.items():
        times = []
        for _ in range(1 if name.startswith("OneVsOne") and kind == "noise" else 3):  # that one takes long
            start = time.perf_counter()
            model = make().fit(X, y)
            model.predict(X)
            times.append(time.perf_counter() - start)
        seconds[name], labels[name] = min(times), model.predict(X_new)
    for name, best in seconds.items():
        same = np.mean(labels[name] == labels["ECOCClassifier"])
        print(f"{kind:6} {name:22} {best:8.3f} s, {same:.1%} of the labels of ECOCClassifier")
    return seconds


def memory(kind: str) -> None:
    """Print how many MB fit + predict of ECOCClassifier add to what the rows take."""
    X, y = recordings(kind)
    small = slice(None, None, 25)
    ECOCClassifier().fit(X[small, :50], y[small]).predict(X[small, :50])  # libraries loaded, ...
    square = np.ones((600, 600))
    square @ square.T @ square  # ... and BLAS's own buffers, which any product of this size fills
    del square
    before = _resident("VmRSS")
    with open("/proc/self/clear_refs", "w") as reset:  # noqa: PTH123 - lets VmHWM start from here
        reset.write("5")
    ECOCClassifier().fit(X, y).predict(X)
    print(f"{(_resident('VmHWM') - before) / MEGABYTE:.1f}")


def _resident(key: str) -> float:
    with open("/proc/self/status") as status:  # noqa: PTH123
        line = next(line for line in status if line.startswith(key))
    return float(line.split()[1]) * 1024


def main() -> None:
    figures: dict[str, Any] = {}
    for kind in ("noise", "walk"):
        figures[kind] = {"seconds": compare(kind)}
        call = [sys.executable, __file__, "memory", kind]
        added = subprocess.run(call, check=True, capture_output=True, text=True).stdout.strip()
        print(f"{kind:6} ECOCClassifier adds {added} MB")
        figures[kind]["megabytes"] = float(added)
    if sys.argv[1:2] == ["--out"]:
        write_json(Path(sys.argv[2]), figures)


if __name__ == "__main__":
    if sys.argv[1:2] == ["memory"]:
        memory(sys.argv[2])
    else:
        main()
