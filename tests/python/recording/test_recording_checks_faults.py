"""Each fault put into sound recordings is found by its name, and nothing else is."""

from dataclasses import replace

import numpy as np
import pytest

from checks_cases import WHOLE, by_code, codes, damaged, sound_set
from granular_id.recording import Dataset, Recording, SampleFlag

TIMES = np.arange(1600) / 500


@pytest.fixture(scope="module")
def sound():
    return sound_set()


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_sound_sets_raise_no_warning(seed):
    report = sound_set(seed).check()
    assert report.worst == "ok"
    assert codes(report, infos=True) == set()


def clipped(w, _):
    np.minimum(w[:, 0], np.sort(w[:, 0])[1440], out=w[:, 0])


def stuck(w, _):
    w[:, 3] = w[0, 3]


def humming(w, _):
    w[:, 2] += 0.00885 * np.rint(900 * np.sin(2 * np.pi * 150 * TIMES))


def irregular(times, **fields):
    return {"rate_hz": None, "time_s": times - times[0], "trigger_index": None, **fields}


WHERE = np.delete(np.arange(1600), slice(600, 640))
SHAKEN = np.random.default_rng(0).uniform(0, 1, 1600)
AFTER_A_PAUSE = TIMES + 0.4 * (np.arange(1600) >= 800)


@pytest.mark.parametrize(
    ("places", "wrench", "fields", "found", "words"),
    [
        ([7, 30], clipped, {}, "clipped", "on fx"),
        ([7, 30], stuck, {}, "stuck-axis", "(tx)"),
        ([6], None, {"label": None}, "no-label", "has no label"),
        ([6], None, {"rate_hz": 400}, "rates-differ", "2 different rates, 400 to 500 Hz; 1 not at 500"),
        ([6], None, {"rate_hz": 0.5}, "slow rates-differ", "in seconds?"),
        ([6], lambda w, _: w[:, :3], {"axes": ("fx", "fy", "fz")}, "axes-differ", ""),
        ([6], None, {"session": None}, "some-sessions", "1 of 48"),
        (WHOLE, None, {"start_time": None}, "", ""),
        ([6], lambda w, _: w[WHERE], irregular(TIMES[WHERE]), "gaps", "0.082 s in 'rice_06'"),
        ([6], None, irregular(AFTER_A_PAUSE), "gaps", "1 above 0.25 s, which resampling refuses: split"),
        ([6, 20, 33], None, irregular(np.sort(TIMES + 1.8e-3 * SHAKEN)), "jitter", ""),
        ([6, 20, 33], None, irregular(TIMES + 1e-4 * SHAKEN), "", ""),
    ],
)
def test_a_fault_is_found_by_its_name_and_nothing_else(sound, places, wrench, fields, found, words):
    report = damaged(sound, places, wrench, **fields).check()
    assert codes(report) == set(found.split())
    for code in found.split()[:1]:
        finding = by_code(report)[code]
        assert words in finding.message
        assert finding.indices == tuple(places)
        assert finding.recordings == tuple(sound[i].name for i in places)
    states = list(report.states)
    assert states.count(report.worst) == (len(places) if found else len(sound))


def test_labels_that_read_alike_are_found(sound):
    peas = [i for i, r in enumerate(sound) if r.label == "dry peas"]
    for one, other in (("Dry_peas", "dry peas"), ("M\u00fcsli", "Mu\u0308sli")):
        alike = damaged(damaged(sound, peas, label=one), peas[1:2], label=other)
        finding = by_code(alike.check())["labels-alike"]
        assert finding.message.startswith(f"{one!r} and {other!r} differ by case, blanks,")
        assert finding.severity == "warning"


def test_an_outlier_is_found_where_its_label_has_enough_others(sound):
    bad = damaged(sound, [7], humming)
    finding = by_code(bad.check())["outlier"]
    assert finding.recordings == (sound[7].name,)
    assert "roughness of force" in finding.message
    assert finding.values["robust_sd"][sound[7].name] > 10
    few = bad.select(indices=[*range(1, 8), *range(12, 19)])
    assert "outlier" not in codes(few.check())


@pytest.mark.parametrize("factor", [1e3, 1e6])
def test_readings_in_another_unit(sound, factor):
    finding = by_code(damaged(sound, WHOLE, lambda w, _: factor * w).check())["units"]
    assert (finding.severity, finding.indices) == ("warning", tuple(WHOLE))
    assert "are they in mN, N mm or counts?" in finding.message


@pytest.mark.parametrize("meta", [{"units": {"depth": "mm"}}, {}])
def test_other_units_are_their_own_affair(meta):
    rng = np.random.default_rng(0)
    stated = {"axes": ("depth",), "meta": meta}
    depths = 1e4 * rng.normal(size=(6, 50, 1))
    depth = [Recording(one, rate_hz=50, label="ab"[i % 2], **stated) for i, one in enumerate(depths)]
    assert "units" not in codes(Dataset(depth).check())


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
