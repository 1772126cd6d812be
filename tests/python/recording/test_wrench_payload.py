"""Payloads: identified from rests in several orientations, stored, taken off."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from granular_id.recording import Dataset, Payload, Recording, rest_zero
from granular_id.recording.payload import STANDARD_GRAVITY_M_S2
from granular_id.synthetic import simulate_rests

TRUE = Payload(0.306, (0.002, -0.003, 0.05), bias=(5, 42, 3, 0.78, -0.16, 0.11))
FIGURES = np.r_[TRUE.mass_kg, TRUE.centre_of_mass_m, TRUE.bias]
POSES = Rotation.random(6, random_state=4)
DOWN = POSES.inv().apply([0, 0, -1])


def figures(payload):
    return np.r_[payload.mass_kg, payload.centre_of_mass_m, payload.bias]


def push(**meta):
    return Recording(np.ones((5, 6)), rate_hz=500, name="push", meta=meta)


@pytest.fixture(scope="module")
def rests():
    return simulate_rests(TRUE, DOWN, seed=1)


@pytest.fixture(scope="module")
def payload(rests):
    return Payload.fit(rests, gravity=DOWN)


def test_weight_pulls_down_at_its_lever():
    weight = 2 * STANDARD_GRAVITY_M_S2
    read = Payload(2.0, (0.1, 0.0, 0.0)).wrench([0, 0, -3])
    np.testing.assert_allclose(read, [0, 0, -weight, 0, 0.1 * weight, 0])


def test_fit_is_plain_least_squares(rests, payload):
    """Both systems written out by hand, with scipy's skew-symmetric matrices for the torques."""
    means = np.array([r.wrench.mean(axis=0) for r in rests])
    eye = np.tile(np.eye(3), (6, 1))
    forces = np.hstack([DOWN.reshape(-1, 1), eye])
    skew = np.concatenate([[[0, z, -y], [-z, 0, x], [y, -x, 0]] for x, y, z in DOWN])  # c x g = skew(g) c
    weight, *zero = np.linalg.lstsq(forces, means[:, :3].ravel(), rcond=None)[0]
    moment_zero, (squares,), *_ = np.linalg.lstsq(np.hstack([skew, eye]), means[:, 3:].ravel(), rcond=None)
    np.testing.assert_allclose(payload.mass_kg, weight / STANDARD_GRAVITY_M_S2, rtol=1e-12)
    np.testing.assert_allclose(payload.centre_of_mass_m, moment_zero[:3] / weight, rtol=1e-9)
    np.testing.assert_allclose(payload.bias, [*zero, *moment_zero[3:]], rtol=1e-9)
    assert 6 * np.square(payload.residual[3:]).sum() == pytest.approx(squares)


def test_fit_of_noisy_rests_is_near_the_truth(payload):
    near = np.r_[0.01, [0.002] * 3, [0.2] * 3, [0.01] * 3]
    assert (abs(figures(payload) - FIGURES) < near).all()
    assert payload.n_rests == 6
    assert 1 < payload.condition < 4


def test_metadata_state_gravity_frame_and_sign(rests, payload):
    assert Payload.fit(rests) == payload
    assert (payload.frame, payload.sign) == (rests[0].meta["frame"], rests[0].meta["sign"])
    texts = [{f"g{x}": str(part) for x, part in zip("xyz", g, strict=True)} for g in DOWN]
    apart = [replace(r, meta=meta) for r, meta in zip(rests, texts, strict=True)]
    np.testing.assert_allclose(figures(Payload.fit(apart)), figures(payload), rtol=1e-12)
    from_orientations = -POSES.as_matrix()[:, 2]
    np.testing.assert_allclose(figures(Payload.fit(rests, from_orientations)), figures(payload), rtol=1e-9)


@pytest.mark.parametrize(
    "down",
    [
        np.tile([0.0, 0, -1], (4, 1)),  # one orientation
        Rotation.from_euler("x", [[0], [1], [2], [3]], degrees=True).apply([0, 0, -1]),
        np.array([[0.0, 0, -1], [0, 0, 1], [0, 0, -1], [0, 0, 1]]),  # the torques know two of three levers
        DOWN[:3],
    ],
)
def test_orientations_too_few_or_alike_are_refused(down):
    with pytest.raises(ValueError, match=r"rests .*mass and bias cannot be separated.*only a tare"):
        Payload.fit(simulate_rests(TRUE, down), down)


