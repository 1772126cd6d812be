"""The sensor at rest: coloured noise as of a real one, and rests of a tool in several orientations."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from granular_id._checks import FloatArray, argument_error, positive_number, sampling_rate, whole_number
from granular_id.recording import Dataset, Payload, Recording
from granular_id.synthetic.generate import FRAME, SIGN
from granular_id.synthetic.push import random_stream

# Ten rests of a Bota Rokubi on the carriage of a rover's test bed (robomechanics/3d-terramechanics): standard deviation
# of a reading, N and N m, root mean square of the ten.
NOISE_SD = np.array([0.080, 0.168, 0.052, 3.4e-3, 1.8e-3, 0.50e-3])
# Bending torques follow their forces: their sign, and the correlation with it.
COUPLED = {3: (1, 0.94), 4: (0, -0.94)}
# New values a second: messages in between repeat the last one, all axes together.
READING_HZ = 12.28
# Below this the spectrum rises as 1 / f^2: the zero wanders; not beyond periods of this length.
WANDER_HZ = 0.15
LONGEST_S = 20.0


def rest_noise(n_samples: int, rate_hz: float, *, seed: int | np.random.SeedSequence = 0) -> FloatArray:
    """Draw what a sensor at rest reads around its zero, (n_samples, 6): readings that are held, a zero that wanders.

    Samples are no independent values: the mean of 1 s is three times as uncertain as ``sd / sqrt(n)`` says at 100 Hz.
    """
    n = whole_number("n_samples", n_samples)
    rate = sampling_rate("rate_hz", rate_hz)
    rng = np.random.default_rng(random_stream(seed, 4))
    reading = np.floor(rng.random() + np.arange(n) * (READING_HZ / rate)).astype(np.intp)
    n_readings = int(reading[-1]) + 1
    # Twice, as what is drawn by frequencies repeats itself.
    n_drawn = max(2 * n_readings, round(2 * LONGEST_S * READING_HZ))
    frequency = np.fft.rfftfreq(n_drawn, 1.0 / READING_HZ)
    gain: FloatArray = np.sqrt(1.0 + (WANDER_HZ / np.maximum(frequency, 1.0 / LONGEST_S)) ** 2)
    gain[0] = 0.0
    gain *= np.sqrt(n_drawn / (gain**2).sum() / 2.0)
    white = np.fft.rfft(rng.standard_normal((n_drawn, 6)), axis=0)
    readings: FloatArray = np.fft.irfft(white * gain[:, np.newaxis], n_drawn, axis=0)[:n_readings]
    for torque, (force, share) in COUPLED.items():
        readings[:, torque] = share * readings[:, force] + np.sqrt(1.0 - share**2) * readings[:, torque]
    noise: FloatArray = (readings * NOISE_SD)[reading]
    return noise


def simulate_rests(
    payload: Payload,
    gravity: ArrayLike,
    *,
    duration_s: float = 2.0,
    rate_hz: float = 500.0,
    seed: int = 0,
) -> Dataset:
    """Simulate rests of a tool in several orientations, to identify its payload from.

    Parameters
    ----------
    payload : Payload
        Weight and zero that the sensor reads.
    gravity : array_like, shape (n, 3)
        Direction of gravity in the frame of the sensor at each rest, of any length.
    duration_s : float, default 2
        Of each rest.
    rate_hz : float, default 500
    seed : int, default 0

    Returns
    -------
    Dataset
        One recording a rest, labelled "rest"; its metadata hold its ``gravity``, and frame and sign of the payload
        or those of `synthesize`.

    Examples
    --------
    >>> from granular_id.recording import Payload
    >>> from granular_id.synthetic import simulate_rests
    >>> down = [[0, 0, -1], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    >>> rests = simulate_rests(Payload(0.3, (0, 0, 0.05)), down)
    >>> round(Payload.identify(rests, gravity=down).mass_kg, 1)
    0.3
    """
    directions = np.asarray(gravity, dtype=np.float64)
    if directions.ndim != 2 or directions.shape[1] != 3:
        raise argument_error(ValueError, "gravity", f"has shape {directions.shape}; wanted (n, 3)")
    rate = sampling_rate("rate_hz", rate_hz)
    n = round(positive_number("duration_s", duration_s) * rate)
    stated = {"synthetic": True, "frame": payload.frame or FRAME, "sign": payload.sign or SIGN}
    return Dataset(
        [
            Recording(
                load + rest_noise(n, rate, seed=random_stream(seed, i)),
                rate_hz=rate,
                label="rest",
                name=f"rest_{i:02d}",
                meta={**stated, "gravity": direction.tolist()},
            )
            for i, (load, direction) in enumerate(zip(payload.wrench(directions), directions, strict=True))
        ]
    )
