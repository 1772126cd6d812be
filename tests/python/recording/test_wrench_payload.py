"""Payloads: identified from rests in several orientations, stored, taken off."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from granular_id.recording import Dataset, Payload, Recording, Setup, compensate, rest_zero
from granular_id.recording.payload import STANDARD_GRAVITY_M_S2
from granular_id.synthetic import simulate_rests, synthesize

TRUE = Payload(0.306, (0.002, -0.003, 0.05), bias=(5, 42, 3, 0.78, -0.16, 0.11))
FIGURES = np.r_[TRUE.mass_kg, TRUE.centre_of_mass_m, TRUE.bias]
POSES = Rotation.random(6, random_state=4)
DOWN = POSES.inv().apply([0, 0, -1])


def figures(payload):
    return np.r_[payload.mass_kg, payload.centre_of_mass_m, payload.bias]


@pytest.fixture(scope="module")
def rests():
    return simulate_rests(TRUE, DOWN, seed=1)


@pytest.fixture(scope="module")
def payload(rests):
    return Payload.identify(rests, gravity=DOWN)


def test_weight_pulls_down_at_its_lever():
    read = Payload(2.0, (0.1, 0.0, 0.0)).wrench([0, 0, -3])
    weight = 2 * STANDARD_GRAVITY_M_S2
    np.testing.assert_allclose(read, [0, 0, -weight, 0, 0.1 * weight, 0])


def test_exact_means_give_the_payload():
    found = Payload.identify(TRUE.wrench(DOWN), gravity=DOWN)
    np.testing.assert_allclose(figures(found), FIGURES, atol=1e-10)


def test_identify_is_plain_least_squares(rests, payload):
    forces = np.concatenate([rest_zero(r.wrench)[:3] for r in rests])
    rows = np.hstack([DOWN.reshape(-1, 1), np.tile(np.eye(3), (6, 1))])
    found, (squares,), *_ = np.linalg.lstsq(rows, forces, rcond=None)
    assert payload.mass_kg == pytest.approx(found[0] / STANDARD_GRAVITY_M_S2)
    np.testing.assert_allclose(payload.bias[:3], found[1:])
    assert 6 * np.square(payload.fit.residual[:3]).sum() == pytest.approx(squares)


def test_identify_of_noisy_rests_is_near_the_truth(payload):
    near = np.r_[0.01, [0.002] * 3, [0.2] * 3, [0.01] * 3]
    assert (abs(figures(payload) - FIGURES) < near).all()
    assert payload.fit.n_rests == 6
    assert 1 < payload.fit.condition < 4


def test_rotations_state_the_same_as_gravity(rests, payload):
    for rotations in (POSES, POSES.as_matrix(), POSES.as_quat()):
        found = Payload.identify(rests, rotations=rotations)
        np.testing.assert_allclose(figures(found), figures(payload), rtol=1e-9)


def test_an_accelerometer_states_the_same_in_any_unit(rests, payload):
    for unit in (1.0, 9.81):
        read = [np.tile(-unit * g, (7, 1)) for g in DOWN]
        found = Payload.identify(rests, accelerations=read)
        np.testing.assert_allclose(figures(found), figures(payload), rtol=1e-9)
    np.testing.assert_allclose(
        figures(Payload.identify(rests, accelerations=-DOWN)), figures(payload), rtol=1e-9
    )


def test_the_frame_is_that_of_the_rests(rests):
    named = Dataset([replace(r, meta={"frame": "wrist"}) for r in rests])
    assert Payload.identify(named, gravity=DOWN).frame == "wrist"
    mixed = Dataset([*named[:3], *rests[3:]])
    with pytest.raises(ValueError, match="rests are of several frames"):
        Payload.identify(mixed, gravity=DOWN)


# What cannot be told.


@pytest.mark.parametrize("n", [1, 3])
def test_too_few_orientations_are_refused(rests, n):
    with pytest.raises(
        ValueError, match=f"rests hold {n} orientation.*mass and bias cannot be told apart.*tare"
    ):
        Payload.identify(rests[:n], gravity=DOWN[:n])


@pytest.mark.parametrize(
    "down",
    [
        np.tile([0.0, 0, -1], (4, 1)),  # one orientation
        Rotation.from_euler("x", [[0], [1], [2], [3]], degrees=True).apply([0, 0, -1]),
        np.array([[0.0, 0, -1], [0, 0, 1], [0, 0, -1], [0, 0, 1]]),  # the torques know two of three levers
    ],
)
def test_orientations_too_alike_are_refused(down):
    rests = simulate_rests(TRUE, down)
    with pytest.raises(ValueError, match=r"too alike.*mass and bias cannot be told apart.*only a tare"):
        Payload.identify(rests, gravity=down)


def test_a_weight_within_the_noise_is_refused():
    rests = simulate_rests(Payload(0.0005, (0, 0, 0)), DOWN, duration_s=0.1)
    with pytest.raises(ValueError, match="weight is less than the residual of the forces"):
        Payload.identify(rests, gravity=DOWN)


def test_gravity_upside_down_is_refused(rests):
    with pytest.raises(ValueError, match=r"a mass of -0\.3\d* kg: .* gravity is stated upwards"):
        Payload.identify(rests, gravity=-DOWN)


@pytest.mark.parametrize(
    ("stated", "problem"),
    [
        ({"gravity": DOWN, "rotations": POSES}, "got gravity and rotations"),
        ({"gravity": DOWN[:5]}, "gravity has 5 poses for 6 rests"),
        ({"gravity": 0 * DOWN}, "gravity holds a direction without length"),
        ({"gravity": DOWN[:, :2]}, "gravity has shape"),
        ({"rotations": np.eye(3)}, "rotations has shape"),
        (
            {"rotations": np.tile(np.diag([1, 1, -1]), (6, 1, 1))},
            r"rotations\[0\] is a reflection.*rotation$",
        ),
    ],
)
def test_refused_poses(rests, stated, problem):
    with pytest.raises(ValueError, match=problem):
        Payload.identify(rests, **stated)


def test_metadata_state_gravity(rests, payload):
    assert Payload.identify(rests) == payload
    freed = rests.compensate(payload)
    assert freed.X.tobytes() == rests.compensate(payload, list(DOWN)).X.tobytes()


def test_metadata_may_state_a_pose_as_text(rests, payload):
    poses = [dict(zip(("qx", "qy", "qz", "qw"), map(str, pose), strict=True)) for pose in POSES.as_quat()]
    posed = [replace(r, meta={"frame": r.meta["frame"], **p}) for r, p in zip(rests, poses, strict=True)]
    np.testing.assert_allclose(figures(Payload.identify(posed)), figures(payload), rtol=1e-9)


def test_where_nobody_states_gravity_it_is_asked_for(rests, payload):
    with pytest.raises(ValueError, match="exactly one of gravity, rotations and accelerations, got none"):
        Payload.identify(rests.X)
    with pytest.raises(ValueError, match="gravity must be given, as the metadata of 'rest_00' have no"):
        Payload.identify([replace(r, meta={}) for r in rests])
    with pytest.raises(ValueError, match="gravity must be given"):
        compensate(rests.X[0], payload)


@pytest.mark.parametrize("n_wrong", [1, 6])
def test_identify_of_wrong_poses_warns(rests, n_wrong):
    stated = DOWN.copy()
    angles = 25 * (-1) ** np.arange(n_wrong)[:, np.newaxis]
    stated[:n_wrong] = Rotation.from_euler("x", angles, degrees=True).apply(DOWN[:n_wrong])
    with pytest.warns(UserWarning, match="poses are not as stated"):
        Payload.identify(rests, gravity=stated)


@pytest.mark.parametrize("scale", [[1e3] * 3 + [1] * 3, [1] * 3 + [1e3] * 3])
def test_a_wrong_unit_is_doubted(rests, scale):
    with pytest.warns(UserWarning, match="in N and N m"):
        Payload.identify(rests.X * scale, gravity=DOWN)


@pytest.mark.parametrize("meta", [{"compensated": True}, {"tare": "rest"}])
def test_rests_without_their_weight_are_refused(rests, meta):
    with pytest.raises(ValueError, match="take rests as the sensor reads them"):
        Payload.identify([replace(r, meta={**r.meta, **meta}) for r in rests])


def test_nan_in_a_rest_is_refused():
    with pytest.raises(ValueError, match="rests hold NaN"):
        Payload.identify(np.full((6, 10, 6), np.nan), gravity=DOWN)


@pytest.mark.parametrize(
    ("fields", "problem"),
    [
        ({"mass_kg": -1}, "mass_kg must not be negative"),
        ({"centre_of_mass_m": (0, 0)}, "centre_of_mass_m"),
        ({"bias": (0, 0, 0, 0, 0, np.nan)}, "bias"),
    ],
)
def test_refused_payloads(fields, problem):
    with pytest.raises(ValueError, match=problem):
        Payload(**{"mass_kg": 1, "centre_of_mass_m": (0, 0, 0), **fields})


# Files.


def test_it_is_stored_whole(payload, tmp_path):
    payload.save(tmp_path / "tool.json")
    assert Payload.load(tmp_path / "tool.json") == payload


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{}",
        '{"format": "granular-id payload 2"}',
        '{"format": "granular-id payload 1"}',
        '{"format": "granular-id payload 1", "mass_kg": -1, "centre_of_mass_m": [0, 0, 0]}',
        '{"format": "granular-id payload 1", "mass_kg": 1, "centre_of_mass_m": [0, 0]}',
        '{"format": "granular-id payload 1", "mass_kg": 1e999, "centre_of_mass_m": [0, 0, 0]}',
        '{"format": "granular-id payload 1", "mass_kg": 1, "centre_of_mass_m": [0, 0, 0], "fit": {"n_rests": 4, '
        '"residual": [], "condition": 1}}',
        "[" * 100_000,
    ],
)
def test_other_files_are_refused_by_name(tmp_path, text):
    path = tmp_path / "tool.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"tool\.json: no payload: "):
        Payload.load(path)


def test_the_file_can_be_read_by_others(payload, tmp_path):
    payload.save(tmp_path / "tool.json")
    document = json.loads((tmp_path / "tool.json").read_text())
    assert document["mass_kg"] == payload.mass_kg
    assert document["fit"]["n_rests"] == 6


# Taking it off.


def test_a_rest_is_zero_without_its_payload(rests, payload):
    freed = rests.compensate(payload, list(DOWN))
    assert max(abs(rest_zero(r.wrench)).max() for r in freed) < 0.2  # of 42 N
    np.testing.assert_array_equal(freed.X[2], rests.X[2] - payload.wrench(DOWN[2]))


def test_gravity_may_turn_with_the_samples():
    down = np.random.default_rng(0).normal(size=(20, 3))
    samples = TRUE.wrench(down)
    np.testing.assert_allclose(compensate(samples, TRUE, down), 0, atol=1e-12)
    one_by_one = [compensate(sample, TRUE, g) for sample, g in zip(samples, down, strict=True)]
    assert np.array(one_by_one).tobytes() == compensate(samples, TRUE, down).tobytes()


def test_recordings_say_so():
    data = synthesize(["rice"], n_per_class=2).compensate(TRUE, [0, 0, 1])
    assert (Setup.of(data[0].meta).compensated, Setup.of(data[0].meta).payload) == ("yes", "0.306 kg")
    assert data.history[-1].parameters["mass_kg"] == 0.306


def test_twice_is_refused():
    data = synthesize(["rice"], n_per_class=1).compensate(TRUE, [0, 0, 1])
    with pytest.raises(ValueError, match="'rice_00' is compensated already"):
        data.compensate(TRUE, [0, 0, 1])


def test_what_is_tared_is_not_compensated(payload):
    tared = Recording(np.ones((5, 6)), rate_hz=500, name="push", meta={"tare": "rest"})
    with pytest.raises(ValueError, match=r"'push' is tared from rest.*before the tare"):
        compensate(tared, payload, [0, 0, -1])


def test_another_frame_is_refused():
    recording = Recording(np.zeros((3, 6)), rate_hz=500, name="a", meta={"frame": "flange"})
    with pytest.raises(ValueError, match="'a' is of the frame 'flange', the payload of 'wrist'"):
        compensate(recording, replace(TRUE, frame="wrist"), [0, 0, 1])


def test_another_sign_is_refused(rests, payload, tmp_path):
    turned = rests.transform(frame=payload.frame, reverse=True, sign="robot on tool")
    payload.save(tmp_path / "tool.json")
    with pytest.raises(ValueError, match="'rest_00' is of the sign 'robot on tool', the payload of 'load of"):
        turned.compensate(Payload.load(tmp_path / "tool.json"))


def test_a_payload_without_a_sign_is_not_compared(rests, payload):
    reversed_rests = rests.transform(frame="sensor", reverse=True, sign="robot on tool")
    reversed_rests.compensate(replace(payload, sign=None, frame=None))


def test_rests_of_several_signs_are_refused(rests):
    mixed = [replace(r, meta={**r.meta, "sign": f"{i % 2}"}) for i, r in enumerate(rests)]
    with pytest.raises(ValueError, match="rests are of several signs: '0', '1'"):
        Payload.identify(mixed)


def test_what_a_live_source_says_counts():
    meta = {"source": {"frame": "flange", "compensated": True}}
    recording = Recording(np.zeros((3, 6)), rate_hz=500, name="a", meta=meta)
    with pytest.raises(ValueError, match="compensated already"):
        compensate(recording, TRUE, [0, 0, 1])


def test_compensated_then_transformed_is_the_unloaded_wrench():
    data = synthesize(["rice"], n_per_class=1)
    turn, lever = POSES[0], np.array([0.0, 0.1, 0.2])
    mounted = data.transform(turn, lever, frame="sensor")
    down = turn.apply([0, 0, 1])
    loaded = Dataset([replace(r, wrench=r.wrench + TRUE.wrench(down)) for r in mounted])
    freed = loaded.compensate(TRUE, down).transform(turn.inv(), -turn.inv().apply(lever), frame="tool")
    np.testing.assert_allclose(freed.X, data.X, atol=1e-11)


@pytest.mark.parametrize("gravity", [[[0, 0, 1]] * 2, [np.zeros((5, 3)) + 1], "down", 3])
def test_refused_gravity(gravity):
    data = synthesize(["rice"], n_per_class=1)
    with pytest.raises((ValueError, TypeError), match="gravity"):
        data.compensate(TRUE, gravity)


def test_what_is_no_payload_is_refused():
    with pytest.raises(TypeError, match="payload must be a Payload"):
        compensate(np.zeros(6), {"mass_kg": 1}, [0, 0, 1])


def test_it_prints_what_is_known(payload):
    assert "condition number 1.7, residual 0.041 N" in str(payload)
    assert str(TRUE) == "0.306 kg at (2.0, -3.0, 50.0) mm"


def test_where_gravity_points_is_no_longer_known_of_turned_recordings():
    rests = simulate_rests(replace(TRUE, frame="wrist"), DOWN)
    turned = rests.transform(Rotation.from_euler("z", 90, degrees=True), frame="flange")
    renamed = rests.transform(frame="flange")
    Payload.identify(renamed)
    with pytest.raises(ValueError, match="gravity must be given, as the metadata of"):
        Payload.identify(turned)
