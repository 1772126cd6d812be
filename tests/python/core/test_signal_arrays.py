"""Arrays of every kind give the right numbers or one clear exception, and are never modified."""

import numpy as np
import pytest
from scipy import signal as scipy_signal

from array_kinds import misaligned, read_only
from granular_id.signal import butter, sosfilt, sosfilt_zi, sosfiltfilt

SOS = butter(8, 23, "highpass", fs=500)
X = np.random.default_rng(11).standard_normal((40, 3))


def same_bits(a, b):
    a, b = np.ascontiguousarray(a), np.ascontiguousarray(b)
    return a.shape == b.shape and a.dtype == b.dtype == np.float64 and a.tobytes() == b.tobytes()


class Subclass(np.ndarray):
    pass


def every_other(x):
    wide = np.zeros((2 * x.shape[0], *x.shape[1:]))
    wide[::2] = x
    return wide[::2]


KINDS = {
    "contiguous": np.array,
    "every other row": every_other,
    "reversed": lambda x: np.array(x[..., ::-1])[..., ::-1],
    "reversed in time": lambda x: np.array(x[::-1])[::-1],
    "Fortran order": np.asfortranarray,
    "transposed": lambda x: np.array(np.swapaxes(x, 0, 1)).swapaxes(0, 1),
    "read-only": read_only,
    "misaligned": misaligned,
    "byte-swapped": lambda x: x.astype(x.dtype.newbyteorder()),
    "broadcast": lambda x: np.broadcast_to(x[:, :1], x.shape),
    "float32": lambda x: x.astype(np.float32),
    "float16": lambda x: x.astype(np.float16),
    "long double": lambda x: x.astype(np.longdouble),
    "int8": lambda x: (10 * x).astype(np.int8),
    "uint64": lambda x: np.abs(10 * x).astype(np.uint64),
    "bool": lambda x: x > 0,
    "nested lists": lambda x: x.tolist(),
    "subclass": lambda x: x.view(Subclass),
    "subnormal": lambda x: x * 5e-310,
    "huge": lambda x: x * 1e306,
}


@pytest.mark.parametrize("axis", [0, 1, -1, -2])
@pytest.mark.parametrize("kind", KINDS)
def test_any_memory_layout_and_type(kind, axis, monkeypatch):
    # scipy solves for the steady state with LAPACK, which fuses products and sums on some processors and not on others.
    monkeypatch.setattr("scipy.signal._signaltools.sosfilt_zi", sosfilt_zi)
    x = KINDS[kind](X)
    before = np.array(x).tobytes()
    plain = np.array(x, np.float64, order="C")
    wanted = scipy_signal.sosfilt(SOS, plain, axis=axis)
    assert same_bits(sosfilt(SOS, x, axis), wanted)
    assert same_bits(
        sosfiltfilt(SOS, x, axis, padlen=1), scipy_signal.sosfiltfilt(SOS, plain, axis, padlen=1)
    )
    zi = np.random.default_rng(3).standard_normal((4, 2, 3) if axis in {0, -2} else (4, 40, 2))
    y, zf = sosfilt(SOS, x, axis, zi=zi)
    wanted_y, wanted_zf = scipy_signal.sosfilt(SOS, plain, axis, zi=zi)
    assert same_bits(y, wanted_y)
    assert same_bits(zf, wanted_zf)
    assert np.array(x).tobytes() == before


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in {"bool", "int8", "uint64", "huge"}])
def test_any_memory_layout_of_sections_and_states(kind):
    sos = KINDS[kind](SOS)
    if kind in {"float32", "float16", "subnormal", "broadcast"}:
        # The first three columns only: a0 must stay 1, and rounding must not move a pole.
        sos = np.concatenate([np.array(sos, np.float64)[:, :3], SOS[:, 3:]], axis=1)
    zi = KINDS[kind](np.ones((4, 2)))
    y, zf = sosfilt(sos, X[:, 0], zi=zi)
    wanted_y, wanted_zf = scipy_signal.sosfilt(
        np.array(sos, np.float64, order="C"), X[:, 0], zi=np.array(zi, np.float64)
    )
    assert same_bits(y, wanted_y)
    assert same_bits(zf, wanted_zf)


