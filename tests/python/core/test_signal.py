"""Filter design and filtering: golden numbers, scipy's conventions, states, threads."""

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


def assert_same_sections(got, wanted, tolerance=1e-12):
    """Numerators and denominators, each to so much of its largest coefficient."""
    assert got.shape == wanted.shape
    for half in (slice(0, 3), slice(3, 6)):
        scale = np.abs(wanted[:, half]).max(axis=1, keepdims=True)
        assert np.all(np.abs(got - wanted)[:, half] <= tolerance * scale)


def golden_cases():
    for block in GOLDEN.read_text().split("case ")[1:]:
        title, *lines = block.strip().splitlines()
        arrays = {}
        for line in lines:
            key, *words = line.split()
            arrays[key] = np.array([int(word, 16) for word in words], np.uint64).view(np.float64)
        yield pytest.param(title.split()[1:], arrays, id=title.split()[0])


@pytest.mark.parametrize(("design", "arrays"), list(golden_cases()))
def test_golden(design, arrays):
    order, band, low, high, rate = design
    edges = float(low) if band in {"lowpass", "highpass"} else [float(low), float(high)]
    sos = arrays["sos"].reshape(-1, 6)
    assert_same_sections(butter(int(order), edges, band, fs=float(rate)), sos)
    y, zf = sosfilt(sos, arrays["x"], zi=arrays["zi"].reshape(-1, 2))
    assert same_bits(y, arrays["y"])
    assert same_bits(zf.ravel(), arrays["zf"])


@pytest.mark.parametrize(
    ("band", "edges"), [("lowpass", 23), ("highpass", 23), ("bandpass", (20, 60)), ("bandstop", (20, 60))]
)
def test_butter_equals_scipy_section_by_section(band, edges):
    for order in range(1, 33):
        wanted = scipy_signal.butter(order, edges, band, fs=500, output="sos")
        assert_same_sections(butter(order, edges, band, fs=500), wanted)


@pytest.mark.parametrize(
    ("names", "edges"),
    [
        (["lowpass", "l", "low", "lp", "LOW"], 0.3),
        (["highpass", "h", "high", "hp", "HighPass"], 0.3),
        (["bandpass", "band", "pass", "bp"], [0.3, 0.4]),
        (["bandstop", "bands", "stop", "bs"], [0.3, 0.4]),
    ],
)
def test_names_of_bands(names, edges):
    assert all(same_bits(butter(3, edges, name), butter(3, edges, names[0])) for name in names)


def test_arguments_of_equal_value_give_equal_filters():
    wanted = butter(4, 0.25)
    for N, Wn in [(4.0, 0.25), (np.int8(4), np.float32(0.25)), (4, [0.25]), (4, np.array(0.25))]:
        assert same_bits(butter(N, Wn), wanted)
    assert same_bits(butter(4, 125, fs=1000), wanted)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"N": 0}, ValueError, "N must be at least 1, got 0"),
        ({"N": 33}, ValueError, "N must be at most 32, got 33"),
        ({"N": 10**30}, ValueError, "N must be at most 32"),
        ({"N": 2.5}, TypeError, "N must be a whole number, got 2.5"),
        ({"N": float("nan")}, TypeError, "N must be a whole number"),
        ({"N": "2"}, TypeError, "N must be a whole number"),
        ({"btype": "notch"}, ValueError, "btype must be one of 'lowpass', .*got 'notch'"),
        ({"btype": None}, ValueError, "btype must be one of"),
        ({"Wn": 0}, ValueError, r"cutoff_hz must be in .* \(0, 1\), got 0 at rate_hz = 2"),
        ({"Wn": float("nan")}, ValueError, "cutoff_hz must be in"),
        ({"Wn": 250, "fs": 500}, ValueError, r"cutoff_hz must be in .* \(0, 250\), got 250 at rate_hz = 500"),
        ({"Wn": [0.1, 0.2]}, ValueError, "Wn must be a single frequency for btype 'lowpass'"),
        ({"Wn": 0.1, "btype": "band"}, ValueError, "Wn must be two frequencies"),
        ({"Wn": [[0.1, 0.2]], "btype": "band"}, ValueError, "Wn must be two frequencies"),
        ({"Wn": [0.2, 0.2], "btype": "stop"}, ValueError, "band edges must satisfy low < high"),
        ({"Wn": [0.2, 1.2], "btype": "band"}, ValueError, "cutoff_hz must be in .* got 1.2"),
        ({"Wn": 0.2j}, TypeError, "Wn must hold real numbers"),
        ({"fs": 0}, ValueError, "fs must be positive"),
        ({"fs": float("inf")}, ValueError, "fs must be positive"),
        ({"fs": [1, 2]}, TypeError, "fs must be a number"),
        ({"N": 32, "Wn": 1e-12}, ValueError, "order 32 is too high"),
    ],
)
def test_bad_designs(arguments, error, message):
    with pytest.raises(error, match=message):
        butter(**{"N": 4, "Wn": 0.2} | arguments)


def test_a_tail_of_subnormal_numbers_keeps_its_bits():
    x = np.zeros((20_000, 2))
    x[:100] = 1.0
    for axis, signal in ((0, x), (-1, x[:, 0])):
        y = sosfilt(SOS, signal, axis)
        assert same_bits(y, scipy_signal.sosfilt(SOS, signal, axis))
        tail = np.abs(y[-1000:])
        assert 0 < tail.max() < np.finfo(float).tiny


def test_odd_sections():
    assert same_bits(sosfilt(SOS[0], X, 0), sosfilt(SOS[:1], X, 0))
    # A numerator that is its denominator passes everything.
    assert sosfilt([[1, 2, 3, 1, 2, 3]], [1.0, -5.0, 2.0]).tolist() == [1.0, -5.0, 2.0]


def test_integrators_filter_but_have_no_steady_state():
    assert sosfilt(INTEGRATOR, [1, 2, 3]).tolist() == [1, 3, 6]
    with pytest.raises(ValueError, match="got section 1 with a pole at z = 1"):
        sosfilt_zi([SOS[0], *INTEGRATOR])


def test_threads_share_input_and_filter():
    x = np.random.default_rng(5).standard_normal((2000, 6))
    wanted = sosfilt(SOS, x, 0)
    results = at_once([lambda: all(same_bits(sosfilt(SOS, x, 0), wanted) for _ in range(10))] * N_THREADS)
    assert results == [True] * N_THREADS
