"""Results written and read back: equal in everything; a file that is anything else is one clear error."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from granular_id._files import json_value
from granular_id.evaluation import EvaluationResult
from granular_id.evaluation.result import FORMAT
from granular_id.recording import Finding


@pytest.fixture(scope="module")
def written(evaluated, tmp_path_factory):
    path = tmp_path_factory.mktemp("json") / "result.json"
    evaluated.to_json(path)
    return path


def test_what_is_read_back_equals_what_was_written(evaluated, written, tmp_path):
    read = EvaluationResult.from_json(written)
    assert read.to_dict() == evaluated.to_dict()
    assert list(read.predictions()) == list(evaluated.predictions())
    assert (str(read), repr(read)) == (str(evaluated), repr(evaluated))
    assert (read.controls, read.spaces, read.wall_s) == (
        evaluated.controls,
        evaluated.spaces,
        evaluated.wall_s,
    )
    assert json_value(read.report_data) == json_value(evaluated.report_data)
    assert read.comparison().pairs == evaluated.comparison().pairs
    assert read.truth.dtype == evaluated.truth.dtype
    for protocol, partitions in evaluated.partitions.items():
        for one, other in zip(read.partitions[protocol], partitions, strict=True):
            assert (one.protocol, one.index, one.description) == (protocol, other.index, other.description)
            np.testing.assert_array_equal(one.train, other.train, strict=True)
            np.testing.assert_array_equal(one.test, other.test, strict=True)
    read.to_json(tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == written.read_bytes()


def test_what_is_missing_is_read_back_as_missing(evaluated, tmp_path):
    partitions = {"paper": evaluated.partitions["paper"]}
    bare = replace(evaluated, report_data=None, wall_s=float("nan"), controls=(), partitions=partitions)
    bare.to_json(tmp_path / "r.json")
    read = EvaluationResult.from_json(tmp_path / "r.json")
    assert read.report_data is None
    assert np.isnan(read.wall_s)
    assert read.controls == ()
    assert read.gap("raw") is None


def test_findings_are_read_back_and_files_without_them_are_read(evaluated, tmp_path):
    values = {"pairs": [[0, 3]], "share": 0.5}
    finding = Finding("error", "duplicates", "1 recording holds another", ("oat_0",), (0,), values)
    found = replace(evaluated, findings=(finding,))
    found.to_json(tmp_path / "r.json")
    read = EvaluationResult.from_json(tmp_path / "r.json")
    assert read.findings == (finding,)
    saved = json.loads((tmp_path / "r.json").read_text(encoding="utf-8"))
    del saved["findings"]
    (tmp_path / "old.json").write_text(json.dumps(saved), encoding="utf-8")
    assert EvaluationResult.from_json(tmp_path / "old.json").findings == ()


MISSING = object()


def put(*path, value=MISSING):
    """Return a change of what stands in a stored result: another value, or nothing."""

    def change(saved):
        place = saved
        for step in path[:-1]:
            place = place[step]
        if value is MISSING:
            del place[path[-1]]
        else:
            place[path[-1]] = value

    return change


def predicted(*path, value=MISSING):
    return put("spaces", 0, "protocols", "paper", "predicted", *path, value=value)


NO_EVALUATION = "does not hold a whole evaluation"
NO_FIT = "predictions of 'raw+hfmh', paper, do not fit the partitions"
BAD = [
    (put("format", value="granular_id.evaluation/2"), "has format 'granular_id.evaluation/2', wanted"),
    (put("recordings", 0, "name"), "must hold 'name'"),
    (predicted(), "must hold 'predicted'"),
    (put("portrait", "mean"), "must hold 'mean'"),
    (put("settings", "seed"), "must hold 'seed'"),
    (put("recordings", 3, "label", value="salt"), NO_EVALUATION),
    (put("partitions", "paper", 1, "test", value=["x"]), NO_EVALUATION),
    (put("portrait", "weights", 0, "influence", value="much"), NO_EVALUATION),
    (put("controls", 0, "accuracies", value=None), NO_EVALUATION),
    (put("spaces", value=[]), "no space or no partition"),
    (put("partitions", "paper", value=[]), "no space or no partition"),
    (predicted(1, value=[0, 1]), NO_FIT),
    *[
        (predicted(0, 0, value=code), "'raw+hfmh', paper: wanted whole numbers from 0 to")
        for code in (99, -1, 10**30, 1.5, "1")
    ],
    (
        put("partitions", "paper", 0, "test", 0, value=999),
        "paper partition 0, test: wanted whole numbers from",
    ),
    (
        put("partitions", "paper", 0, "train", value=list(range(40))),
        "paper partition 0 has a recording twice",
    ),
    (put("partitions", "paper", 1, "index", value=7), "paper partition 1 has index 7"),
    (put("partitions", "zz", value=[{}]), "there is no protocol 'zz'"),
    (put("notes", value=[1]), "notes[0] must be text"),
]


@pytest.mark.parametrize(("change", "message"), BAD)
def test_a_file_that_was_changed_is_refused(written, tmp_path, change, message):
    broken = json.loads(written.read_text(encoding="utf-8"))
    change(broken)
    path = tmp_path / "broken.json"
    path.write_text(json.dumps(broken), encoding="utf-8")
    with pytest.raises(ValueError, match=rf"^{re.escape(str(path))} .*{re.escape(message)}"):
        EvaluationResult.from_json(path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is no JSON"),
        (b"protocol,partition,space\n", "is no JSON"),
        (b"\xff\xfe\x00", "is no JSON"),
        (b"[" * 100_000, "is no JSON"),
        (b"[1, 2]", "has format None"),
        (json.dumps({"format": FORMAT}).encode(), "does not hold"),
    ],
)
def test_another_file_is_refused(tmp_path, content, message):
    path = tmp_path / "other.json"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=rf"^{re.escape(str(path))} {message}"):
        EvaluationResult.from_json(path)


def test_a_file_that_is_not_there_is_an_os_error(tmp_path):
    with pytest.raises(FileNotFoundError):
        EvaluationResult.from_json(tmp_path / "absent.json")
