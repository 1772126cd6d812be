"""What the synthetic generator and its parts refuse, and in which words."""

from __future__ import annotations

from dataclasses import replace

import pytest

from granular_id.synthetic import PAPER_MATERIALS, Material, Nuisance, Rig, Sensor, simulate_push, synthesize

RICE = PAPER_MATERIALS[1]
LENTILS = Material("lentils", 0.0045, 1.8, bulk_density_kg_m3=800, friction_angle_deg=28)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (
            {"materials": ["sand"]},
            ValueError,
            "materials has no material 'sand'; known: dry peas, .*cat litter",
        ),
        ({"materials": []}, ValueError, "at least one material"),
        ({"materials": [3]}, TypeError, "names or Material objects, got 3"),
        ({"materials": ["rice", RICE]}, ValueError, "'rice' twice"),
        ({"n_per_class": 0}, ValueError, "n_per_class must be at least 1, got 0"),
        ({"n_per_class": 2.5}, TypeError, "n_per_class must be a whole number, got 2.5"),
        ({"n_per_class": 3, "sessions": 4}, ValueError, "sessions must not exceed n_per_class = 3, got 4"),
        ({"rate_hz": float("nan")}, ValueError, "rate_hz must be finite"),
        ({"rate_hz": 1e9}, ValueError, "rate_hz must be at most 50000"),
        ({"rate_hz": "500"}, TypeError, "rate_hz must be a number, got '500'"),
        ({"duration_s": 0.2}, ValueError, r"duration_s must exceed the 0.25 s of rest .* got 0.2"),
        ({"duration_s": 10}, ValueError, r"duration_s = 10 moves the tool up to 0.29\d m, and the wall"),
        ({"seed": -1}, ValueError, "seed must be at least 0, got -1"),
        ({"rig": Rig(depth_m=0.005)}, ValueError, "depth_m = 0.005 of rig"),
    ],
)
def test_synthesize_refuses(arguments, error, message):
    with pytest.raises(error, match=message):
        synthesize(**{"materials": "rice", "n_per_class": 4, **arguments})


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: replace(LENTILS, name=" "), "name must be a non-empty string"),
        (
            lambda: replace(LENTILS, grain_diameter_m=4.5),
            "of material 'lentils' must be at most 0.1, got 4.5",
        ),
        (lambda: replace(LENTILS, aspect_ratio=0.5), "aspect_ratio of material 'lentils' must be at least 1"),
        (lambda: replace(LENTILS, bulk_density_kg_m3=-1), "bulk_density_kg_m3 of .* must not be negative"),
        (lambda: replace(LENTILS, bulk_density_kg_m3=0), "needs bulk_density_kg_m3 or cohesion_pa"),
        (lambda: replace(LENTILS, friction_angle_deg=75), "must be at most 60, got 75"),
        (lambda: replace(LENTILS, cohesion_pa=float("inf")), "cohesion_pa of .* must be finite"),
        (lambda: replace(LENTILS, sharpness=0), "sharpness of material 'lentils' must be positive"),
        (lambda: Rig(speed_m_s=0), "speed_m_s must be positive"),
        (lambda: Rig(depth_m=0.09), "depth_m must not exceed tool_length_m = 0.08"),
        (lambda: Rig(sensor_to_tool_m=-1), "sensor_to_tool_m must not be negative"),
        (lambda: Sensor(noise_rms=(0.1,) * 5), "noise_rms must hold 6 finite numbers"),
        (lambda: Sensor(full_scale=(0.0,) * 6), "full_scale must hold 6 finite numbers, positive"),
        (lambda: Sensor(bits=0), "bits must be a whole number from 2 to 32"),
        (lambda: Nuisance(depth_m=(0.1, 0.1)), "depth_m must be .per recording, per fill, per session"),
        (lambda: Nuisance(tare_n=(0.1, -0.1, 0.0)), "tare_n must not be negative"),
        (lambda: Nuisance().scaled(-1), "factor must not be negative"),
        (lambda: simulate_push(LENTILS, parts=("slip", "magic")), "no part 'magic'; known: texture, slip"),
        (lambda: simulate_push(LENTILS, duration_s=0.001), "holds 0 samples at rate_hz = 500"),
        (
            lambda: simulate_push(LENTILS, duration_s=5),
            "a push of 5 s .* into the wall at wall_distance_m = 0.1",
        ),
        (lambda: simulate_push(LENTILS, lead_s=-1), "lead_s must not be negative"),
    ],
)
def test_parts_of_the_model_refuse(call, message):
    with pytest.raises(ValueError, match=message):
        call()
