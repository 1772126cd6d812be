"""The multi-band features in plain numpy and scipy: slow, short, and independent of the Rust core.

See `granular_id.spaces.MultiBand` for what they are good for.
"""

from __future__ import annotations

import itertools

import numpy as np
from scipy.signal import butter, sosfilt, sosfilt_zi

TOP = 0.98  # of Nyquist: where the highest octave ends
MIN_CYCLES = 1.5  # that the lower edge of a band completes within the recording
LAG = 2  # samples at the rate of the band
MIN_ROWS = 4  # per variable of a matrix of second moments; fewer leave little but chance in it
SD_FLOOR = 1e-3  # added to scaled standard deviations
ENERGY_FLOOR = 1e-6  # added to scaled energies
PROBABILITIES = (0.02, 0.10, 0.25, 0.50, 0.75, 0.90, 0.98)
BINS_PER_OCTAVE, LOWEST, HIGHEST = 16, -6, 8  # of the histogram: 2**-6 to 2**8 of the scale
STRETCHES = 4
SPECTRUM_BINS = 40
SPECTRUM_SAMPLES = 18  # from here on there are more bins than octaves
MIN_WIDTH = 3  # frequencies per bin; the logarithm of fewer is mostly chance
LEVEL_STRETCHES = 16
SHIFTS = (0.03, 3.0)  # of resolvents, whose sum levels off beyond them
ROUNDING = 1e-5  # of the trace, more than moments summed in float32 are off by
EARLY_SAMPLES = 100  # from here on the rate is halved in front of octave 2 already
BLOCKS = ("coupling", "quantiles", "envelope", "spectrum", "level")


def n_octaves(n_samples):
    """Octaves downward from TOP of which the lower edge completes MIN_CYCLES."""
    k = 0
    while TOP / 2 ** (k + 1) * n_samples / 2 >= MIN_CYCLES:
        k += 1
    return k


def early(n_samples):
    """Whether the rate is halved in front of octave 2 already, which then serves octaves 2 and 3."""
    return n_samples >= EARLY_SAMPLES


def halves(k, n_samples):
    """Whether the rate is halved in front of octave k, counted from 0."""
    return k == 1 or k >= 3 if early(n_samples) else k >= 2


def lag(band, n_samples):
    """Samples between the two instants of a coupling; band 0 is the whole signal."""
    return LAG // 2 if band == 2 and early(n_samples) else LAG


def least_samples(band, n_axes, n_samples):
    """Samples of the shortest band that has couplings; half the rate holds as much of the signal in half as many."""
    rows = MIN_ROWS // 2 if band == 2 and early(n_samples) else MIN_ROWS
    return rows * 2 * n_axes + LAG


