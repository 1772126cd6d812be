"""ECOCClassifier beside scikit-learn's one-vs-one on 550 x 10200, 11 classes: seconds, memory, labels.

Run: python benches/ecoc.py [kinds] [--repeats 3]. Every figure comes from this one run; each memory figure from a
process of its own.

The data stand for the two ends of what recordings look like: `noise` (independent values, every row a
support vector) and `walk` (slow drift shared by few directions, few support vectors), which is the
case where a plain solver leaves the least to save; `drift` overlaps and keeps every solver busy (minutes).
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.multiclass import OneVsOneClassifier
from sklearn.svm import SVC

from granular_id._files import write_json
from granular_id.ecoc import ECOCClassifier

N_CLASSES, PER_CLASS, N_FEATURES = 11, 50, 10_200
KINDS = ("noise", "walk")
MEGABYTE = 1e6


def recordings(kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Rows (550, 10200) and labels (550,)."""
    rng = np.random.default_rng(20)
    y = np.repeat(np.arange(N_CLASSES), PER_CLASS)
    rows = rng.standard_normal((len(y), N_FEATURES))
    means = rng.standard_normal((N_CLASSES, N_FEATURES))
    if kind == "noise":
        return rows + 0.05 * means[y], y
    np.cumsum(rows, axis=1, out=rows)
    means = np.cumsum(means, axis=1)
    return (rows / 100 + means[y] / 30, y) if kind == "walk" else (rows / 100 + means[y] / 1000, y)


def peers() -> dict[str, Callable[[], Any]]:
    return {
        "OneVsOne(SVC(linear))": lambda: OneVsOneClassifier(SVC(kernel="linear")),
        "SVC(linear)": lambda: SVC(kernel="linear"),
        "ECOCClassifier": ECOCClassifier,
    }


def compare(kind: str, repeats: int) -> dict[str, float]:
    """Print seconds and equal labels; return the seconds."""
    X, y = recordings(kind)
    seconds: dict[str, float] = {}
    fitted: dict[str, Any] = {}
    for name, make in peers().items():
        best = np.inf
        for _ in range(1 if name.startswith("OneVsOne") and kind != "walk" else repeats):
            start = time.perf_counter()
            model = make().fit(X, y)
            model.predict(X)
            best = min(best, time.perf_counter() - start)
        seconds[name], fitted[name] = best, model
    for name, best in seconds.items():
        print(f"{kind:6} {name:22} {best:8.3f} s   {seconds['OneVsOne(SVC(linear))'] / best:6.1f} x")

    X_new = X + np.random.default_rng(21).standard_normal(X.shape) * X.std() * 0.3
    ours, theirs = fitted["ECOCClassifier"], fitted["OneVsOne(SVC(linear))"]
    votes = (ours.binary_scores(X_new)[:, None, :] * ours.coding_matrix_ > 0).sum(axis=2)
    by_loss = ours.predict(X_new)
    unique = (votes == votes.max(axis=1, keepdims=True)).sum(axis=1) == 1  # no two classes with as many votes
    agree = unique & (votes.argmax(axis=1) == by_loss)
    same = theirs.predict(X_new) == by_loss
    print(f"{kind:6} labels equal to one-vs-one: {same.sum()} of {len(same)} rows,")
    print(f"{kind:6}   {(same & agree).sum()} of the {agree.sum()} rows where votes and losses agree")
    return seconds


def memory(kind: str, name: str, tool: str) -> None:
    """Print how many MB fit + predict add to what the rows take."""
    X, y = recordings(kind)
    small = slice(None, None, 25)
    peers()[name]().fit(X[small, :50], y[small]).predict(X[small, :50])  # libraries loaded, ...
    square = np.ones((600, 600))
    square @ square.T @ square  # ... and BLAS's own buffers, which any product of this size fills
    del square
    if tool == "tracemalloc":
        tracemalloc.start()
        peers()[name]().fit(X, y).predict(X)
        added = float(tracemalloc.get_traced_memory()[1])
    else:
        before = _resident("VmRSS")
        with open("/proc/self/clear_refs", "w") as reset:  # noqa: PTH123 - lets VmHWM start from here
            reset.write("5")
        peers()[name]().fit(X, y).predict(X)
        added = _resident("VmHWM") - before
    print(f"{added / MEGABYTE:.1f}")


def _resident(key: str) -> float:
    with open("/proc/self/status") as status:  # noqa: PTH123
        line = next(line for line in status if line.startswith(key))
    return float(line.split()[1]) * 1024


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("kinds", nargs="*", metavar="KIND", help="of noise, walk, drift (default noise walk)")
    parser.add_argument("--repeats", type=int, default=3, help="fits of each, the best counts (default 3)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the figures as JSON, too")
    options = parser.parse_args()
    figures: dict[str, Any] = {}
    for kind in options.kinds or KINDS:
        figures[kind] = {"seconds": compare(kind, options.repeats), "megabytes": {}}
        for tool in ("tracemalloc", "resident"):
            for name in ("SVC(linear)", "ECOCClassifier"):
                call = [sys.executable, __file__, "memory", kind, name, tool]
                added = subprocess.run(call, check=True, capture_output=True, text=True).stdout.strip()
                print(f"{kind:6} {name:22} peak MB added ({tool}): {added}")
                figures[kind]["megabytes"][f"{name}, {tool}"] = float(added)
    if options.out:
        write_json(options.out, figures)


if __name__ == "__main__":
    if sys.argv[1:2] == ["memory"]:
        memory(*sys.argv[2:5])
    else:
        main()
