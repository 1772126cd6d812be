"""Arrays of many kinds, all real numbers: layouts, widths, byte orders, and things that become arrays."""

import hashlib

import numpy as np
import pandas as pd


class Subclass(np.ndarray):
    """A subclass that would spoil sums if its own methods were used."""

    def __array_ufunc__(self, *args, **kwargs):
        raise AssertionError("arithmetic of a subclass must not be used")


class Lists:
    """Like the series of a data frame: no array, but knows how to become one."""

    def __init__(self, values):
        self.values = values

    def __array__(self, dtype=None, copy=None):
        return np.array(self.values, dtype)


class Polars:
    """As a polars DataFrame shows itself: `columns` is a list, a column is no array but becomes one."""

    def __init__(self, frame):
        self._frame, self.columns = frame, list(frame.columns)

    def __getitem__(self, name):
        return self._frame[name].to_list()


def misaligned(x):
    buffer = np.zeros(x.nbytes + 1, np.uint8)
    view = buffer[1:].view(x.dtype).reshape(x.shape)
    view[...] = x
    assert not view.flags.aligned
    return view


def read_only(x):
    x = x.copy()
    x.flags.writeable = False
    return x


def every_other(axis):
    def kind(x):
        return np.repeat(x, 2, axis=axis)[(slice(None),) * (axis % x.ndim) + (slice(None, None, 2),)]

    return kind


def windows(x):
    """Overlapping windows over one long signal, as a stream is cut into recordings."""
    signal = x.reshape(-1, x.shape[-1])
    cut = np.lib.stride_tricks.sliding_window_view(signal, 8, axis=0)
    recordings = cut[:5].swapaxes(-1, -2)
    return recordings if x.ndim == 3 else recordings[0]


KINDS = {
    "read-only": read_only,
    "every other sample": every_other(-2),
    "axes reversed": lambda x: np.array(x[..., ::-1])[..., ::-1],
    "Fortran order": np.asfortranarray,
    "misaligned": misaligned,
    "byte-swapped": lambda x: x.astype(x.dtype.newbyteorder()),
    "broadcast": lambda x: np.broadcast_to(x[..., :1], x.shape),
    "sliding windows": windows,
    "float16": lambda x: x.astype(np.float16),
    "float32": lambda x: x.astype(np.float32),
    "long double": lambda x: x.astype(np.longdouble),
    "int8": lambda x: (10 * x).astype(np.int8),
    "int64 beyond 2**53": lambda x: (1e18 * x).astype(np.int64),
    "bool": lambda x: x > 0,
    "nested lists": lambda x: x.tolist(),
    "lists of arrays": list,
    "subclass": lambda x: x.view(Subclass),
    "matrix": lambda x: np.asmatrix(x.reshape(-1, x.shape[-1])),
    "__array__": Lists,
    "data frame": lambda x: pd.DataFrame(x.reshape(-1, x.shape[-1])),
    "memoryview": memoryview,
    "subnormal": lambda x: x * 5e-310,
    "huge": lambda x: x * 1e290,
}


def digest(value):
    """What the caller's numbers and their layout are."""
    values = np.asarray(value.values if isinstance(value, Lists) else value)
    return hashlib.sha256(values.tobytes()).hexdigest(), values.shape, values.strides, str(values.dtype)
