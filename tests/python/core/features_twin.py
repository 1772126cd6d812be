"""The oracle of feature extraction: scipy filters, numpy counts, straight loops; and random cases for it."""

import numpy as np
from scipy import signal as scipy_signal

from granular_id.signal import butter, sosfilt_zi

AXES = [6, 6, 6, 1, 3, 13, 25, 40]


def high_passed(batch, *, rate_hz=500.0, cutoff_hz=23.0, order=8, initial="zero", **_):
    """Every axis of ``(n, n_samples, n_axes)`` through scipy's filter, on the sections of `butter`."""
    sos = butter(order, cutoff_hz, "highpass", fs=rate_hz)
    n_recordings, _, n_axes = batch.shape
    zi = np.zeros((len(sos), n_recordings, 2, n_axes))
    if initial == "steady":
        zi[:] = sosfilt_zi(sos)[:, None, :, None] * batch[:, 0, :][None, :, None, :]
    filtered, _ = scipy_signal.sosfilt(sos, batch, axis=1, zi=zi)
    return filtered


def counts(values, n_bins, low, high, *, outside="drop", density=False):
    """One histogram as the feature vector holds it."""
    if outside == "clip":
        values = np.clip(values, low, high)
    counted, edges = np.histogram(values, n_bins, (low, high))
    if not density:
        return counted.astype(np.float64)
    if counted.sum() == 0:  # numpy divides zero by zero
        return np.zeros(n_bins)
    return counted / np.diff(edges) / counted.sum()


def features(wrench, *, dtype=np.float64, **keywords):
    """The feature vectors of one recording or a batch, as `extract_features` promises them."""
    options = {"n_bins": 100, "bin_range": (-1.5, 1.5), "raw": True, "hfmh": True} | keywords
    batch = np.asarray(wrench, np.float64)
    single = batch.ndim == 2
    batch = batch[None] if single else batch
    n_axes = batch.shape[2]
    rows = []
    ranges = np.broadcast_to(options["bin_range"], (n_axes, 2))
    filtered = high_passed(batch, **keywords) if options["hfmh"] else batch
    rules = {name: keywords[name] for name in ("outside", "density") if name in keywords}
    for recording, passed in zip(batch, filtered, strict=True):
        parts = []
        if options["raw"]:
            parts += [recording[:, axis] for axis in range(n_axes)]
        if options["hfmh"]:
            parts += [
                counts(passed[:, axis], options["n_bins"], *ranges[axis], **rules) for axis in range(n_axes)
            ]
        rows.append(np.concatenate(parts))
    return (rows[0] if single else np.array(rows)).astype(dtype)


def differing_bits(got, wanted):
    """How many numbers are not the same bit for bit."""
    assert got.shape == wanted.shape
    assert got.dtype == wanted.dtype
    assert got.flags.c_contiguous
    kind = np.int64 if got.dtype == np.float64 else np.int32
    return int(np.count_nonzero(got.view(kind) != np.ascontiguousarray(wanted).view(kind)))


def a_wrench(rng, shape):
    """Signals of many characters: noise, walks, offsets, silence, steps, huge and subnormal numbers."""
    x = rng.standard_normal(shape)
    kind = rng.integers(8)
    if kind == 1:
        x = 0.1 * np.cumsum(x, axis=1)
    elif kind == 2:
        x[rng.random(shape) < 0.9] = 0.0
    elif kind == 3:
        x = np.zeros(shape) + rng.standard_normal()
    elif kind == 4:
        x *= 10.0 ** rng.integers(-323, -300)
    elif kind == 5:
        x *= 10.0 ** rng.integers(1, 200)
    elif kind == 6:
        x = rng.integers(-9, 9, shape).astype(np.float64)
    elif kind == 7:
        x = x * 0.3 + rng.uniform(-40, 40, shape[-1])
    return x


def some_options(rng, n_axes):
    low = rng.uniform(-3, 1, (n_axes, 1))
    ranges = np.hstack([low, low + 10.0 ** rng.uniform(-2, 1, (n_axes, 1))])
    raw, hfmh = [(True, True), (True, True), (False, True), (True, False)][rng.integers(4)]
    return {
        "rate_hz": float(rng.choice([100.0, 500.0, 1000.0])),
        "cutoff_hz": float(rng.uniform(0.5, 49)),
        "order": int(rng.integers(1, 13)),
        "n_bins": int(rng.choice([1, 2, 3, 7, 10, 64, 100, 333])),
        "bin_range": ranges if rng.random() < 0.5 else tuple(ranges[0]),
        "raw": raw,
        "hfmh": hfmh,
        "outside": str(rng.choice(["drop", "clip"])),
        "density": bool(rng.random() < 0.3),
        "initial": str(rng.choice(["zero", "steady"])),
    }
