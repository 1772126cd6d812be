"""Filter design and filtering: golden numbers, odd sections, threads."""

from pathlib import Path

import numpy as np
import pytest
from scipy import signal as scipy_signal

from core_cases import N_THREADS, at_once, same_bits
from granular_id.signal import butter, sosfilt, sosfilt_zi

SOS = butter(8, 23, "highpass", fs=500)
INTEGRATOR = [[1, 0, 0, 1, -1, 0]]
X = np.random.default_rng(11).standard_normal((40, 3))
GOLDEN = Path(__file__).parents[2] / "data" / "filter_golden.txt"


def golden_cases():
    for block in GOLDEN.read_text().split("case ")[1:]:
        title, *lines = block.strip().splitlines()
        arrays = {}
        for line in lines:
            key, *words = line.split()
            arrays[key] = np.array([int(word, 16) for word in words], np.uint64).view(np.float64)
        yield pytest.param(title.split()[1:], arrays, id=title.split()[0])


@pytest.mark.parametrize(("design", "arrays"), list(golden_cases()))
def test_design_and_filter_give_the_golden_bits(design, arrays):
    order, band, low, high, rate = design
    edges = float(low) if band in {"lowpass", "highpass"} else [float(low), float(high)]
    sos, got = arrays["sos"].reshape(-1, 6), butter(int(order), edges, band, fs=float(rate))
    assert got.shape == sos.shape
    for half in (slice(0, 3), slice(3, 6)):  # numerators and denominators
        scale = np.abs(sos[:, half]).max(axis=1, keepdims=True)
        assert np.all(np.abs(got - sos)[:, half] <= 1e-12 * scale)
    y, zf = sosfilt(sos, arrays["x"], zi=arrays["zi"].reshape(-1, 2))
    assert same_bits(y, arrays["y"])
    assert same_bits(zf.ravel(), arrays["zf"])


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"N": 0}, ValueError, "N must be at least 1, got 0"),
        ({"N": 33}, ValueError, "order must be from 1 to 32, got 33"),
        ({"N": 2.5}, TypeError, "N must be a whole number, got 2.5"),
        ({"btype": "notch"}, ValueError, "name of a band, got .notch"),
        ({"Wn": 0}, ValueError, r"cutoff_hz must be in .* \(0, 1\), got 0 at rate_hz = 2"),
        ({"Wn": float("nan")}, ValueError, "cutoff_hz must be in"),
        ({"Wn": 250, "fs": 500}, ValueError, r"cutoff_hz must be in .* \(0, 250\), got 250 at rate_hz = 500"),
        ({"Wn": [0.1, 0.2]}, ValueError, "Wn must be one frequency, or two for a band"),
        ({"Wn": 0.1, "btype": "bandpass"}, ValueError, "Wn must be one frequency, or two for a band"),
        ({"Wn": [0.2, 0.2], "btype": "bandstop"}, ValueError, "band edges must satisfy low < high"),
        ({"Wn": 0.2j}, TypeError, "Wn must hold real numbers"),
        ({"fs": 0}, ValueError, "rate_hz must be positive"),
        ({"N": 32, "Wn": 1e-12}, ValueError, "order must be lower"),
    ],
)
def test_butter_of_bad_arguments_raises(arguments, error, message):
    with pytest.raises(error, match=message):
        butter(**{"N": 4, "Wn": 0.2} | arguments)


def test_sosfilt_of_a_subnormal_tail_keeps_its_bits():
    x = np.zeros((20_000, 2))
    x[:100] = 1.0
    for axis, signal in ((0, x), (-1, x[:, 0])):
        y = sosfilt(SOS, signal, axis)
        assert same_bits(y, scipy_signal.sosfilt(SOS, signal, axis))
        tail = np.abs(y[-1000:])
        assert 0 < tail.max() < np.finfo(float).tiny


def test_sosfilt_takes_one_row_and_an_all_pass():
    assert same_bits(sosfilt(SOS[0], X, 0), sosfilt(SOS[:1], X, 0))
    # A numerator that is its denominator passes everything.
    assert sosfilt([[1, 2, 3, 1, 2, 3]], [1.0, -5.0, 2.0]).tolist() == [1.0, -5.0, 2.0]


def test_integrators_filter_but_have_no_rest():
    assert sosfilt(INTEGRATOR, [1, 2, 3]).tolist() == [1, 3, 6]
    with pytest.raises(ValueError, match="got section 1 with a pole at z = 1"):
        sosfilt_zi([SOS[0], *INTEGRATOR])


def test_sosfilt_in_threads_gives_the_same_bits():
    x = np.random.default_rng(5).standard_normal((2000, 6))
    wanted = sosfilt(SOS, x, 0)
    results = at_once([lambda: all(same_bits(sosfilt(SOS, x, 0), wanted) for _ in range(10))] * N_THREADS)
    assert results == [True] * N_THREADS
