"""The oracle of feature extraction: scipy filters, numpy counts, straight loops over recordings and axes."""

import numpy as np
from scipy import signal as scipy_signal

from granular_id.signal import butter, sosfilt_zi


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
