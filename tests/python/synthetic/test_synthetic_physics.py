"""The synthetic pushes obey the physics that they claim; nothing here looks at a classifier."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import signal

from granular_id.io import load
from granular_id.synthetic import PAPER_MATERIALS, Material, Rig, rest_noise, simulate_push
from granular_id.synthetic.drag import (
    contact_breaks,
    contact_count,
    drag_profile,
    heterogeneity,
    mean_drag_n,
    relative_fluctuation,
    shear_band_wave,
    slip_length_m,
    stick_slip,
)
from granular_id.synthetic.sensors import vibration

BY_NAME = {material.name: material for material in PAPER_MATERIALS}
PEAS = BY_NAME["dry peas"]
COHESIVE = Material("paste", 1e-4, 1.0, bulk_density_kg_m3=0, friction_angle_deg=20, cohesion_pa=200)
SHALLOW = Rig(depth_m=0.038)


def test_mean_drag_is_that_computed_by_hand():
    # Kp = tan^2(61.5 deg) = 3.392; 1.5 * 3.392 * 820 * 9.81 * 0.0199 * 0.076^2
    assert mean_drag_n(BY_NAME["rice"], Rig()) == pytest.approx(4.705, abs=0.005)
    # Kp = tan^2(55 deg) = 2.0396; 6 * 200 * 1.42815 * 0.0171 * 0.076
    assert mean_drag_n(COHESIVE, Rig()) == pytest.approx(2.2272, abs=0.001)


@pytest.mark.parametrize(("material", "ratio"), [(PEAS, 4.0), (COHESIVE, 2.0)])
def test_drag_grows_with_the_stated_power_of_the_depth(material, ratio):
    deep, shallow = (simulate_push(material, rig=rig, parts=())[-1, 0] for rig in (Rig(), SHALLOW))
    assert deep / shallow == pytest.approx(ratio, rel=1e-9)


def _past_the_start(wrench, rig, rate_hz, lead_s):
    travel = rig.travel_m(np.arange(len(wrench)) / rate_hz - lead_s)
    return wrench[(travel > 0.02) & (travel < 0.075)]


def test_speed_changes_the_rate_of_slips_not_the_mean():
    means, per_second = [], []
    # slow enough that slips of different layers seldom overlap and can be counted in the sum
    for speed in (0.006, 0.012):
        rig = Rig(speed_m_s=speed)
        push = {"rig": rig, "rate_hz": 1000.0, "duration_s": 0.1 + 0.08 / speed, "lead_s": 0.1}
        mean, count, seconds = [], 0, 0.0
        for seed in range(8):
            slips = simulate_push(PEAS, parts=("slip",), seed=seed, **push)
            fx = _past_the_start(slips, rig, 1000.0, 0.1)[:, 0]
            falling = np.diff(fx) < 0
            mean.append(fx.mean())
            count += np.count_nonzero(falling[1:] & ~falling[:-1])
            seconds += fx.size / 1000.0
        means.append(np.mean(mean))
        per_second.append(count / seconds)
    assert means[1] == pytest.approx(means[0], rel=0.02)
    assert per_second[1] / per_second[0] == pytest.approx(2.0, rel=0.12)
    # four layers, each slipping once per slip length
    assert per_second[0] == pytest.approx(4 * 0.006 / slip_length_m(PEAS), rel=0.15)


@pytest.mark.parametrize("name", ["dry peas", "rice", "wheat flour"])
def test_contact_breaks_have_the_power_of_shot_noise(name):
    material, rig = BY_NAME[name], Rig()
    # Coarse enough that flour's contacts recover within a step.
    step_s = 5e-4
    travel = rig.speed_m_s * np.arange(6000) * step_s
    noise = np.stack(
        [contact_breaks(material, rig, travel, step_s, np.random.default_rng(s)) for s in range(6)]
    )
    # Campbell's theorem for one of four layers: jumps of exponential size (mean square 2), each decaying over
    # a tenth of a grain, and seen as its mean over a step.
    contacts = contact_count(material, rig) / 4
    recovery_s = 0.1 * material.grain_diameter_m / rig.speed_m_s
    decay = math.exp(-step_s / recovery_s)
    seen = recovery_s / step_s * (1 - decay)
    jumps_per_step = contacts * rig.speed_m_s / material.grain_diameter_m * step_s
    expected = material.sharpness / contacts * seen * math.sqrt(2 * jumps_per_step / (1 - decay**2))
    assert noise[:, 0, :, 1000:].std() == pytest.approx(expected, rel=0.12)
    assert abs(noise[:, 0].mean()) < 0.2 * expected
    assert noise[:, 1, :, 1000:].std() == pytest.approx(0.6 * expected, rel=0.15)


@pytest.mark.parametrize("name", ["dry peas", "clay granules", "breadcrumbs"])
def test_stick_slip_has_the_size_it_states(name):
    material, rig = BY_NAME[name], Rig()
    travel = rig.speed_m_s * np.arange(3000) * 1e-3
    shares = np.array([1, 3, 5, 7]) / 16  # friction only: pressure grows with depth
    spread = [
        (shares @ stick_slip(material, rig, travel, np.random.default_rng(s))[0]).std() for s in range(30)
    ]
    cohesive_tolerance = 0.12 if material.cohesion_pa == 0 else 0.2
    assert np.mean(spread) == pytest.approx(relative_fluctuation(material, rig), rel=cohesive_tolerance)


def test_slips_lean_both_ways_without_a_mean():
    rig = Rig()
    travel = rig.speed_m_s * np.arange(3000) * 1e-3
    drawn = np.stack([stick_slip(PEAS, rig, travel, np.random.default_rng(s)) for s in range(60)])
    along, sideways, vertical = (drawn[:, axis] for axis in range(3))
    for mine, share in ((sideways, 0.45), (vertical, 0.40)):
        assert np.sqrt(np.mean(mine**2)) == pytest.approx(share * along.std(), rel=0.1)
        assert abs(mine.mean()) < 0.1 * mine.std()
    assert abs(np.corrcoef(sideways.ravel(), vertical.ravel())[0, 1]) < 0.1


def test_torque_is_force_times_lever_arm():
    rig = Rig()
    for material, depth in ((PEAS, 2 / 3), (COHESIVE, 1 / 2)):
        push = simulate_push(material, parts=())[200:]
        lever = rig.sensor_to_tool_m + rig.tool_length_m - rig.depth_m + depth * rig.depth_m
        np.testing.assert_allclose(push[:, 4], lever * push[:, 0], rtol=1e-12)


def test_profile_has_its_landmarks():
    rig = Rig()
    x = np.linspace(0, 0.0999, 5000)
    for material in PAPER_MATERIALS:
        drag, measured = drag_profile(material, x, rig)
        assert drag[0] == 0
        assert measured[0] == 0
        assert (drag >= 0).all()
        assert (measured <= drag).all()
    rice, _ = drag_profile(BY_NAME["rice"], x, rig)
    assert x[:2500][rice[:2500].argmax()] / 0.017 == pytest.approx(0.5, abs=0.1)
    near, far = (
        drag_profile(BY_NAME["macaroni"], np.array([0.09]), Rig(wall_distance_m=w))[0] for w in (0.1, 10.0)
    )
    assert near - far == pytest.approx(1.4 * math.exp(-(0.01 / 0.017) / 1.3), rel=1e-3)


def test_slow_fields_have_unit_variance_and_stated_length():
    x = np.linspace(0, 20, 801)
    fields = heterogeneity(x, 1.0, np.random.default_rng(0), 400)
    assert fields.shape == (400, 801)
    assert fields.var() == pytest.approx(1.0, rel=0.08)
    one_away = np.mean(fields[:, :-40] * fields[:, 40:])  # one correlation length
    assert one_away == pytest.approx(math.exp(-0.5), abs=0.08)


def test_shear_band_wave_loads_slowly_and_collapses_quickly():
    x = np.linspace(0, 30, 30_001)
    wave = shear_band_wave(x, np.random.default_rng(3))
    assert np.abs(wave).max() == pytest.approx(1.0, abs=1e-3)
    slope = np.diff(wave)
    assert -slope.min() > 1.5 * slope.max()
    crossings = np.count_nonzero((wave[:-1] < 0) & (wave[1:] >= 0))
    assert 30 / crossings == pytest.approx(0.85, rel=0.12)


def test_vibration_is_the_stated_sum_of_modes():
    step_s = 1e-4
    rng = np.random.default_rng(0)
    t = np.arange(5000) * step_s
    load = np.cumsum(rng.standard_normal((6, t.size)), axis=1)
    load = signal.sosfilt(signal.butter(4, 60, fs=1 / step_s, output="sos"), load)
    ours = vibration(load, step_s)
    moved = vibration(load[:3], step_s, order=2, axes=slice(3))[0]  # accelerations of a unit mass
    shares = [0.45, 0.10, 0.25, 0.10]  # fx
    twin, moved_twin = (1 - sum(shares)) * load[0], 0.0
    for share, (hz, zeta) in zip(shares, ((34, 0.20), (40, 0.18), (70, 0.16), (90, 0.15)), strict=True):
        w = 2 * np.pi * hz
        poles = [1, 2 * zeta * w, w * w]
        twin = twin + share * signal.lsim(([w * w], poles), load[0], t)[1]
        moved_twin = moved_twin + share * signal.lsim(([1, 0, 0], poles), load[0], t)[1]
    np.testing.assert_allclose(ours[0], twin, atol=2e-3 * np.abs(twin).max())
    np.testing.assert_allclose(moved, moved_twin, atol=2e-3 * np.abs(moved_twin).max())


@pytest.mark.parametrize("rate_hz", [100.0, 500.0, 1000.0, 2500.0])
def test_rate_changes_the_sampling_not_the_push(rate_hz):
    smooth = simulate_push(PEAS, rate_hz=rate_hz, parts=())
    assert smooth.shape == (round(3.2 * rate_hz), 6)
    at_half_second = simulate_push(PEAS, rate_hz=500.0, parts=())[::250]
    step = rate_hz / 2
    np.testing.assert_allclose(smooth[:: int(step)], at_half_second, rtol=1e-9, atol=1e-12)
    spread = simulate_push(PEAS, rate_hz=rate_hz, seed=1)[int(0.8 * rate_hz) :, 0].std()
    assert 0.4 < spread < 1.6


def test_leaving_out_a_part_does_not_change_the_others():
    def extra(part, others):
        return simulate_push(PEAS, parts=(*others, part)) - simulate_push(PEAS, parts=others)

    for part in ("texture", "slip", "contacts"):
        others = tuple(p for p in ("texture", "slip", "contacts") if p != part)
        np.testing.assert_allclose(extra(part, others), extra(part, ()), atol=1e-9)


def test_simulated_rests_are_like_real_ones(data_dir):
    real = [load(path)[0].wrench for path in sorted((data_dir / "sand_press").glob("rest_*.bag"))]
    drawn = [rest_noise(1200, 100, seed=seed) for seed in range(10)]
    sd = [np.sqrt(np.mean([rest.var(axis=0) for rest in rests], axis=0)) for rests in (real, drawn)]
    np.testing.assert_allclose(sd[1], sd[0], rtol=0.15)
    new = [np.mean([(np.diff(r, axis=0) != 0).any(axis=1).mean() for r in rests]) for rests in (real, drawn)]
    assert abs(new[0] - new[1]) < 0.002
    for lag, within in ((1, 0.03), (2, 0.05), (8, 0.1), (50, 0.1)):
        alike = [
            np.mean([np.corrcoef(rest[lag:, c], rest[:-lag, c])[0, 1] for rest in rests for c in range(6)])
            for rests in (real, drawn)
        ]
        assert abs(alike[0] - alike[1]) < within


@pytest.mark.parametrize("rate_hz", [5.0, 100.0, 500.0])
def test_simulated_readings_are_held_at_any_rate(rate_hz):
    noise = rest_noise(2000, rate_hz)
    changes = (np.diff(noise, axis=0) != 0).all(axis=1)
    assert abs(changes.mean() - min(12.28 / rate_hz, 1)) < 0.005
    assert ((np.diff(noise, axis=0) != 0).any(axis=1) == changes).all()
