"""Discrete Fourier transform of each axis."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from granular_id._checks import positive_number
from granular_id.features import feature_names
from granular_id.spaces.base import FeatureBlock, RecordingTransformer, axis_series

FloatArray = npt.NDArray[np.float64]

_KINDS = ("complex", "magnitude", "log_magnitude")

# Recordings transformed at once: their spectra stay in the cache until they are written out.
_ROWS = 16


class DFT(RecordingTransformer):
    """Discrete Fourier transform of each axis, as ``numpy.fft.rfft`` gives it.

    Real signals have symmetric spectra, so only frequencies up to half the rate are kept. Where one of them
    stands for two it is multiplied by sqrt(2): scalar products and distances are those of the full transform.

    Parameters
    ----------
    kind : {"complex", "magnitude", "log_magnitude"}, default "complex"
        "complex": real parts of all axes, then imaginary parts. A rotation of the signal times sqrt(T): with a
        linear kernel it tells exactly what the raw signal tells. The paper's DFT scores as its raw signal does, so
        it most likely was this one. "magnitude": without the phase, and so without regard to when things
        happen; often a far stronger feature. "log_magnitude": its natural logarithm, so that weak high
        frequencies count beside strong low ones.
    floor : float, default 1e-3
        Smaller magnitudes are raised to this before the logarithm, which a silent or constant axis would
        otherwise send to minus infinity, or to the rounding of zero. In the unit of the axis, of the unnormalised
        transform: 1e-3 N is the magnitude of white noise of 25 uN over 1,600 samples, far below any force sensor's.
    rate_hz : float or None, default None
        Sampling rate, with which `feature_blocks` tells frequencies in hertz. None: that of a `Dataset`; of arrays it
        is not known, and frequencies are told in cycles per sample. Changes no feature.

    Attributes
    ----------
    n_features_in_, n_axes_in_ : int
        Samples T of a recording, and its axes C.

    Notes
    -----
    "complex" has T columns per axis, as many as samples: imaginary parts that are zero for any signal (at
    frequency 0, and at half the rate for even T) are left out. The others have T // 2 + 1 columns per axis.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id import DFT
    >>> X = np.array([[1.0, 0.0, -1.0, 0.0]])
    >>> dft = DFT("magnitude").fit(X)
    >>> dft.transform(X).round(3), dft.get_feature_names_out().tolist()
    (array([[0.   , 2.828, 0.   ]]), ['dft_axis0_0000', 'dft_axis0_0001', 'dft_axis0_0002'])
    """

    _core_refuses_gaps = True

    def __init__(self, kind: str = "complex", *, floor: float = 1e-3, rate_hz: float | None = None) -> None:
        self.kind = kind
        self.floor = floor
        self.rate_hz = rate_hz

    def feature_blocks(self) -> tuple[FeatureBlock, ...]:
        """Blocks "dft_re" and "dft_im", or one "dft" or "dft_log"; frequencies in Hz, or cycles per sample."""
        step, unit = (1.0, "1/sample") if self.rate_hz_ is None else (self.rate_hz_, "Hz")
        axes = self._axes
        blocks = []
        start = 0
        for name, kept in self._parts():
            frequencies = np.arange(kept.start, kept.stop) * (step / self.n_features_in_)
            stop = start + len(frequencies) * len(axes)
            blocks.append(FeatureBlock(name, "frequency", axes, frequencies, unit, slice(start, stop)))
            start = stop
        return tuple(blocks)

    def _learn(self, recordings: FloatArray) -> None:  # noqa: ARG002
        if not isinstance(self.kind, str) or self.kind not in _KINDS:
            raise ValueError(f"kind must be one of {', '.join(map(repr, _KINDS))}, got {self.kind!r}")
        positive_number("floor", self.floor)

    def _features(self, recordings: FloatArray) -> FloatArray:
        parts = list(self._parts())
        twice = self._stands_for()
        series = axis_series(recordings)
        features = np.empty((len(series), self.n_axes_in_ * sum(kept.stop - kept.start for _, kept in parts)))
        for first in range(0, len(series), _ROWS):
            rows = slice(first, first + _ROWS)
            with np.errstate(over="ignore", invalid="ignore"):  # reported below
                spectrum = np.fft.rfft(series[rows], axis=2)
                values = [self._value(name, spectrum[:, :, kept]) * twice[kept] for name, kept in parts]
            features[rows] = np.concatenate([block.reshape(len(block), -1) for block in values], axis=1)
        if not np.isfinite(features).all():
            raise ValueError("X must be finite, with a Fourier transform in the range of float64")
        return features

    def _value(self, name: str, spectrum: Any) -> Any:
        if name == "dft_re":
            return spectrum.real
        if name == "dft_im":
            return spectrum.imag
        magnitude = np.abs(spectrum)
        return magnitude if name == "dft" else np.log(np.maximum(magnitude, self.floor))

    def _names(self) -> list[str]:
        every = feature_names(n_samples=self.n_features_in_ // 2 + 1, n_axes=self.n_axes_in_, hfmh=False)
        numbered = np.reshape(every, (self.n_axes_in_, -1))
        return [f"{name}_{column}" for name, kept in self._parts() for column in numbered[:, kept].ravel()]

    def _parts(self) -> Iterator[tuple[str, slice]]:
        """Names of the blocks, and which of the frequencies 0 ... T // 2 they hold."""
        n_samples = self.n_features_in_
        if self.kind != "complex":
            yield ("dft" if self.kind == "magnitude" else "dft_log"), slice(0, n_samples // 2 + 1)
            return
        yield "dft_re", slice(0, n_samples // 2 + 1)
        if n_samples > 2:
            yield "dft_im", slice(1, (n_samples + 1) // 2)

    def _stands_for(self) -> FloatArray:
        """sqrt(2) where a frequency stands for its mirror image as well."""
        n_samples = self.n_features_in_
        factor = np.full(n_samples // 2 + 1, math.sqrt(2.0))
        factor[0] = 1.0
        if n_samples % 2 == 0:
            factor[-1] = 1.0
        return factor
