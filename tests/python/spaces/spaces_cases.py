"""Recordings for the tests of feature spaces, and each transformer in the forms that matter."""

import numpy as np

from granular_id.recording import AXES, Dataset, Recording
from granular_id.rica import RICA
from granular_id.spaces import (
    DFT,
    HFMH,
    BlockScaler,
    MultiBand,
    RangeNormalizer,
    RawHFMH,
    RawHistogram,
    RawSignal,
    Tare,
    TimePermutation,
    WithinClassWhitening,
)


def recordings(n=5, n_samples=300, n_axes=6, seed=0):
    """Noise around an offset, the first axis loudest."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=(n, n_samples, n_axes)) * np.linspace(0.5, 0.01, n_axes) + rng.normal(size=n_axes)


IMU = ("wx", "wy", "wz", "ax", "ay", "az")
IMU_UNITS = ("rad/s",) * 3 + ("m/s2",) * 3


def data_set(n=6, n_samples=300, axes=AXES, units=(), rate_hz=500.0):
    """The same with names of axes, in three sessions of two labels that differ in their size."""
    X = recordings(n, n_samples, len(axes))
    meta = {"units": dict(zip(axes, units, strict=True))} if units else {}
    return Dataset(
        [
            Recording(
                X[k] * (1 + k % 2),
                rate_hz,
                label=("oat", "rice")[k % 2],
                session=f"day {k // 2 % 3}",
                name=f"r{k}",
                axes=axes,
                meta=meta,
            )
            for k in range(n)
        ]
    )


# A new feature space belongs here, or below: scikit-learn's checks and those of all spaces run over these.
SPACES = {
    "raw": RawSignal(),
    "range": RangeNormalizer(),
    "hfmh": HFMH(),
    # An odd number of bins: with a steady start the first values are 0 up to rounding, no place for an edge.
    "hfmh, own range": HFMH(bin_range="auto", initial="steady", n_bins=25),
    "raw+hfmh": RawHFMH(),
    "raw+hfmh, weighted": RawHFMH(block_weights="unit", bin_range="auto"),
    "dft": DFT(),
    "dft magnitude": DFT("magnitude"),
    "histogram": RawHistogram(),
    "histogram, own range": RawHistogram(bin_range=(-2.0, 2.0), n_bins=7),
}
# Columns that have no one coordinate to be read along.
STATISTICS = {
    "multi-band": MultiBand(),
    "multi-band, levels": MultiBand(blocks=["level", "quantiles"], rate_hz=100.0),
}
# One sample of rest, so that recordings of scikit-learn's checks are long enough.
FILTERS = {"tare": Tare(0.002), "permutation": TimePermutation()}
ROWS = {"rica": RICA(3, random_state=0)}
# Of columns, some with labels: they stand between a space and a classifier.
SCALERS = {
    "scaling": BlockScaler(),
    "whitening": WithinClassWhitening(),
    "whitening, strong": WithinClassWhitening(0.5),
}
