"""Long recordings of another sensor: gyroscope and accelerometer on the holder of the tool, many strokes a file."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice

import numpy as np
from scipy.signal import lfilter

from granular_id._checks import FloatArray
from granular_id.synthetic.drag import GRAVITY_M_S2, Rig
from granular_id.synthetic.materials import Material
from granular_id.synthetic.push import (
    MIN_MODEL_RATE_HZ,
    MODE_SHARE,
    MODES,
    PARTS,
    Conditions,
    mode_filter,
    random_stream,
    simulate_push,
)

IMU_AXES = ("wx", "wy", "wz", "ax", "ay", "az")
IMU_UNITS = dict(zip(IMU_AXES, ("rad/s",) * 3 + ("m/s2",) * 3, strict=True))
# One stroke from wall to wall, the rest before it included, and how long it takes to relieve the tool at its end.
STROKE_S = 3.2
RELIEF_S = 0.1
# Holder, sensor and tool: a kilogram and a half, of the size of a hand.
MASS_KG = 1.5
INERTIA_KG_M2 = 0.006
# A cheap sensor (InvenSense MPU-6050: 0.005 deg/s and 400 ug per root Hz) at some 50 Hz, and a bias that each session
# has anew.
NOISE = np.array([0.001] * 3 + [0.03] * 3)
BIAS = np.array([0.01] * 3 + [0.15] * 3)

Stroke = tuple[Conditions, float, np.random.SeedSequence]
"""What a stroke meets: its conditions, its rest in s, its seed."""


def simulate_drive(
    material: Material,
    strokes: Iterator[Stroke],
    rig: Rig,
    rate_hz: float,
    n_samples: int,
    bias: np.random.SeedSequence,
) -> FloatArray:
    """Simulate what an IMU on the tool holder reads while the tool strokes to and fro, shape (n_samples, 6).

    Each stroke is a push of `simulate_push`, every other one backwards. The arm holds against steady loads; what it
    lets through is the vibration of its modes, over mass and inertia. `bias` seeds the sensor's zero point.
    """
    per_sample = math.ceil(MIN_MODEL_RATE_HZ / rate_hz)
    step_s = 1.0 / (rate_hz * per_sample)
    n_steps = n_samples * per_sample
    n_strokes = math.ceil(n_steps / round(STROKE_S / step_s))
    met, loads = list(islice(strokes, n_strokes)), list[FloatArray]()
    for number, (conditions, lead_s, seed) in enumerate(met):
        load = simulate_push(
            material,
            rig=rig,
            rate_hz=1.0 / step_s,
            duration_s=STROKE_S,
            lead_s=lead_s,
            parts=[part for part in PARTS if part != "resonance"],
            conditions=replace(conditions, tare=(0.0,) * 6, drift_per_s=(0.0,) * 6),
            seed=seed,
        )
        relief = np.linspace(1.0, 0.0, round(RELIEF_S / step_s))
        load[-len(relief) :] *= relief[:, np.newaxis]
        if number % 2:
            load[:, [0, 1, 3, 4]] *= -1.0  # the tool has turned about its axis
        loads.append(load)
    load = np.concatenate(loads)[:n_steps]
    rates = _vibration(load[:, 3:], MODE_SHARE[3:], 1, step_s) / INERTIA_KG_M2
    accelerations = _vibration(load[:, :3], MODE_SHARE[:3], 2, step_s) / MASS_KG
    # z points down: at rest an accelerometer reads what holds it up.
    accelerations += met[0][0].rotation() @ np.array([0.0, 0.0, -GRAVITY_M_S2])
    # The sensor's own filter: the mean since its last reading.
    read: FloatArray = np.hstack([rates, accelerations]).reshape(n_samples, per_sample, 6).mean(axis=1)
    read += BIAS * np.random.default_rng(bias).standard_normal(6)
    read += NOISE * np.random.default_rng(random_stream(met[0][2], 3)).standard_normal(read.shape)
    return read


def _vibration(load: FloatArray, shares: FloatArray, order: int, step_s: float) -> FloatArray:
    """Pass loads (n, c) through ``s^order / (s^2 + 2 zeta w s + w^2)`` of every mode, by its share in each column."""
    moved = np.zeros_like(load)
    for mode, share in zip(MODES, shares.T, strict=True):
        _, warp, poles = mode_filter(*mode, step_s)
        zeros = {1: np.array([1.0, 0.0, -1.0]) * warp, 2: np.array([1.0, -2.0, 1.0]) * warp**2}[order]
        moved += share * lfilter(zeros, poles, load, axis=0)
    return moved
