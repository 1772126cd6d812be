"""Filter design and filtering: arrays of every kind, threads, and one clear exception for what is bad."""

import numpy as np
import pytest
from scipy import signal as scipy_signal

from array_kinds import KINDS, digest
from core_cases import same_bits
from granular_id.signal import butter, sosfilt, sosfilt_zi

SOS = butter(8, 23, "highpass", fs=500)
X = np.random.default_rng(11).standard_normal((40, 3))


@pytest.mark.filterwarnings("ignore:the matrix subclass:PendingDeprecationWarning")
@pytest.mark.parametrize("axis", [0, -1])
@pytest.mark.parametrize("kind", KINDS)
def test_sosfilt_takes_every_kind_of_array(kind, axis):
    x = KINDS[kind](np.random.default_rng(11).standard_normal((24, 6)))
    before = digest(x)
    plain = np.array(x, np.float64, order="C")
    assert same_bits(sosfilt(SOS, x, axis), scipy_signal.sosfilt(SOS, plain, axis))
    zi = np.random.default_rng(3).standard_normal(
        (4, 2, plain.shape[1]) if axis == 0 else (4, plain.shape[0], 2)
    )
    y, zf = sosfilt(SOS, x, axis, zi=zi)
    wanted_y, wanted_zf = scipy_signal.sosfilt(SOS, plain, axis, zi=zi)
    assert same_bits(y, wanted_y)
    assert same_bits(zf, wanted_zf)
    assert digest(x) == before


def test_sosfilt_returns_new_writable_arrays():
    x, zi = np.zeros((5, 3)), np.zeros((4, 2, 3))
    y, zf = sosfilt(SOS, x, 0, zi=zi)
    for result in (y, zf, sosfilt(SOS, x, 0), sosfilt_zi(SOS)):
        assert result.flags.c_contiguous
        assert result.flags.writeable
        assert not np.shares_memory(result, x)
        assert not np.shares_memory(result, zi)


@pytest.mark.parametrize(
    ("shape", "zi_shape"), [((0,), (4, 2)), ((0, 3), (4, 2, 3)), ((2, 0, 4), (4, 2, 0, 4))]
)
def test_sosfilt_of_nothing_returns_its_shapes(shape, zi_shape):
    zi = np.full(zi_shape, 0.5)
    y, zf = sosfilt(SOS, np.zeros(shape), 0, zi=zi)
    assert y.shape == sosfilt(SOS, np.zeros(shape), 0).shape == shape
    assert same_bits(zf, zi)


def test_sosfilt_takes_one_section_as_a_row():
    assert same_bits(sosfilt(SOS[0], X, 0), sosfilt(SOS[:1], X, 0))


def test_integrator_filters_but_has_no_rest():
    integrator = [1, 0, 0, 1, -1, 0]
    assert sosfilt(integrator, [1, 2, 3]).tolist() == [1, 3, 6]
    with pytest.raises(ValueError, match="got section 1 with a pole at z = 1"):
        sosfilt_zi([SOS[0], integrator])


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


def changed(column, value):
    sos = SOS.copy()
    sos[2, column] = value
    return sos


@pytest.mark.parametrize(
    ("sos", "error", "message"),
    [
        (changed(3, 2.0), ValueError, r"sos\[:, 3\] \(a0\) must be all ones, got 2 in section 2"),
        (changed(1, np.nan), ValueError, r"sos must be finite, got NaN at \[2, 1\]"),
        (changed(4, np.inf), ValueError, r"sos must be finite, got inf at \[2, 4\]"),
        (changed(5, 1.21), ValueError, "sos must be stable, got section 2 with a pole of radius 1.1"),
        (np.zeros((0, 6)), ValueError, "sos must have at least one section"),
        (1.0, ValueError, r"sos must have shape \(n_sections, 6\), got \(\)"),
    ],
)
def test_bad_sections_raise(sos, error, message):
    for call in (sosfilt_zi, lambda sos: sosfilt(sos, X)):
        with pytest.raises(error, match=message):
            call(sos)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"x": 1.5}, "x must be at least 1-D"),
        ({"axis": 2}, "axis must be"),
        ({"axis": -3}, "axis must be"),
        ({"zi": np.zeros((4, 2))}, r"Invalid zi shape: zi must have shape \(4, 2, 3\) .*got \(4, 2\)"),
        ({"zi": np.zeros((3, 2, 3))}, "Invalid zi shape.*with 4 sections"),
    ],
)
def test_sosfilt_of_bad_arguments_raises(changes, message):
    with pytest.raises(ValueError, match=message):
        sosfilt(**{"sos": SOS, "x": X, "axis": 0, **changes})
