"""Wrenches: the zero that the rest before the motion gives, and other frames."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from granular_id.io import load
from granular_id.recording import AXES, Dataset, Recording, Setup, rest_zero, transform
from granular_id.synthetic import synthesize


@pytest.fixture(scope="module")
def data():
    return synthesize(["rice", "dry peas"], n_per_class=3, duration_s=0.6, seed=2)


def test_tare_of_a_stream_has_the_same_bits(data):
    for tared, before in zip(data.tare(lead_s=0.1), data, strict=True):
        total = np.zeros(6)
        for sample in before.wrench[before.trigger_index - 50 : before.trigger_index]:
            total = total + sample
        streamed = np.array([sample - total / 50 for sample in before.wrench])
        assert tared.wrench.tobytes() == streamed.tobytes()


@pytest.mark.parametrize("columns", [1, 6])
def test_rest_zero_is_the_same_however_samples_lie(columns):
    lead = np.random.default_rng(1).normal(size=(1000, columns))
    one_by_one = np.array([rest_zero(np.ascontiguousarray(lead[:, [c]]))[0] for c in range(columns)])
    assert rest_zero(np.asfortranarray(lead)).tobytes() == rest_zero(lead).tobytes() == one_by_one.tobytes()


def test_tare_is_stated_in_the_metadata(data):
    tared = data.tare(lead_s=0.1)
    assert {Setup.of(recording.meta).tare for recording in tared} == {"rest"}
    assert tared.history[-1].step == "tare"
    assert tared.history[-1].rows[0]["fx"] == rest_zero(data[0].wrench[data[0].trigger_index - 50 :][:50])[0]
    assert tared[0].trigger_index == data[0].trigger_index
    chosen = data.select(axes=["fz", "fx"]).tare(lead_s=0.1)
    assert np.array_equal(chosen.X, tared.select(axes=["fz", "fx"]).X)


def test_tare_by_default_takes_the_rest_that_is_there(data):
    for tared, before, row in zip(data.tare(), data, data.tare().history[-1].rows, strict=True):
        lead = before.wrench[: before.trigger_index]
        assert np.array_equal(tared.wrench, before.wrench - rest_zero(lead))
        assert row["lead_s"] == len(lead) / 500


def test_tare_of_a_long_rest_takes_its_last_two_seconds():
    wrench = np.repeat(np.arange(30.0), 10)[:, None] + np.zeros((300, 6))
    tared = Dataset([Recording(wrench, rate_hz=100, trigger_index=280)]).tare()
    assert np.array_equal(tared[0].wrench, wrench - wrench[80:280].mean())


def test_tare_of_too_short_a_rest_is_refused_with_a_way(data):
    short = Dataset([replace(data[0], trigger_index=40)])
    with pytest.raises(ValueError, match=r"has 0.08 s of rest .* 0.1 s are wanted; lead_s=0.08 fits all"):
        short.tare()
    assert short.tare(lead_s=0.08).history[-1].rows[0]["lead_s"] == 0.08
    other = Dataset([data[0], replace(data[1], trigger_index=None)])
    with pytest.raises(ValueError, match=r"1 recording has no trigger_index: 'rice_01'.*find_onsets"):
        other.tare(lead_s=0.1)


RNG = np.random.default_rng(3)
TURN = Rotation.from_euler("xyz", [20, -35, 110], degrees=True)
P = np.array([0.1, -0.02, 0.3])
WRENCH = RNG.normal(size=(50, 6))
FILES = ("train", "later_x_flipped")


def recorded(wrench=WRENCH, **fields):
    return Recording(wrench, rate_hz=500, **{"name": "a", "label": "rice", **fields})


def test_force_is_turned_and_torque_gets_the_lever():
    force = TURN.apply(WRENCH[:, :3])
    torque = TURN.apply(WRENCH[:, 3:]) + np.cross(P, force)
    np.testing.assert_allclose(transform(WRENCH, TURN, P), np.hstack([force, torque]), atol=1e-14)


def test_one_sample_has_the_bits_of_many():
    alone = np.array([transform(sample, TURN, P) for sample in WRENCH])
    assert alone.tobytes() == transform(WRENCH, TURN, P).tobytes()
    assert alone.tobytes() == transform(WRENCH.reshape(5, 10, 6), TURN, P).tobytes()


def test_quaternion_matrix_and_rotation_are_the_same():
    turned = transform(WRENCH, TURN)
    for same in (TURN.as_matrix(), TURN.as_quat()):
        np.testing.assert_allclose(transform(WRENCH, same), turned, atol=1e-15)
    assert transform(WRENCH).tobytes() == WRENCH.tobytes()


@pytest.mark.parametrize("axes", [(), ("fx",), ("fx", "tx"), ("ty", "fz", "fx"), AXES])
def test_flip_changes_the_sign_of_these_axes_first(axes):
    mirrored = WRENCH.copy()
    mirrored[:, [AXES.index(axis) for axis in axes]] *= -1
    before = WRENCH.copy()
    assert np.array_equal(transform(WRENCH, TURN, P, flip=axes), transform(mirrored, TURN, P))
    assert np.array_equal(WRENCH, before)


def test_flip_of_a_mirrored_driver_brings_it_back(data_dir):
    """A driver that mirrors x: forces of a mirrored frame change fx, torques as axial vectors would all but tx."""
    train, later = (load(data_dir / "cases" / "10_mirrored_frame" / f"{name}.npz") for name in FILES)
    found = later.transform(flip=("fx", "tx"))
    near, far = (abs(one.X.mean(axis=(0, 1)) - train.X.mean(axis=(0, 1))).max() for one in (found, later))
    assert near < 0.1 * far
    assert "frame" not in found[0].meta


def test_a_recording_keeps_what_it_is():
    about = {"tool": "cylinder"}
    turned = Dataset([recorded(trigger_index=7, meta=about)]).transform(TURN, P, frame="flange")[0]
    assert turned.wrench.tobytes() == transform(WRENCH, TURN, P).tobytes()
    assert replace(turned, wrench=WRENCH) == recorded(trigger_index=7, meta={**about, "frame": "flange"})


def test_the_step_names_the_new_frame_and_sign():
    data = Dataset([recorded(meta={"frame": "sensor", "sign": "on the tool"})])
    turned = data.transform(TURN, P, frame="flange")
    assert Setup.of(turned[0].meta) == Setup(frame="flange", sign="on the tool")
    assert turned.history[-1].parameters["frame"] == "flange"
    assert np.array_equal(turned.history[-1].parameters["rotation"], TURN.as_matrix())
    reversed_ = data.transform(flip=AXES, sign="on the robot")
    assert reversed_[0].meta["sign"] == "on the robot"
    assert np.array_equal(reversed_.X[0], -WRENCH)


MIXED = Dataset([recorded(meta={"frame": name, "sign": name}) for name in ("flange", "wrist", "wrist")])


OF_FLANGE = Dataset([recorded(meta={"source": {"frame": "flange", "sign": "on the tool"}})])
MILLIMETRES = Dataset([recorded(meta={"units": ["N"] * 3 + ["N mm"] * 3})])
FORCES = Dataset([Recording(WRENCH[:, :3], rate_hz=500, axes=("fx", "fy", "fz"), name="a")])


@pytest.mark.parametrize(
    ("data", "keywords", "problem"),
    [
        (MIXED, {"rotation": TURN, "frame": "tool"}, r"several frames: 'wrist' \(2\), 'flange' \(1\)"),
        (MIXED, {"flip": AXES, "sign": "on the robot"}, "several signs"),
        (OF_FLANGE, {"rotation": TURN, "frame": "flange"}, "frame is 'flange' already, as the metadata of 1"),
        (OF_FLANGE, {"flip": AXES, "sign": "on the tool"}, "sign is 'on the tool' already"),
        (OF_FLANGE, {"sign": "on the robot"}, "sign are the words"),
        (OF_FLANGE, {"flip": ("fx",), "sign": "on the robot"}, "sign are the words"),
        (OF_FLANGE, {"rotation": TURN}, "frame is None"),
        (MILLIMETRES, {"rotation": TURN, "frame": "flange"}, "'a' has tx in N mm; wanted N m"),
        (FORCES, {"rotation": TURN, "frame": "flange"}, r"axes fx fy fz; wanted.*replace\(recording, axes="),
    ],
)
def test_recordings_that_cannot_be_turned_are_refused(data, keywords, problem):
    with pytest.raises(ValueError, match=problem):
        data.transform(**keywords)


def test_a_frame_may_be_renamed():
    assert {r.meta["frame"] for r in MIXED.transform(frame="tool")} == {"tool"}
