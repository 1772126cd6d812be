"""Extraction beside what a user could write instead, all in one run: `make bench`.

682 recordings of 1600 x 6 (the paper's number), noise on a random walk. Every row is the median of alternating
rounds, each after one untimed call, so that a change in the machine's speed meets all rows alike. numba's threads
come late in a round, because they spin for a while after their work. Ratios are the result; single times are not.
Multi-band features stand beside them, without a peer.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numba
import numpy as np
from scipy.signal import sosfilt

import granular_id as gid
from granular_id._files import write_json
from granular_id.signal import butter

N, ROUNDS = 682, 15
N_BINS, LOW, HIGH = 100, -1.5, 1.5


def recordings(n_recordings: int) -> np.ndarray:
    rng = np.random.default_rng(0)
    walk = rng.normal(scale=0.05, size=(n_recordings, 1600, 6)).cumsum(axis=1)
    return np.ascontiguousarray(walk + rng.normal(scale=0.1, size=walk.shape))


def scipy_loop(wrench: np.ndarray, sos: np.ndarray, out: np.ndarray) -> None:
    """What people write first: one recording and one axis at a time."""
    for recording, row in zip(wrench, out, strict=True):
        row[:9600] = recording.T.ravel()
        for axis in range(6):
            filtered = sosfilt(sos, recording[:, axis])
            row[9600 + 100 * axis : 9700 + 100 * axis] = np.histogram(filtered, N_BINS, (LOW, HIGH))[0]


def scipy_vectorised(wrench: np.ndarray, sos: np.ndarray, out: np.ndarray) -> None:
    """One call of the filter, one count of all cells. Bins by arithmetic: edges are not exact."""
    n = len(wrench)
    axis_major = np.ascontiguousarray(wrench.transpose(0, 2, 1))
    out[:, :9600] = axis_major.reshape(n, 9600)
    filtered = sosfilt(sos, axis_major, axis=-1)
    cells = ((filtered - LOW) * (N_BINS / (HIGH - LOW))).astype(np.int32)
    inside = (filtered >= LOW) & (filtered < HIGH)
    cells += 100 * np.arange(6 * n, dtype=np.int32).reshape(n, 6, 1)
    out[:, 9600:] = np.bincount(cells[inside], minlength=600 * n).reshape(n, 600)


@numba.njit(cache=False)
def numba_one(recording: np.ndarray, sos: np.ndarray, row: np.ndarray) -> None:
    """Six axes at once, four sections a sample, counting and transposing on the way."""
    n_samples, n_sections = recording.shape[0], sos.shape[0]
    z0, z1, x = np.zeros((n_sections, 6)), np.zeros((n_sections, 6)), np.empty(6)
    row[9600:] = 0.0
    scale = N_BINS / (HIGH - LOW)
    for t in range(n_samples):
        for a in range(6):
            x[a] = recording[t, a]
            row[a * n_samples + t] = x[a]
        for s in range(n_sections):
            b0, b1, b2, a1, a2 = sos[s, 0], sos[s, 1], sos[s, 2], sos[s, 4], sos[s, 5]
            for a in range(6):
                y = b0 * x[a] + z0[s, a]
                z0[s, a] = b1 * x[a] - a1 * y + z1[s, a]
                z1[s, a] = b2 * x[a] - a2 * y
                x[a] = y
        for a in range(6):
            if LOW <= x[a] < HIGH:
                row[9600 + 100 * a + int((x[a] - LOW) * scale)] += 1.0


@numba.njit(cache=False)
def numba_batch(wrench: np.ndarray, sos: np.ndarray, out: np.ndarray) -> None:
    for i in range(wrench.shape[0]):
        numba_one(wrench[i], sos, out[i])


@numba.njit(cache=False, parallel=True)
def numba_parallel(wrench: np.ndarray, sos: np.ndarray, out: np.ndarray) -> None:
    for i in numba.prange(wrench.shape[0]):
        numba_one(wrench[i], sos, out[i])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the figures as JSON, too")
    options = parser.parse_args()
    wrench, n = recordings(N), N
    sos = butter(8, 23.0, "highpass", fs=500.0)
    out, wanted = np.zeros((n, 10_200)), np.zeros((n, 10_200))
    silent = wrench * [0, 1, 0, 1, 0, 1]
    one, two = (gid.MultiBand(threads=threads).fit(wrench) for threads in (1, 2))
    axis_major = out[:, :9600].reshape(n, 6, 1600)
    if not np.shares_memory(axis_major, out):
        sys.exit("the copy floor must write into the same memory as the others")
    rows: dict[str, Callable[[], object]] = {
        "scipy + numpy, loop": lambda: scipy_loop(wrench, sos, out),
        "scipy + numpy, vectorised": lambda: scipy_vectorised(wrench, sos, out),
        "numba, 1 thread": lambda: numba_batch(wrench, sos, out),
        "transposing copy (floor)": lambda: np.copyto(axis_major, wrench.transpose(0, 2, 1)),
        "granular_id, 1 thread": lambda: gid.extract_features(wrench, threads=1, out=out),
        "granular_id, 2 threads": lambda: gid.extract_features(wrench, threads=2, out=out),
        "multi-band, 1 thread": lambda: one.transform(wrench),
        "multi-band, 2 threads": lambda: two.transform(wrench),
        "numba, 2 threads": lambda: numba_parallel(wrench, sos, out),
        "granular_id, 1 thread, 3 silent axes": lambda: gid.extract_features(silent, threads=1, out=out),
    }
    numba.set_num_threads(min(2, numba.config.NUMBA_NUM_THREADS))
    scipy_loop(wrench, sos, wanted)
    for name, work in rows.items():
        out[:] = 0.0
        result = work()
        if (
            name.startswith("granular_id")
            and not name.endswith("axes")
            and not np.array_equal(out if result is None else result, wanted)
        ):
            sys.exit(f"{name}: the features differ from scipy's and numpy's")
    times: dict[str, list[float]] = {name: [] for name in rows}
    for number in range(ROUNDS):
        for name, work in rows.items():
            if name == "scipy + numpy, loop" and number % 5:
                continue  # slow, and steady enough
            if name != "scipy + numpy, loop":
                work()  # untimed: a core that slept through the other rows is awake again
            start = time.perf_counter()
            work()
            times[name].append(time.perf_counter() - start)
    microseconds = {name: statistics.median(samples) / n * 1e6 for name, samples in times.items()}
    floor = microseconds["transposing copy (floor)"]
    for name, value in microseconds.items():
        print(f"{name:<40}{value:>10.1f} µs a recording, {value / floor:>8.2f}x the copy")
    if options.out:
        write_json(options.out, microseconds)


if __name__ == "__main__":
    main()
