"""Each fault put into sound recordings is found by its name, and nothing else is."""

from dataclasses import replace

import numpy as np
import pytest

from checks_cases import PER_CLASS, by_code, codes, damaged, sound_set
from granular_id.recording import Dataset, Recording, SampleFlag

TIMES = np.arange(1600) / 500
WHOLE = range(4 * PER_CLASS)


@pytest.fixture(scope="module")
def sound():
    return sound_set()


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_sound_sets_raise_no_warning(seed):
    report = sound_set(seed).check(sensor_range="Mini45 SI-145-5")
    assert report.worst == "ok"
    assert codes(report, infos=True) <= {"rest-shift"}


def clipped(w, _):
    np.minimum(w[:, 0], np.sort(w[:, 0])[1440], out=w[:, 0])


def stuck(w, _):
    w[:, 3] = w[0, 3]


def stuck_for_a_while(w, _):
    w[500:700, 1] = w[500, 1]


def frozen(w, _):
    w[800:840] = w[800]


def spiky(w, _):
    w[500, 2] += 30
    w[900, 0] -= 20


def humming(w, _):
    w[:, 2] += 0.00885 * np.rint(900 * np.sin(2 * np.pi * 150 * TIMES))


@pytest.mark.parametrize(
    ("fault", "code", "words"),
    [
        (clipped, "clipped", "on fx"),
        (stuck, "stuck-axis", "(tx)"),
        (stuck_for_a_while, "stuck-stretch", "(fy)"),
        (frozen, "frozen", "repeat one sample: 40 times"),
        (spiky, "spikes", "(2 spikes on fx, fz)"),
        (lambda w, _: w.round(3), "resolution-differs", "0.00443"),
    ],
)
def test_a_fault_of_the_sensor(sound, fault, code, words):
    report = damaged(sound, [7, 30], fault).check()
    assert codes(report) == {code}
    finding = by_code(report)[code]
    assert finding.indices == (7, 30)
    assert finding.recordings == (sound[7].name, sound[30].name)
    assert words.replace("2 spikes", "4 spikes") in finding.message
    assert [v.state for v in report.verdicts].count("warning") == 2


def test_an_outlier(sound):
    finding = by_code(damaged(sound, [7], humming).check())["outlier"]
    assert finding.recordings == (sound[7].name,)
    assert "roughness of force" in finding.message
    assert finding.values["robust_sd"][sound[7].name] > 10


def test_labels_of_few_recordings_have_no_outliers(sound):
    few = damaged(sound, [0], humming).select(indices=[*range(7), *range(12, 19)])
    assert "outlier" not in codes(few.check())


def test_a_lower_false_alarm_rate_is_stricter(sound):
    bad = damaged(sound, [7], lambda w, _: 8 * w)
    assert "outlier" in codes(bad.check(false_alarm_rate=0.05))
    assert "outlier" not in codes(bad.check(false_alarm_rate=1e-9))
    with pytest.raises(ValueError, match="false_alarm_rate must lie between 0 and 1, got 1"):
        sound.check(false_alarm_rate=1)


@pytest.mark.parametrize(
    "stated", ["ATI Mini45 SI-145-5", "si-145-5", [145, 145, 290, 5, 5, 5], {"fx": 145.0}, 145]
)
def test_clipping_at_a_stated_range(sound, stated):
    def beyond(w, _):
        w[100:103, 0] = -145

    report = damaged(sound, [3], beyond).check(sensor_range=stated)
    finding = by_code(report)["clipped"]
    assert finding.message.startswith("1 recording reaches the sensor's range on fx, in 3 samples")
    assert finding.indices == (3,)
    assert codes(report) <= {"clipped", "outlier"}


def test_readings_far_beyond_the_range_are_in_another_unit(sound):
    finding = by_code(damaged(sound, [3], lambda w, _: 1000 * w).check(sensor_range=145))["beyond-range"]
    assert finding.severity == "error"
    assert finding.indices == (3,)


@pytest.mark.parametrize(
    ("stated", "words"),
    [
        ("Mini45", "is the name of several sensors; choose from ATI Mini45 SI-145-5, ATI Mini45 SI-290-10"),
        ("Foo", "is no known sensor; choose from ATI Nano17"),
        ([1, 2], "2 numbers; wanted 6: fx, fy, fz, tx, ty, tz"),
        ({"fw": 1}, "names the axis 'fw'; there are fx"),
        ([1, 1, 1, 1, 1, 0], "must be positive, got tz: 0"),
        (float("nan"), "must be finite"),
    ],
)
def test_bad_ranges(sound, stated, words):
    with pytest.raises(ValueError, match="sensor_range") as caught:
        sound.check(sensor_range=stated)
    assert words in str(caught.value)


def test_a_named_sensor_needs_its_axes():
    data = Dataset([Recording(np.ones((9, 1)), rate_hz=9, axes=("force",))])
    with pytest.raises(ValueError, match="has no axis 'force'"):
        data.check(sensor_range="SI-145-5")
    with pytest.raises(TypeError, match="sensor_range must be a number"):
        data.check(sensor_range=None if not data else object())


