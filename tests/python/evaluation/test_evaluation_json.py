"""Results written and read back: equal in everything; a file that is anything else is one clear error."""

import copy
import json
import re

import numpy as np
import pytest

from evaluation_cases import SMALL, make_data
from granular_id._files import json_value
from granular_id.evaluation import EvaluationResult, evaluate
from granular_id.evaluation.result import FORMAT


@pytest.fixture(scope="module")
def result():
    return evaluate(make_data(), ["raw+hfmh", "raw"], **{**SMALL, "controls": True})


@pytest.fixture(scope="module")
def saved(result, tmp_path_factory):
    path = tmp_path_factory.mktemp("json") / "result.json"
    result.to_json(path)
    return json.loads(path.read_text(encoding="utf-8"))


def test_what_is_read_back_equals_what_was_written(result, tmp_path):
    path = tmp_path / "result.json"
    result.to_json(path)
    read = EvaluationResult.from_json(path)
    assert read.to_dict() == result.to_dict()
    assert list(read.predictions()) == list(result.predictions())
    assert str(read) == str(result)
    assert repr(read) == repr(result)
    assert read.controls == result.controls
    assert read.wall_s == result.wall_s
    assert json_value(read.portrait) == json_value(result.portrait)
    assert read.spaces == result.spaces
    assert read.comparison().pairs == result.comparison().pairs
    for protocol, partitions in result.partitions.items():
        for one, other in zip(read.partitions[protocol], partitions, strict=True):
            assert (one.protocol, one.index, one.description) == (
                other.protocol,
                other.index,
                other.description,
            )
            np.testing.assert_array_equal(one.train, other.train)
            np.testing.assert_array_equal(one.test, other.test)
            assert one.train.dtype == other.train.dtype
    assert read.truth.dtype == result.truth.dtype
    read.to_json(tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == path.read_bytes()


def test_what_is_missing_is_read_back_as_missing(tmp_path):
    bare = evaluate(make_data(), "raw", "kfold", **SMALL)
    bare = EvaluationResult(**{**vars(bare), "portrait": None, "wall_s": float("nan")})
    bare.to_json(tmp_path / "r.json")
    read = EvaluationResult.from_json(tmp_path / "r.json")
    assert read.portrait is None
    assert np.isnan(read.wall_s)
    assert read.controls == ()
    assert read.gap("raw") is None


def put(*path_and_value):
    *path, last, value = path_and_value

    def change(saved):
        place = saved
        for step in path:
            place = place[step]
        place[last] = value

    return change


def drop(*path):
    def change(saved):
        place = saved
        for step in path[:-1]:
            place = place[step]
        del place[path[-1]]

    return change


BAD = [
    (drop("format"), "has format None, wanted 'granular_id.evaluation/2'"),
    (put("format", "granular_id.evaluation/1"), "has format 'granular_id.evaluation/1', wanted"),
    (drop("labels"), "must hold 'labels'"),
    (drop("recordings", 0, "name"), "must hold 'name'"),
    (drop("spaces", 1, "protocols", "paper"), "must hold 'paper'"),
    (drop("spaces", 0, "protocols", "paper", "predicted"), "must hold 'predicted'"),
    (drop("spaces", 0, "seconds", "gram"), "must hold 'gram'"),
    (drop("portrait"), "must hold 'portrait'"),
    (drop("portrait", "mean"), "must hold 'mean'"),
    (put("portrait", {}), "portrait must hold"),
    (drop("settings", "seed"), "must hold 'seed'"),
    (drop("data", "summary"), "must hold 'summary'"),
    (put("recordings", 3, "label", "salt"), "does not hold a whole evaluation"),
    (put("spaces", []), "no space or no partition"),
    (put("partitions", {}), "no space or no partition"),
    (put("partitions", "paper", []), "no space or no partition"),
    (put("partitions", "paper", 1, "test", ["x"]), "does not hold a whole evaluation"),
    (
        put("spaces", 0, "protocols", "paper", "predicted", []),
        "predictions of 'raw+hfmh', paper, do not fit the partitions",
    ),
    (
        put("spaces", 0, "protocols", "paper", "predicted", 1, [0, 1]),
        "predictions of 'raw+hfmh', paper, do not fit the partitions",
    ),
    *[
        (
            put("spaces", 0, "protocols", "paper", "predicted", 0, 0, code),
            "predictions of 'raw+hfmh', paper: wanted whole numbers from 0 to",
        )
        for code in (99, -1, 10**30, 1.5, "1")
    ],
    (
        put("partitions", "paper", 0, "test", 0, 999),
        "paper partition 0, test: wanted whole numbers from 0 to",
    ),
    (
        lambda saved: saved["partitions"]["paper"][0].update(train=saved["partitions"]["paper"][0]["test"]),
        "paper partition 0 has a recording twice",
    ),
    (put("partitions", "paper", 1, "index", 7), "paper partition 1 has index 7"),
    (put("notes", [1]), "notes[0] must be text"),
    (put("partitions", "zz", [{}]), "there is no protocol 'zz'"),
    (put("recordings", 3, "label", "pepper"), "label 'pepper' of a recording is not among the labels"),
    (put("spaces", 0, "seconds", None), "does not hold a whole evaluation"),
    (put("portrait", "weights", 0, "influence", "much"), "does not hold a whole evaluation"),
    (put("controls", 0, "accuracies", None), "does not hold a whole evaluation"),
]


@pytest.mark.parametrize(("change", "message"), BAD, ids=[message for _, message in BAD])
def test_a_file_that_was_changed_is_refused(saved, tmp_path, change, message):
    broken = copy.deepcopy(saved)
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
        (b"null", "has format None"),
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
