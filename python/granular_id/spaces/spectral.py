"""Discrete Fourier transform of each axis."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from granular_id._checks import checked_choice
from granular_id.features import feature_names
from granular_id.spaces.base import FeatureBlock, RecordingTransformer, axis_series

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

# Recordings transformed at once: their spectra stay in the cache until they are written out.
_ROWS = 16


class DFT(RecordingTransformer):
    """Discrete Fourier transform of each axis, as ``numpy.fft.rfft`` gives it.

    Real signals have symmetric spectra, so only frequencies up to half the rate remain. Where one of them
    stands for two it is multiplied by sqrt(2): scalar products and distances are those of the full transform.

    Parameters
    ----------
    kind : {"complex", "magnitude"}, default "complex"
        "complex": real parts of all axes, then imaginary parts. A rotation of the signal times sqrt(T): with a
        linear kernel it tells exactly what the raw signal tells. The paper's DFT scores as its raw signal does, so
        it most likely was this one. "magnitude": without the phase, and so without regard to when things
        happen; often a far stronger feature.
    rate_hz : float or None, default None
        Sampling rate, with which `feature_blocks` gives frequencies in hertz. None: that of a `Dataset`; of arrays it
        is not known, and frequencies are in cycles per sample. Changes no feature.

    Notes
    -----
    "complex" has T columns per axis, as many as samples: imaginary parts that are zero for any signal (at
    frequency 0, and at half the rate for even T) are left out. The other has T // 2 + 1 columns per axis.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id import DFT
    >>> X = np.array([[1.0, 0.0, -1.0, 0.0]])
    >>> dft = DFT("magnitude").fit(X)
    >>> dft.transform(X).round(3), dft.get_feature_names_out().tolist()
    (array([[0.   , 2.828, 0.   ]]), ['dft_axis0_0000', 'dft_axis0_0001', 'dft_axis0_0002'])
    """

    def __init__(self, kind: str = "complex", *, rate_hz: float | None = None) -> None:
        self.kind = kind
        self.rate_hz = rate_hz

    def feature_blocks(self) -> tuple[FeatureBlock, ...]:
        """Blocks "dft_re" and "dft_im", or one "dft"; frequencies in Hz, or cycles per sample."""
        rate, unit = (1.0, "1/sample") if self.rate_hz_ is None else (self.rate_hz_, "Hz")
        axes = self._axes
        blocks: list[FeatureBlock] = []
        start = 0
        for name, places in self._parts().items():
            frequencies = np.multiply(places, rate / self.n_features_in_, dtype=np.float64)
            columns = slice(start, start + places.size * len(axes))
            blocks.append(FeatureBlock(name, "frequency", axes, frequencies, unit, columns))
            start = columns.stop
        return tuple(blocks)

    def _learn(self, recordings: FloatArray) -> None:  # noqa: ARG002
        checked_choice("kind", self.kind, "complex", "magnitude")

    def _features(self, recordings: FloatArray) -> FloatArray:
        parts = self._parts()
        # A frequency counts twice where it stands for its mirror image as well.
        twice = np.full(self.n_features_in_ // 2 + 1, math.sqrt(2.0))
        twice[[0, -1] if self.n_features_in_ % 2 == 0 else 0] = 1.0
        series = axis_series(recordings)
        features = np.empty((len(series), self.n_axes_in_ * sum(places.size for places in parts.values())))
        for first in range(0, len(series), _ROWS):
            rows = slice(first, first + _ROWS)
            spectrum = np.fft.rfft(series[rows], axis=2)
            values = {"dft": np.abs(spectrum), "dft_re": spectrum.real, "dft_im": spectrum.imag}
            chosen = [(values[name] * twice)[:, :, places] for name, places in parts.items()]
            features[rows] = np.concatenate([part.reshape(len(part), -1) for part in chosen], axis=1)
        return features

    def _names(self) -> list[str]:
        every = feature_names(n_samples=self.n_features_in_ // 2 + 1, n_axes=self.n_axes_in_, hfmh=False)
        numbered = np.reshape(every, (self.n_axes_in_, -1))
        return [
            f"{name}_{end}" for name, places in self._parts().items() for end in numbered[:, places].ravel()
        ]

    def _parts(self) -> dict[str, IntArray]:
        """Blocks by name, and which of the frequencies 0 ... T // 2 they hold."""
        every = np.arange(self.n_features_in_ // 2 + 1)
        if self.kind == "magnitude":
            return {"dft": every}
        two_sided = every[1 : (self.n_features_in_ + 1) // 2]  # no others have imaginary parts
        return {"dft_re": every, **({"dft_im": two_sided} if two_sided.size else {})}
