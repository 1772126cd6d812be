"""Synthetic data sets: shape, seeds, sessions, what varies, how the forces look, how hard they are, what is refused."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC

from granular_id.recording import SampleFlag
from granular_id.synthetic import (
    PAPER_MATERIALS,
    Conditions,
    Material,
    Nuisance,
    Rig,
    Sensor,
    simulate_push,
    synthesize,
)

BY_NAME = {material.name: material for material in PAPER_MATERIALS}
LENTILS = Material("lentils", 0.0045, 1.8, bulk_density_kg_m3=800, friction_angle_deg=28)


@pytest.fixture(scope="module")
def paper_like():
    return synthesize(n_per_class=12, seed=1)


def test_the_paper_set_has_eleven_synthetic_materials(paper_like):
    assert len(PAPER_MATERIALS) == 11
    assert paper_like.X.shape == (132, 1600, 6)
    assert paper_like.rate_hz == 500
    assert list(dict.fromkeys(paper_like.y.tolist())) == [m.name for m in PAPER_MATERIALS]
    assert all(recording.meta["synthetic"] is True for recording in paper_like)
    assert len(set(paper_like.names)) == len({recording.wrench.tobytes() for recording in paper_like}) == 132
    conditions, material = paper_like[0].meta["conditions"], paper_like[0].meta["material"]
    packed = PAPER_MATERIALS[0].bulk_density_kg_m3 * (1 + conditions["packing_percent"] / 100)
    assert material["bulk_density_kg_m3"] == pytest.approx(packed)
    assert paper_like[0].meta["gain"] == pytest.approx(math.exp(conditions["gain_log"]))


def test_the_trigger_is_the_onset_of_the_motion(paper_like):
    triggers = np.array([recording.trigger_index for recording in paper_like])
    leads = np.array([recording.meta["lead_s"] for recording in paper_like])
    assert ((leads >= 0.10) & (leads <= 0.25)).all()
    assert np.array_equal(triggers, np.ceil(leads * 500))
    assert triggers.std() > 10
    for recording in paper_like:
        assert recording.trigger_index is not None
        before = recording.wrench[: recording.trigger_index + 1, 0]
        after = recording.wrench[recording.trigger_index + 50 : recording.trigger_index + 100, 0]
        assert after.mean() - before.mean() > 0.3


def test_sessions_are_days_with_every_material(paper_like):
    sessions, times = paper_like.sessions, paper_like.start_times
    assert sorted(set(sessions)) == ["session 1", "session 2", "session 3", "session 4"]
    assert len(set(times.tolist())) == len(times)
    for session in set(sessions):
        inside = times[sessions == session]
        assert np.ptp(inside) < 86_400
        assert set(paper_like.y[sessions == session]) == set(paper_like.labels)
        assert np.diff(np.sort(inside)).min() > 3.2
    assert synthesize("rice", n_per_class=2).sessions.tolist() == ["session 1", "session 2"]


def test_the_seed_decides_the_bits():
    one, same, other = (synthesize(["rice", LENTILS], n_per_class=2, seed=seed) for seed in (3, 3, 4))
    assert one == same
    assert one.X.tobytes() == same.X.tobytes()
    assert len({wrench.tobytes() for wrench in (*one.X, *other.X)}) == 8


def test_a_recording_does_not_depend_on_what_else_is_made():
    few = synthesize(["fine_sugar", "rice"], n_per_class=3, sessions=2, seed=7)  # an underscore for a blank
    many = synthesize(["rice", "macaroni", "fine sugar"], n_per_class=5, sessions=2, seed=7)
    for label in ("rice", "fine sugar"):
        assert np.array_equal(few.X[few.y == label], many.X[many.y == label][:3])
        assert list(few.sessions[few.y == label]) == list(many.sessions[many.y == label][:3])


def test_without_nuisance_only_grains_and_noise_differ():
    data = synthesize("wheat flour", n_per_class=3, nuisance=Nuisance().scaled(0), seed=2)
    conditions = [dict(recording.meta["conditions"]) for recording in data]
    assert conditions[0] == conditions[1] == conditions[2]
    assert data[0].meta["material"] == data[1].meta["material"]
    assert data[0].meta["rig"]["depth_m"] == 0.076
    rest = data.X[:, :50]
    assert np.abs(rest.mean(axis=1)).max() < 0.05


def test_mounting_and_sensor_errors_act_as_stated():
    def push(**state):
        return simulate_push(BY_NAME["dry peas"], conditions=Conditions(**state))

    plain = push()
    np.testing.assert_allclose(push(gain_log=0.1), plain * math.exp(0.1), rtol=1e-12)
    tare = (0.1, -0.2, 0.3, 0.01, -0.02, 0.03)
    np.testing.assert_allclose(push(tare=tare) - plain, np.tile(tare, (1600, 1)), atol=1e-12)
    drifted = push(drift_per_s=(0.5,) * 6) - plain
    np.testing.assert_allclose(drifted, 0.5 * np.arange(1600)[:, None] / 500 * np.ones(6), atol=1e-12)
    tilted = push(roll_rad=0.02, pitch_rad=-0.03, yaw_rad=0.05)
    for part in (slice(0, 3), slice(3, 6)):
        np.testing.assert_allclose(
            np.linalg.norm(tilted[:, part], axis=1), np.linalg.norm(plain[:, part], axis=1), rtol=1e-12
        )
    yawed = push(yaw_rad=math.pi / 2)
    np.testing.assert_allclose(yawed[:, 1], plain[:, 0], atol=1e-12)
    off_axis = push(off_axis_y_m=0.001) - plain
    np.testing.assert_allclose(off_axis[:, 3], 0.001 * plain[:, 2], atol=1e-3)
    assert np.array_equal(push(depth_offset_m=0.5), push(depth_offset_m=0.004))  # the tool is no longer
    loose, dense = (push(packing_percent=percent)[400:, 0].mean() for percent in (-2.0, 2.0))
    assert dense > 1.15 * loose


def test_rest_is_sensor_noise_in_steps_of_the_converter(paper_like):
    rest = np.concatenate(
        [r.wrench[: r.trigger_index] - r.wrench[: r.trigger_index].mean(0) for r in paper_like]
    )
    np.testing.assert_allclose(rest.std(axis=0), Sensor().noise_rms, rtol=0.03)
    steps = paper_like.X / Sensor().resolution()
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)


def test_samples_at_the_end_of_the_range_are_flagged():
    small = Sensor(full_scale=(2.0, 145.0, 290.0, 5.0, 5.0, 5.0))
    recording = synthesize("fine sugar", n_per_class=1, sensor=small)[0]
    assert recording.wrench[:, 0].max() == 2.0
    assert recording.flags is not None
    assert np.array_equal(recording.flags == SampleFlag.SATURATED, recording.wrench[:, 0] == 2.0)
    assert (recording.flags > 0).sum() > 1000
    assert synthesize("fine sugar", n_per_class=1)[0].flags is None


def test_mean_pushes_look_like_those_of_the_paper(paper_like):
    mean = {label: paper_like.X[paper_like.y == label, :, 0].mean(axis=0) for label in paper_like.labels}
    rice = mean["rice"]  # peaks early and then falls near zero
    assert 100 < rice.argmax() < 350
    assert rice.max() > 6
    assert np.abs(rice[900:1150]).max() < 0.1 * rice.max()
    for label in ("clay granules", "cat litter"):  # go negative
        assert mean[label].max() > 2
        assert mean[label][1000:].mean() < -0.15
    level = {label: fx[200:].mean() for label, fx in mean.items()}
    assert level["fine sugar"] / level["sunflower seeds"] > 1.8
    assert 0.8 < level["oat flakes"] / level["breadcrumbs"] < 1.25


@pytest.fixture(scope="module")
def drives():
    return synthesize(["rice", "fine sugar"], n_per_class=2, rate_hz=100, duration_s=10, sensor="imu")


def test_drives_have_their_length_and_a_session_each(drives):
    assert drives.X.shape == (4, 1000, 6)
    assert list(drives.sessions) == ["rice_00", "rice_01", "fine_sugar_00", "fine_sugar_01"]
    for drive in drives:
        assert drive.axes == ("wx", "wy", "wz", "ax", "ay", "az")
        assert list(drive.meta["units"].values()) == ["rad/s"] * 3 + ["m/s2"] * 3
        assert drive.is_synthetic
        assert drive.trigger_index is None
        assert drive.flags is None


def test_a_drive_rests_and_coarse_grains_shake_it(drives):
    rest, moving = drives.X[:, :10, 3].std(axis=1), drives.X[:, 40:300, 3].std(axis=1)
    assert rest.mean() == pytest.approx(0.03, rel=0.3)
    np.testing.assert_allclose(drives.X.mean(axis=1)[:, 5], -9.81, atol=0.5)  # gravity, and no steady load
    assert moving[:2].min() > 2 * moving[2:].max()  # rice, fine sugar
    many = synthesize(["macaroni", "rice"], 3, duration_s=20, rate_hz=100, sensor="imu")
    assert np.array_equal(many.X[many.y == "rice"][:2, :1000], drives.X[:2])


@settings(max_examples=60)
@given(
    material=st.builds(
        Material,
        name=st.just("any"),
        grain_diameter_m=st.floats(1e-6, 0.1),
        aspect_ratio=st.floats(1, 10),
        bulk_density_kg_m3=st.floats(1, 5000),
        friction_angle_deg=st.floats(0, 60),
        cohesion_pa=st.floats(0, 1000),
        overshoot=st.floats(0, 3),
        overshoot_at_diameters=st.floats(0.05, 3),
        back_flow=st.floats(0, 3),
        shear_band_wave=st.floats(0, 0.5),
        fluctuation=st.floats(0, 3),
        sharpness=st.floats(0.01, 3),
        mobilisation_diameters=st.floats(0.01, 3),
    ),
    speed=st.floats(0.001, 0.1),
    rate_hz=st.floats(20, 2000),
    seed=st.integers(0, 2**64),
)
def test_every_valid_material_gives_finite_forces(material, speed, rate_hz, seed):
    push = simulate_push(
        material, rig=Rig(speed_m_s=speed), rate_hz=rate_hz, duration_s=0.6, lead_s=0.1, seed=seed
    )
    assert push.shape == (round(0.6 * rate_hz), 6)
    assert np.isfinite(push).all()
    assert not push[: int(0.1 * rate_hz)].any()
    assert push[-1].any()


def test_the_rest_before_the_motion_gives_nothing_away(paper_like):
    rest = StandardScaler().fit_transform(paper_like.X[:, :50].mean(axis=1))
    first = np.arange(len(rest)) % 12 < 8
    classifier = SVC(kernel="linear").fit(rest[first], paper_like.y[first])
    assert classifier.score(rest[~first], paper_like.y[~first]) < 0.25


def made(**arguments):
    return synthesize(**{"materials": "rice", "n_per_class": 4, **arguments})


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: made(materials=["sand", "rice", "mud"]),
            "no material 'sand' or 'mud'; known: dry peas, .*cat",
        ),
        (lambda: made(materials=["rice", BY_NAME["rice"]]), "'rice' twice"),
        (lambda: made(sensor="gyro"), "sensor must be a Sensor or 'imu', got 'gyro'"),
        (lambda: made(n_per_class=0), "n_per_class must be at least 1, got 0"),
        (lambda: made(sessions=5), "sessions must not exceed n_per_class = 4, got 5"),
        (lambda: made(duration_s=0.2), r"duration_s must exceed the 0.25 s of rest .* got 0.2"),
        (lambda: made(duration_s=10), r"duration_s = 10 moves the tool up to 0.29\d m, and the wall"),
        (lambda: made(seed=-1), "seed must be at least 0, got -1"),
        (lambda: made(rig=Rig(depth_m=0.005)), "depth_m = 0.005 of rig"),
        (lambda: replace(LENTILS, name=" "), "name must be a non-empty string"),
        (
            lambda: replace(LENTILS, grain_diameter_m=4.5),
            "of material 'lentils' must be at most 0.1, got 4.5",
        ),
        (lambda: replace(LENTILS, bulk_density_kg_m3=0), "needs bulk_density_kg_m3 or cohesion_pa"),
        (lambda: Rig(depth_m=0.09), "depth_m must not exceed tool_length_m = 0.08"),
        (lambda: Sensor(noise_rms=(0.1,) * 5), "noise_rms must hold 6 finite numbers"),
        (lambda: Sensor(bits=0), "bits must be a whole number from 2 to 32"),
        (lambda: Nuisance(depth_m=(0.1, 0.1)), "depth_m must be .per recording, per fill, per session"),
        (lambda: simulate_push(LENTILS, parts=("slip", "magic")), "no part 'magic'; known: texture, slip"),
        (
            lambda: simulate_push(LENTILS, duration_s=5),
            "a push of 5 s .* into the wall at wall_distance_m = 0.1",
        ),
    ],
)
def test_what_cannot_be_simulated_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()
