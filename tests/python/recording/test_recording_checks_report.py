"""The report: what it prints, what it says of each recording, and what can be saved of it."""

import json
import pickle

import numpy as np
import pytest

from checks_cases import by_code, codes, damaged, sound_set
from granular_id.recording import CheckReport, Dataset, Finding, Recording, Verdict
from robot_failures import load_failures


@pytest.fixture(scope="module")
def report():
    data = damaged(sound_set(), [2], label=None)

    def stuck(w, _):
        w[:, 0] = 1.0

    return damaged(data, range(10, 15), stuck).check()


def test_worst_first_with_a_verdict_each(report):
    assert [finding.severity for finding in report] == ["error", "warning", "info"]
    assert report.worst == "error"
    assert report.counts == {"no-label": 1, "stuck-axis": 5, "uneven": 48}
    assert report.verdicts[2] == Verdict("rice_02", "error", ("no-label",))
    assert report.verdicts[10] == Verdict("rice_10", "warning", ("stuck-axis",))
    assert report.verdicts[0] == Verdict("rice_00", "ok")
    assert len(report.verdicts) == 48


def test_it_is_a_sequence(report):
    assert len(report) == 3
    assert report[0].code == "no-label"
    assert report[1:3] == (report[1], report[2])
    assert report[0] in report
    assert bool(report)
    empty = CheckReport((), (Verdict("a", "ok"),))
    assert not empty
    assert empty.worst == "ok"
    assert str(empty) == "1 recording checked: 1 ok: nothing found that would spoil an evaluation"


def test_the_text_is_short_and_leads_with_the_worst(report):
    lines = str(report).splitlines()
    assert lines[0] == "48 recordings checked: 42 ok, 5 with warnings, 1 with errors"
    assert lines[2].split() == ["error", "no-label", "1", "recording", "has", "no", "label"]
    assert lines[3].strip() == "[rice_02]"
    assert lines[5].startswith("warning  stuck-axis  5 recordings with an axis that never changes (fx)")
    assert lines[6].strip() == "[rice_10, rice_11, dry_peas_00, ...]"
    assert all(len(line) <= 100 for line in lines)
    assert max(map(len, report.text(width=70).splitlines())) <= 70


def test_it_can_be_saved(report, tmp_path):
    report.save(tmp_path / "check.json")
    saved = json.loads((tmp_path / "check.json").read_text(encoding="utf-8"))
    assert saved == report.to_dict() == json.loads(report.to_json())
    assert set(saved) == {"worst", "counts", "findings", "verdicts"}
    assert saved["findings"][1]["indices"] == [10, 11, 12, 13, 14]
    assert saved["verdicts"][2] == {"name": "rice_02", "state": "error", "codes": ["no-label"]}
    report.save(tmp_path / "check.txt")
    assert (tmp_path / "check.txt").read_text(encoding="utf-8") == f"{report}\n"


def test_it_can_be_pickled(report):
    assert pickle.loads(pickle.dumps(report)) == report


def test_findings_are_frozen_and_compare():
    finding = Finding("info", "x", "text", ("a",), (0,), {"share": np.float64(0.5)})
    assert finding == Finding("info", "x", "text", ("a",), (0,), {"share": 0.5})
    assert len({finding, finding}) == 1
    with pytest.raises(TypeError):
        finding.values["share"] = 1


def test_recordings_of_one_name_have_verdicts_of_their_own():
    rng = np.random.default_rng(0)
    data = Dataset(
        [Recording(rng.normal(size=(99, 6)) * (i != 1), rate_hz=9, label="ab"[i % 2]) for i in range(4)]
    )
    assert [verdict.state for verdict in data.check().verdicts] == ["ok", "warning", "ok", "ok"]


@pytest.mark.parametrize("shape", [(1, 6), (2, 6), (3, 1), (1, 1)])
def test_tiny_recordings_are_judged_without_a_stumble(shape):
    rng = np.random.default_rng(0)
    axes = None if shape[1] == 6 else ("force",)
    for n in (1, 12):
        recordings = [
            Recording(rng.normal(size=shape), rate_hz=100, label="ab"[i % 2], axes=axes or ())
            for i in range(n)
        ]
        assert {verdict.state for verdict in Dataset(recordings).check().verdicts} == {"ok"}


def test_constant_recordings_are_judged_without_a_stumble():
    same = [Recording(np.full((200, 6), float(i)), rate_hz=100, label="ab"[i % 2]) for i in range(24)]
    assert "stuck-axis" in codes(Dataset(same).check(sensor_range=100))


@pytest.mark.data
def test_the_robot_failures_are_coarse_and_short(data_dir):
    report = load_failures(data_dir / "robot_failures", "lp1").check()
    assert codes(report) <= {"no-session", "stuck-axis", "outlier", "near-duplicates", "units"}
    assert by_code(report)["stuck-axis"].values["axes"] == ("tz",)


def test_readings_that_no_sensor_gives_are_refused_before_they_overflow(report):
    wrench = np.random.default_rng(0).normal(size=(12, 50, 6))
    wrench[5] *= 1e300
    data = Dataset(
        Recording(wrench[i], rate_hz=100, label="ab"[i % 2], session=str(i), name=str(i)) for i in range(12)
    )
    with np.errstate(all="raise"):
        found = data.check()
    assert [finding.code for finding in found] == ["beyond-range"]
    assert found[0].indices == (5,)
    assert found[0].message.startswith("1 recording with readings above 1e+100")


def test_whole_numbers_too_large_for_a_float_are_texts_like_any_other():
    stamps = np.arange(50) / 100 + np.random.default_rng(0).uniform(0, 1e-3, 50)
    meta = {"serial": 10**400, "rate_hz": 10**400}
    data = Dataset(
        Recording(
            np.random.default_rng(i).normal(size=(50, 6)),
            time_s=stamps - stamps[0],
            label="ab"[i % 2],
            session=str(i),
            meta=meta if i % 2 else {},
            name=str(i),
        )
        for i in range(12)
    )
    assert "leak-meta" in data.check().counts


def test_every_step_is_told():
    told = []
    sound_set().check(progress=lambda *step: told.append(step))
    assert [(done, total) for done, total, _ in told] == [(i, len(told)) for i in range(1, len(told) + 1)]
    assert {"copies", "leaks", "outliers"} <= {what for *_, what in told}
