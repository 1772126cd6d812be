"""Writes filter_golden.txt: filters, signals and outputs of scipy, for the Rust tests and the Python tests.

Run with ``python tests/data/make_filter_golden.py``. Numbers are the 16 hexadecimal digits of their
float64 bits.
"""

from pathlib import Path

import numpy as np
import scipy
from scipy import signal

CASES = {
    "paper": (8, 23, "highpass", 500),
    "first_order": (1, 0.3, "lowpass", 2),
    "odd": (5, 120.5, "lowpass", 900.1),
    "bandpass": (3, [20, 60], "bandpass", 500),
    "bandstop": (4, [45, 55], "bandstop", 500),
    "nine_sections": (18, 0.35, "highpass", 2),
    "high_order": (32, 0.5123, "lowpass", 2),
}
N_SAMPLES = 48


def words(values: np.ndarray) -> str:
    """Float64 values as hexadecimal bit patterns."""
    return " ".join(
        f"{word:016x}" for word in np.ascontiguousarray(values, np.float64).ravel().view(np.uint64)
    )


def main() -> None:
    """Write the file beside this script."""
    rng = np.random.default_rng(2403)
    lines = [f"# scipy {scipy.__version__}, numpy {np.__version__}, x86-64"]
    for name, (order, edges, band, rate) in CASES.items():
        sos = signal.butter(order, edges, band, fs=rate, output="sos")
        x = rng.standard_normal(N_SAMPLES)
        zi = rng.standard_normal((len(sos), 2))
        y, zf = signal.sosfilt(sos, x, zi=zi)
        edge_list = [*np.atleast_1d(edges), 0.0][:2]
        lines += [f"case {name} {order} {band} {edge_list[0]} {edge_list[1]} {rate}"]
        for key, values in {"sos": sos, "x": x, "zi": zi, "y": y, "zf": zf}.items():
            lines.append(f"{key} {words(values)}")
    Path(__file__).with_name("filter_golden.txt").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