def test_memory_mapped(tmp_path):
    np.save(tmp_path / "x.npy", X)
    mapped = np.load(tmp_path / "x.npy", mmap_mode="r")
    assert same_bits(sosfilt(SOS, mapped, 0), sosfilt(SOS, X, 0))


def test_results_are_new_writable_arrays_in_c_order():
    x, zi = np.zeros((5, 3)), np.zeros((4, 2, 3))
    y, zf = sosfilt(SOS, x, 0, zi=zi)
    for result in (y, zf, sosfilt(SOS, x, 0), sosfiltfilt(SOS, x, 0, padtype=None), sosfilt_zi(SOS)):
        assert result.flags.c_contiguous
        assert result.flags.writeable
        assert not np.shares_memory(result, x)
        assert not np.shares_memory(result, zi)


@pytest.mark.parametrize("shape", [(0,), (0, 3), (3, 0), (2, 0, 4)])
def test_empty(shape):
    for axis in range(len(shape)):
        zi_shape = [4, *shape]
        zi_shape[axis + 1] = 2
        zi = np.full(zi_shape, 0.5)
        y, zf = sosfilt(SOS, np.zeros(shape), axis, zi=zi)
        assert y.shape == shape
        assert zf.shape == zi.shape
        if shape[axis] == 0:
            assert same_bits(zf, zi)


def test_an_empty_array_with_a_huge_dimension():
    x = np.zeros((0, 10**15))
    for axis in (0, 1):
        assert sosfilt(SOS, x, axis).shape == x.shape
    assert sosfiltfilt(SOS, x, 1).shape == x.shape


def test_many_dimensions():
    x = np.random.default_rng(2).standard_normal((1,) * 20 + (9, 2))
    assert same_bits(sosfilt(SOS, x, -2), scipy_signal.sosfilt(SOS, x, -2))
    deep = np.ones((1,) * 31 + (4,))
    assert same_bits(sosfilt(SOS, deep).ravel(), sosfilt(SOS, np.ones(4)))


def changed(column, value):
    sos = SOS.copy()
    sos[2, column] = value
    return sos


BAD_SOS = [
    (changed(3, 2.0), ValueError, r"sos\[:, 3\] \(a0\) should be all ones, got 2 in section 2"),
    (changed(1, np.nan), ValueError, r"sos\[2, 1\] must be finite, got NaN"),
    (changed(4, np.inf), ValueError, r"sos\[2, 4\] must be finite, got inf"),
    (changed(5, 1.21), ValueError, "sos must be stable, got section 2 with a pole of radius 1.1"),
    (np.zeros((0, 6)), ValueError, "sos must have at least one section"),
    (np.ones((2, 5)), ValueError, r"sos must have shape \(n_sections, 6\), got \(2, 5\)"),
    (np.ones((1, 2, 6)), ValueError, r"sos must have shape \(n_sections, 6\), got \(1, 2, 6\)"),
    (np.ones(5), ValueError, r"sos must have shape \(n_sections, 6\), got \(5,\)"),
    (1.0, ValueError, r"sos must have shape \(n_sections, 6\), got \(\)"),
    (SOS.astype(complex), TypeError, "sos must hold real numbers, got dtype complex128"),
    (None, TypeError, "sos must hold real numbers, got dtype object"),
    ("sos", TypeError, "sos must hold real numbers, got dtype <U3"),
    ([[1, 2], [3]], ValueError, "sos must be an array of real numbers"),
]