def band_lengths(n_samples):
    """Samples of each band."""
    lengths, n = [n_samples], n_samples
    for k in range(n_octaves(n_samples)):
        n = -(-n // 2) if halves(k, n_samples) else n
        lengths.append(n)
    return lengths


def filtered(sos, x):
    """Filter (n, C), started as if the first sample had lasted for ever."""
    zi = sosfilt_zi(sos)[:, :, None] * x[0]
    return sosfilt(sos, x, axis=0, zi=zi)[0]


def band_signals(x, n_samples=None):
    """Band 0, the mean-free signal, then the octaves, each at its own rate: a list of (n_b, C)."""
    n_samples = len(x) if n_samples is None else n_samples
    signals = [x - x.mean(axis=0)]
    level, high = x, TOP  # a share of Nyquist at the rate of the level
    for k in range(n_octaves(n_samples)):
        if halves(k, n_samples):  # the low-pass leaves nothing to alias into the band
            level, high = filtered(butter(7, 0.5, output="sos"), level)[::2], 2 * high
        signals.append(filtered(butter(2, [high / 2, high], "bandpass", output="sos"), level))
        high /= 2
    return signals


def rms(signals):
    """(n_bands, C)."""
    return np.array([np.sqrt(np.mean(y**2, axis=0)) for y in signals])


def moments_of(z, lag):
    """Second moments of scaled samples, each stacked on that `lag` earlier."""
    stacked = np.hstack([z[lag:], z[:-lag]])
    return stacked.T @ stacked / len(stacked)


def coupling(y, scale, lag):
    """Resolvents of second moments: sum over c of I - 2 c (M + (c + ROUNDING trace M) I)^-1.

    Upper triangle of the mean of the blocks now-now and earlier-earlier, then the block now-earlier row by row.
    """
    n_axes = len(scale)
    moments, unit = moments_of(y / scale, lag), np.eye(2 * n_axes)
    ridge = ROUNDING * np.trace(moments)
    level = sum(unit - 2 * c * np.linalg.inv(moments + (c + ridge) * unit) for c in SHIFTS)
    same = (level[:n_axes, :n_axes] + level[n_axes:, n_axes:]) / 2
    return np.concatenate([same[np.triu_indices(n_axes)], level[:n_axes, n_axes:].ravel()])


def binned(z):
    """Bin of each value: 0 around zero, then outward on both sides."""
    octave = np.floor(np.log2(np.maximum(np.abs(z), 1e-300)))
    fraction = np.abs(z) / 2.0**octave - 1.0
    index = (octave - LOWEST) * BINS_PER_OCTAVE + np.floor(fraction * BINS_PER_OCTAVE) + 1
    outermost = (HIGHEST - LOWEST) * BINS_PER_OCTAVE
    return (np.sign(z) * np.clip(index, 0, outermost)).astype(int)


def edges(index):
    """Lower and upper edge of a bin."""

    def outer(k):  # the edge of bin k > 0 nearer to zero
        octave, step = divmod(k - 1, BINS_PER_OCTAVE)
        return 2.0 ** (LOWEST + octave) * (1 + step / BINS_PER_OCTAVE)

    if index > 0:
        return outer(index), outer(index + 1)
    if index < 0:
        return -outer(-index + 1), -outer(-index)
    return -outer(1), outer(1)


def histogram_quantile(z, p):
    """Quantile of a histogram: linear within the bin in which the rank p (n - 1) + 1/2 lies."""
    indices, counts = np.unique(binned(z), return_counts=True)
    rank = p * (len(z) - 1) + 0.5
    above = np.cumsum(counts)
    b = int(np.searchsorted(above, rank))
    low, high = edges(indices[b])
    return low + (rank - (above[b] - counts[b])) / counts[b] * (high - low)


def quantiles(y, scale):
    """Axis by axis: seven quantiles, then the logarithm of the RMS."""
    z = y / scale
    rows = []
    for axis in z.T:
        rows += [np.arcsinh(histogram_quantile(axis, p)) for p in PROBABILITIES]
        rows.append(np.log(np.sqrt(np.mean(axis**2)) + SD_FLOOR))
    return np.array(rows)


def stretch_edges(n, stretches):
    return [i * n // stretches for i in range(stretches + 1)]


def envelope(y, scale):
    """Axis by axis: log energy of each stretch."""
    at = stretch_edges(len(y), STRETCHES)
    energies = [np.mean(y[a:b] ** 2, axis=0) / scale**2 for a, b in itertools.pairwise(at)]
    return np.log(np.array(energies).T + ENERGY_FLOOR).ravel()


def spectrum_edges(n_samples):
    """First FFT bin of each pooled bin, then the end: geometric, but MIN_WIDTH apart; a shorter rest joins the last."""
    last = n_samples // 2 + 1
    edges = [1]
    for i in range(1, SPECTRUM_BINS + 1):
        edge = round(last ** (i / SPECTRUM_BINS))
        if edge - edges[-1] >= MIN_WIDTH:
            edges.append(edge)
    return [*edges[: max(len(edges) - 1, 1)], last] if edges[-1] != last else edges


def spectrum(x, scale, n_samples=None):
    """Axis by axis: log power of the Hann periodogram, pooled; a shorter signal is padded with zeros."""
    n = len(x)
    n_samples = n if n_samples is None else n_samples
    window = 0.5 - 0.5 * np.cos(2 * np.pi * (np.arange(n) + 0.5) / n)
    y = (x - x.mean(axis=0)) * window[:, None]
    power = np.abs(np.fft.rfft(y, n_samples, axis=0)) ** 2 / np.sum(window**2) / scale**2
    at = spectrum_edges(n_samples)
    pooled = [power[a:b].mean(axis=0) for a, b in itertools.pairwise(at)]
    return np.log(np.array(pooled).T + ENERGY_FLOOR).ravel()


def level(x, level_scale):
    """Axis by axis: arcsinh of the mean of each stretch."""
    at = stretch_edges(len(x), min(LEVEL_STRETCHES, len(x)))
    means = [x[a:b].mean(axis=0) for a, b in itertools.pairwise(at)]
    return np.arcsinh(np.array(means) / level_scale).T.ravel()


def features(x, scales, level_scale, blocks=BLOCKS, n_samples=None):
    """All blocks of one recording (n, C); `n_samples` is that of a whole recording where `x` is its beginning."""
    n_samples = len(x) if n_samples is None else n_samples
    signals = band_signals(x, n_samples)
    out = []
    for block in blocks:
        if block == "coupling":
            whole = band_lengths(n_samples)
            for b, (y, s) in enumerate(zip(signals, scales, strict=True)):
                if whole[b] >= least_samples(b, x.shape[1], n_samples):
                    out.append(coupling(y, s, lag(b, n_samples)))
        elif block == "quantiles":
            out += [quantiles(y, s) for y, s in zip(signals, scales, strict=True)]
        elif block == "envelope" and n_samples >= STRETCHES:
            out += [envelope(y, s) for y, s in zip(signals, scales, strict=True)]
        elif block == "spectrum" and n_samples >= SPECTRUM_SAMPLES:
            out.append(spectrum(x, scales[0], n_samples))
        elif block == "level":
            out.append(level(x, level_scale))
    return np.concatenate(out)


def learned_scales(recordings):
    """Typical RMS of each band and axis, and typical size of the level of each axis, of recordings (n, T, C).

    A median, so that a few violent recordings do not make all others small; nothing below a billionth of the signal,
    or a millionth of the signal without its mean, which is rounding; 1 for an axis that is zero.
    """
    raw = np.median(np.sqrt(np.mean(recordings**2, axis=1)), axis=0)
    typical = np.median([rms(band_signals(x)) for x in recordings], axis=0)
    scales = np.maximum(np.maximum(typical, 1e-6 * typical[0]), 1e-9 * raw)
    stretches = min(LEVEL_STRETCHES, recordings.shape[1])
    at = stretch_edges(recordings.shape[1], stretches)
    means = np.stack([recordings[:, a:b].mean(axis=1) for a, b in itertools.pairwise(at)], axis=1)
    levels = np.median(np.abs(means), axis=(0, 1))
    levels = np.maximum(levels, 1e-9 * raw)
    return np.where(scales > 0, scales, 1.0), np.where(levels > 0, levels, 1.0)
