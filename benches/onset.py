"""How often is an onset found where nothing moves, and how far from the truth where something does?

Two tables. The first counts false onsets in recordings of noise alone, 3.2 s of six axes: white, autocorrelated (AR(1)
of three strengths, and mixed with white), low-pass filtered, a random walk, axes tied together by a lever arm, one slow
axis among white ones, coarse counts, drift, glitches, and held readings; at 100 and 500 Hz, each noise the same in
samples at both. The second puts synthetic pushes of the paper's materials behind leads of 0.1 to 2 s and compares with
the true start.

``python benches/onset.py [recordings per noise] [seed]`` prints rates with 95 % intervals (Wilson) and delays in ms;
``python benches/onset.py FOLDER`` the false onsets in real rests, such as those of docs/guide/sand.md.

With 2,000 recordings and seed 0: of 88,000 recordings without motion 0.0009 [0.0007, 0.0011] get an onset at a
nominal rate of 0.05, and 2 at 0.001; the worst noise at 0.05 is filtered and the same on all axes at 100 Hz, 0.009.
Onsets at 500 Hz and rest_s = 0.1 are 1 to 7 ms late (5 to 95 %), 14 ms at worst, whatever the lead; 1000 recordings
take 0.74 CPU seconds.
"""

from __future__ import annotations

import sys
import time

import numpy as np
from scipy.signal import butter, lfilter, sosfilt
from scipy.stats import binomtest

from granular_id import load
from granular_id.recording import AXES
from granular_id.recording.onset import find_onsets_in_block, rest_samples
from granular_id.synthetic import PAPER_MATERIALS, Sensor, simulate_push

DURATION_S, AT_ONCE = 3.2, 250
RATES_HZ = (100, 500)
# How far each force acts on the torques: nothing is independent behind a lever arm.
LEVER = np.eye(6) + np.diag([-0.9, 0.9], 4)[:6, :6] + np.diag([0.5], 5)
FALSE_ALARM_RATES = (0.05, 0.001)
REST_S = (0.1, 0.2)
LEADS_S = (0.10, 0.15, 0.25, 0.5, 1.0, 2.0)


def ar(rng, shape, coefficient):
    """AR(1) noise of variance 1, shape (n, T, C), already in its steady state."""
    n, n_samples, n_axes = shape
    white = rng.standard_normal((n, n_samples + 300, n_axes))
    return lfilter([np.sqrt(1 - coefficient**2)], [1, -coefficient], white, axis=1)[:, 300:]


def counts(rng, noise, sd):
    """Read by a converter whose count is 1, from levels anywhere between two counts."""
    return np.rint(sd * noise + rng.uniform(-1, 1, (len(noise), 1, noise.shape[2])))


def filtered(rng, shape):
    """Return white noise after a second-order Butterworth low-pass at a tenth of the rate, as sensors have one."""
    n, n_samples, n_axes = shape
    white = rng.standard_normal((n, n_samples + 200, n_axes))
    return sosfilt(butter(2, 0.2, output="sos"), white, axis=1)[:, 200:]


def drifting(rng, shape, per_recording):
    """White noise on lines that rise or fall by this many standard deviations in a recording."""
    slopes = rng.choice([-1, 1], (shape[0], 1, shape[2])) * np.linspace(0, 1, shape[1])[:, np.newaxis]
    return rng.standard_normal(shape) + per_recording * slopes


def held(rng, shape, n_samples=8):
    """White readings of a sensor that is slower than its messages, which repeat the last one."""
    first = rng.integers(n_samples, size=(shape[0], 1, 1))
    reading = (first + np.arange(shape[1])[:, np.newaxis]) // n_samples
    readings = rng.standard_normal((shape[0], reading.max() + 1, shape[2]))
    return np.take_along_axis(readings, reading, axis=1)


def glitched(rng, shape):
    """White noise in which one sample of some axis is wrong by 200 standard deviations."""
    noise = rng.standard_normal(shape)
    n, n_samples, n_axes = shape
    noise[np.arange(n), rng.integers(n_samples, size=n), rng.integers(n_axes, size=n)] += 200
    return noise