@pytest.mark.parametrize(("sos", "error", "message"), BAD_SOS)
def test_bad_sections(sos, error, message):
    for call in (sosfilt_zi, lambda sos: sosfilt(sos, X), lambda sos: sosfiltfilt(sos, X, 0, padlen=3)):
        with pytest.raises(error, match=message):
            call(sos)


BAD_X = [
    (1.5, ValueError, "x must be at least 1-D"),
    (np.array(3), ValueError, "x must be at least 1-D"),
    (X.astype(complex), TypeError, "x must hold real numbers, got dtype complex128"),
    (X.astype(object), TypeError, "x must hold real numbers, got dtype object"),
    (np.zeros(40, "M8[s]"), TypeError, "x must hold real numbers, got dtype datetime64"),
    (np.zeros(40, "S2"), TypeError, "x must hold real numbers"),
    (np.zeros(40, [("a", float)]), TypeError, "x must hold real numbers"),
    (np.ma.masked_array(X, X > 0), TypeError, "x must be a plain array, got a masked one"),
    (["a", "b"], TypeError, "x must hold real numbers"),
    ([[1.0], [1.0, 2.0]], ValueError, "x must be an array of real numbers, got .*list"),
    (None, TypeError, "x must hold real numbers, got dtype object"),
    ({"x": 1}, TypeError, "x must hold real numbers, got dtype object"),
]


@pytest.mark.parametrize(("x", "error", "message"), BAD_X)
def test_bad_signals(x, error, message):
    for call in (sosfilt, sosfiltfilt):
        with pytest.raises(error, match=message):
            call(SOS, x)


@pytest.mark.parametrize("axis", [2, -3, 10**30, -(10**30)])
def test_axes_that_are_not_there(axis):
    for call in (sosfilt, sosfiltfilt):
        with pytest.raises(
            ValueError, match=rf"axis must be in \[-2, 2\) for x of shape \(40, 3\), got {axis}"
        ) as caught:
            call(SOS, X, axis)
        assert isinstance(caught.value, IndexError)


@pytest.mark.parametrize("axis", [1.0, "0", None])
def test_axes_that_are_no_integers(axis):
    with pytest.raises(TypeError, match="axis must be an integer, got"):
        sosfilt(SOS, X, axis)


@pytest.mark.parametrize(
    ("zi", "error", "message"),
    [
        (np.zeros((4, 2)), ValueError, r"Invalid zi shape: zi must have shape \(4, 2, 3\) .*got \(4, 2\)"),
        (np.zeros((4, 40, 2)), ValueError, "Invalid zi shape"),
        (np.zeros((3, 2, 3)), ValueError, "Invalid zi shape.*with 4 sections"),
        (0.0, ValueError, r"Invalid zi shape.*got \(\)"),
        (np.zeros((4, 2, 3), complex), TypeError, "zi must hold real numbers, got dtype complex128"),
        (np.ma.zeros((4, 2, 3)), TypeError, "zi must be a plain array"),
    ],
)
def test_bad_states(zi, error, message):
    with pytest.raises(error, match=message):
        sosfilt(SOS, X, 0, zi=zi)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (
            {"padlen": 40},
            ValueError,
            "x must be longer than padlen along the axis, got 40 samples for padlen = 40",
        ),
        ({"padlen": 10**30}, ValueError, "padlen must be at least 0"),
        ({"padlen": -1}, ValueError, "padlen must be at least 0"),
        ({"padlen": 2.0}, TypeError, "padlen must be an integer or None"),
        (
            {"padtype": "reflect"},
            ValueError,
            "padtype must be 'odd', 'even', 'constant' or None, got 'reflect'",
        ),
        ({"padtype": 3}, ValueError, "padtype must be .* got 3"),
        ({"axis": 1}, ValueError, "got 3 samples for padlen = 27"),
    ],
)
def test_bad_padding(arguments, error, message):
    with pytest.raises(error, match=message):
        sosfiltfilt(SOS, X, **{"axis": 0} | arguments)