def changed(rests, **meta):
    return [replace(r, meta={**r.meta, **meta}) for r in rests]


@pytest.mark.parametrize(
    ("change", "gravity", "problem"),
    [
        (lambda rests: rests, -DOWN, r"a mass of -0\.3\d* kg.*gravity with the other sign"),
        (lambda _: simulate_rests(Payload(5e-4, (0, 0, 0)), DOWN, duration_s=0.1), DOWN, "not above the"),
        (lambda rests: rests, DOWN[:5], r"gravity has shape \(5, 3\); wanted a direction a rest, \(6, 3\)"),
        (lambda rests: rests, 0 * DOWN, "gravity holds a direction without length"),
        (lambda rests: rests.X, None, r"rests\[0\] is a ndarray; wanted Recording"),
        (lambda rests: [replace(r, meta={}) for r in rests], None, "gravity must be given, as .* 'rest_00'"),
        (
            lambda rests: [replace(r, meta=dict.fromkeys(("gx", "gy", "gz"), "down")) for r in rests],
            None,
            "gravity of 'rest_00' is 'down', 'down', 'down' by its metadata; wanted three numbers",
        ),
        (lambda rests: changed(rests, compensated=True), None, "take rests as the sensor reads them"),
        (lambda rests: [*changed(rests[:3], sign="0"), *rests[3:]], None, "rests are of several signs: '0'"),
    ],
)
def test_what_gives_no_payload_is_refused(rests, change, gravity, problem):
    with pytest.raises((ValueError, TypeError), match=problem):
        Payload.fit(change(rests), gravity)


def test_payload_is_stored_whole(payload, tmp_path):
    payload.save(tmp_path / "tool.json")
    assert Payload.load(tmp_path / "tool.json") == payload


def test_other_files_are_refused_by_name(tmp_path):
    path, begin = (
        tmp_path / "tool.json",
        '{"format": "granular_id.payload/1", "centre_of_mass_m": [0, 0, 0], ',
    )
    others = ("", '{"format": "granular-id payload 2"}', "[" * 100_000)
    for text in (*others, begin + '"mass_kg": -1}', begin + '"mass_kg": 1e999}'):
        path.write_text(text)
        with pytest.raises(ValueError, match=r"tool\.json: no payload: "):
            Payload.load(path)


def test_a_rest_is_zero_without_its_payload(rests, payload):
    freed = rests.compensate(payload, list(DOWN))
    assert max(abs(rest_zero(r.wrench)).max() for r in freed) < 0.2  # of 42 N
    np.testing.assert_array_equal(freed.X[2], rests.X[2] - payload.wrench(DOWN[2]))
    assert freed.X.tobytes() == rests.compensate(payload).X.tobytes()


def test_gravity_may_turn_with_the_samples():
    down = np.random.default_rng(0).normal(size=(20, 3))
    data = Dataset([Recording(TRUE.wrench(down), rate_hz=100)] * 2).compensate(TRUE, [down, down])
    np.testing.assert_allclose(data.X, 0, atol=1e-12)


@pytest.mark.parametrize(
    ("meta", "problem"),
    [
        ({"compensated": True}, "'push' is compensated already"),
        ({"source": {"frame": "wrist", "compensated": True}}, "'push' is compensated already"),
        ({"tare": "rest"}, r"'push' is tared from rest.*before the tare"),
        ({"frame": "flange"}, "'push' is of the frame 'flange', the payload of 'wrist'"),
        ({"sign": "robot on tool"}, "'push' is of the sign 'robot on tool', the payload of 'load"),
    ],
)
def test_other_recordings_are_not_compensated(meta, problem, tmp_path):
    replace(TRUE, frame="wrist", sign="load").save(tmp_path / "tool.json")
    with pytest.raises(ValueError, match=problem):
        Dataset([push(**meta)]).compensate(Payload.load(tmp_path / "tool.json"), [0, 0, 1])
    Dataset([push(frame="flange", sign="robot on tool")]).compensate(TRUE, [0, 0, 1])  # it states neither


@pytest.mark.parametrize("change", [{"rotation": POSES[0], "frame": "flange"}, {"flip": ("fx", "tx")}])
def test_turned_recordings_state_no_gravity(change):
    rests = simulate_rests(replace(TRUE, frame="wrist"), DOWN)
    Payload.fit(rests.transform(frame="flange"))  # renamed
    with pytest.raises(ValueError, match="gravity must be given, as the metadata of"):
        Payload.fit(rests.transform(**change))