NOISES = {
    "white": lambda rng, shape: rng.standard_normal(shape),
    "white, one axis only": lambda rng, shape: rng.standard_normal((*shape[:2], 1)),
    "white, lever arm": lambda rng, shape: rng.standard_normal(shape) @ LEVER,
    "AR(1) 0.5": lambda rng, shape: ar(rng, shape, 0.5),
    "AR(1) 0.9": lambda rng, shape: ar(rng, shape, 0.9),
    "AR(1) 0.9, lever arm": lambda rng, shape: ar(rng, shape, 0.9) @ LEVER,
    "AR(1) 0.9, one axis only": lambda rng, shape: ar(rng, (*shape[:2], 1), 0.9),
    "AR(1) 0.98": lambda rng, shape: ar(rng, shape, 0.98),
    "AR(1) 0.95 and white": lambda rng, shape: ar(rng, shape, 0.95) + rng.standard_normal(shape),
    "low-pass filtered": filtered,
    "random walk": lambda rng, shape: rng.standard_normal(shape).cumsum(axis=1),
    "white, one axis AR(1) 0.95": lambda rng, shape: np.concatenate(
        [rng.standard_normal((*shape[:2], 5)), ar(rng, (*shape[:2], 1), 0.95)], axis=2
    ),
    "AR(1) 0.9, the same on all": lambda rng, shape: ar(rng, (*shape[:2], 1), 0.9) @ np.ones((1, 6)),
    "filtered, the same on all": lambda rng, shape: filtered(rng, (*shape[:2], 1)) @ np.ones((1, 6)),
    "counts of 3 s.d.": lambda rng, shape: counts(rng, rng.standard_normal(shape), 1 / 3),
    "counts of 10 s.d.": lambda rng, shape: counts(rng, rng.standard_normal(shape), 0.1),
    "counts of 3 s.d., AR(1) 0.9": lambda rng, shape: counts(rng, ar(rng, shape, 0.9), 1 / 3),
    "drift of 3 s.d.": lambda rng, shape: drifting(rng, shape, 3),
    "drift of 30 s.d.": lambda rng, shape: drifting(rng, shape, 30),
    "one glitch of 200 s.d.": glitched,
    "white, held for 8 samples": held,
    "held, the same on all": lambda rng, shape: held(rng, (*shape[:2], 1)) @ np.ones((1, 6)),
}


def false_onsets(noise, rate_hz, recordings, false_alarm_rates, rest_s, seed):
    """Count recordings of pure noise in which an onset is found, one count per nominal rate."""
    rng = np.random.default_rng(seed)
    found = np.zeros(len(false_alarm_rates), dtype=int)
    for begin in range(0, recordings, AT_ONCE):
        shape = (min(AT_ONCE, recordings - begin), round(DURATION_S * rate_hz), 6)
        block = NOISES[noise](rng, shape)
        axes = AXES[: block.shape[2]]
        for i, rate in enumerate(false_alarm_rates):
            onsets = find_onsets_in_block(block, rate_hz, rest_samples(rest_s, rate_hz), rate, axes)
            found[i] += sum(onset.index is not None for onset in onsets)
    return found


def of_rests(folder, duration_s, rest_s, rate):
    """Count false onsets in real rests, cut into recordings one behind the other; return them and the recordings."""
    rests = [r for r in load(folder) if r.label == "rest"]
    rate_hz = round((rests[0].n_samples - 1) / rests[0].duration_s)
    length = round(duration_s * rate_hz)
    cut = [r.wrench[i : i + length] for r in rests for i in range(0, r.n_samples - length + 1, length)]
    onsets = find_onsets_in_block(cut, rate_hz, rest_samples(rest_s, rate_hz), rate, AXES)
    return sum(onset.index is not None for onset in onsets), len(cut)