@pytest.mark.parametrize(
    ("fields", "found"),
    [
        ({"label": None}, {"no-label"}),
        ({"rate_hz": 400}, {"rates-differ"}),
        ({"rate_hz": 0.5}, {"rates-differ", "slow"}),
        ({"wrench": lambda w, _: w[:, :3], "axes": ("fx", "fy", "fz")}, {"axes-differ"}),
        ({"session": None}, {"some-sessions"}),
    ],
)
def test_faults_of_what_is_stated(sound, fields, found):
    report = damaged(sound, [6], **fields).check()
    assert codes(report) == found
    assert all(report.verdicts[6].codes)
    assert report.verdicts[6].state == report.worst


def irregular(times, **fields):
    return {"rate_hz": None, "time_s": times - times[0], "trigger_index": None, **fields}


def test_gaps(sound):
    kept = np.delete(np.arange(1600), slice(600, 640))
    report = damaged(sound, [6], lambda w, _: w[kept], **irregular(TIMES[kept])).check()
    assert codes(report) == {"gaps"}
    assert by_code(report)["gaps"].values["longest_s"] == pytest.approx(0.082)
    long = np.concatenate([TIMES[:800], TIMES[800:] + 0.4])
    assert "1 above 0.25 s" in by_code(damaged(sound, [6], **irregular(long)).check())["gaps"].message


def test_jitter(sound):
    late = np.sort(TIMES + np.random.default_rng(0).uniform(0, 1.8e-3, 1600))
    report = damaged(sound, [6, 20, 33], **irregular(late)).check()
    assert codes(report) == {"jitter"}
    assert codes(report, infos=True) >= {"irregular"}
    gently = TIMES + np.random.default_rng(0).uniform(0, 1e-4, 1600)
    assert codes(damaged(sound, [6, 20, 33], **irregular(gently)).check()) == set()


def test_a_stated_rate_that_the_stamps_do_not_keep(sound):
    stamps = np.arange(1600) / 480 + np.random.default_rng(0).uniform(0, 1e-4, 1600)
    finding = by_code(damaged(sound, [6], **irregular(stamps, meta={"rate_hz": 500})).check())[
        "rate-not-kept"
    ]
    assert "mean 480 Hz, its meta says 500" in finding.message
    kept = damaged(sound, [6], **irregular(stamps, meta={"rate_hz": 480})).check()
    assert "rate-not-kept" not in codes(kept)


def test_sparse_recordings(sound):
    stamps = TIMES + np.random.default_rng(0).uniform(0, 1e-4, 1600)
    data = damaged(sound, WHOLE, **irregular(stamps))
    third = damaged(data, [9], lambda w, _: w[::3], time_s=stamps[::3] - stamps[0])
    assert by_code(third.check())["sparse"].indices == (9,)


def test_drift_of_the_rest_level(sound):
    place = {name: k for k, name in enumerate(sound.names)}

    def warming(w, r):
        w[:, 2] += 0.1 * (place[r.name] % PER_CLASS)

    second = [i for i, r in enumerate(sound) if r.session == "session 2"]
    finding = by_code(damaged(sound, second, warming).check())["rest-drift"]
    assert finding.values["axis"] == "fz"
    assert "'session 2' (24 recordings)" in finding.message
    assert finding.values["change"] == pytest.approx(1.0, rel=0.3)


def test_sessions_with_another_zero(sound):
    second = [i for i, r in enumerate(sound) if r.session == "session 2"]
    report = damaged(sound, second, lambda w, _: w + 0.5 * np.eye(6)[3]).check()
    finding = by_code(report)["rest-shift"]
    assert finding.severity == "warning"
    assert finding.values["axis"] == "tx"
    assert set(finding.indices) in (set(second), set(WHOLE) - set(second))


def test_recordings_with_a_zero_of_their_own_are_no_shift_of_their_session():
    said = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        tared = sound_set(seed % 4).select(where=lambda r: r.label in ("rice", "macaroni"))
        data = damaged(tared, range(24), lambda w, _: w - w[:20].mean(axis=0) + rng.normal(size=6))  # noqa: B023
        said += data.check()
    assert not [finding for finding in said if finding.code in ("rest-shift", "rest-drift")]


@pytest.mark.parametrize(
    ("flag", "every", "severity"),
    [
        (SampleFlag.GAP_FILLED, 4, "warning"),
        (SampleFlag.GAP_FILLED, 40, "info"),
        (SampleFlag.SATURATED, 400, "warning"),
        (SampleFlag.BAD_STATUS, 400, "warning"),
        (SampleFlag.TIME_REPAIRED, 4, "info"),
    ],
)
def test_flagged_samples(sound, flag, every, severity):
    flags = np.where(np.arange(1600) % every == 0, np.uint8(flag), np.uint8(0))
    report = damaged(sound, WHOLE, flags=flags).check()
    finding = by_code(report)[flag.name.lower().replace("_", "-")]
    assert (finding.severity, finding.values["samples"]) == (severity, 48 * 1600 // every)


def test_one_recording_of_a_label(sound):
    report = Dataset([*sound, replace(sound[0], label="oats", wrench=sound[0].wrench[::-1])]).check()
    assert by_code(report)["single"].indices == (48,)