def delays_ms(rate_hz, lead_s, per_material, rest_s=0.1, seed=0):
    """Return delays of onset and alarm against the true start, ms, shape (found, 2), and how many were tried."""
    rows, tried = [], 0
    for number, material in enumerate(PAPER_MATERIALS):
        pushes = [
            simulate_push(
                material,
                rate_hz=rate_hz,
                duration_s=lead_s + 1.5,
                lead_s=lead_s + part / rate_hz,
                sensor=Sensor(),
                seed=1000 * seed + 100 * number + k,
            )
            for k, part in enumerate(np.linspace(0, 1, per_material, endpoint=False))
        ]
        onsets = find_onsets_in_block(pushes, rate_hz, rest_samples(rest_s, rate_hz), 1e-3, AXES)
        for k, onset in enumerate(onsets):
            start_s = lead_s + k / per_material / rate_hz
            tried += 1
            if onset.index is not None:
                rows.append((1000 * (onset.time_s - start_s), 1000 * (onset.detected_s - start_s)))
    return np.array(rows), tried


def rates(found, recordings):
    """Return one rate and its interval per count."""
    intervals = [binomtest(int(k), recordings).proportion_ci(method="wilson") for k in found]
    return "   ".join(
        f"{k / recordings:.5f} [{i.low:.5f}, {i.high:.5f}]" for k, i in zip(found, intervals, strict=True)
    )


def rests(folder):
    """Print the false onsets of real rests, bags named rest_NN.bag."""
    print(f"False onsets in the rests of {folder}; nominal rates {FALSE_ALARM_RATES}")
    for duration_s in (2.0, DURATION_S):
        for rest_s in (0.1, 0.25, 0.5, 1.0):
            counted = [of_rests(folder, duration_s, rest_s, rate) for rate in FALSE_ALARM_RATES]
            found, n = [k for k, _ in counted], counted[0][1]
            print(f"  {n} of {duration_s} s, rest_s {rest_s}: {found}  {rates(found, n)}")


def main():
    """Print both tables, or the third."""
    if len(sys.argv) > 1 and not sys.argv[1].isdigit():
        rests(sys.argv[1])
        return
    recordings = int(sys.argv[1]) if len(sys.argv) > 1 else 2000
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    print(f"False onsets, {recordings} recordings each, rest_s = 0.1; nominal rates {FALSE_ALARM_RATES}")
    total = np.zeros(len(FALSE_ALARM_RATES), dtype=int)
    for rate_hz in RATES_HZ:
        for noise in NOISES:
            found = false_onsets(noise, rate_hz, recordings, FALSE_ALARM_RATES, 0.1, seed)
            total += found
            print(f"  {rate_hz} Hz  {noise:28s}  {rates(found, recordings)}", flush=True)
    print(f"  all together                          {rates(total, recordings * len(RATES_HZ) * len(NOISES))}")
    print("Onset (and alarm) minus true start, ms: share found, 5 %, median, 95 %, worst")
    for rate_hz in RATES_HZ:
        for rest_s in REST_S:
            for lead_s in (lead for lead in LEADS_S if lead >= rest_s):
                delays, tried = delays_ms(rate_hz, lead_s, 10, rest_s, seed)
                points = np.percentile(delays, [5, 50, 95], axis=0).round(1)
                worst = delays[np.abs(delays[:, 0]).argmax(), 0]
                print(
                    f"  {rate_hz} Hz, rest_s {rest_s}, lead {lead_s:4.2f} s: {len(delays)} of {tried}, "
                    f"onset {points[:, 0].tolist()}, worst {worst:.1f}; alarm {points[:, 1].tolist()}"
                )
    block = np.random.default_rng(seed).normal(size=(1000, 1600, 6))
    block[:, 100:] += 100 * (1 - np.exp(-np.arange(1500) / 20))[:, np.newaxis]
    began = time.process_time()
    find_onsets_in_block(block, 500.0, rest_samples(0.1, 500.0), 1e-3, AXES)
    print(f"1000 recordings of 1600 x 6: {time.process_time() - began:.2f} CPU seconds")


if __name__ == "__main__":
    main()
