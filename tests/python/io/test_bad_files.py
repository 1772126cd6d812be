"""More than a thousand bad files of all formats through ``load``: refused by name, in bounds, and the rest loads.

Processes of their own load them (see ``bad_files_work.py``); ``benches/bad_files.py`` shows seconds and memory of each.
"""

import os
import re

import pytest

pytest.importorskip("resource", reason="memory is measured and limited as POSIX systems do")
pytest.importorskip("h5py")
pytest.importorskip("mcap")
pytest.importorskip("pyarrow")
pytest.importorskip("rosbags")

from bad_bags import bag_cases
from bad_borrowed import borrowed_cases
from bad_containers import container_cases
from bad_contents import content_cases
from bad_files import common_cases, make_corpus
from bad_files_work import MOST_MEGABYTES, answers_to
from bad_folders import folder_cases
from bad_parquet import parquet_cases
from good_files import PATHS, write_good

GROUPS = {
    "what any file may be": common_cases,
    "contents": content_cases,
    "containers": container_cases,
    "large bags": bag_cases,
    "Parquet": parquet_cases,
    "folders and names": folder_cases,
    "the tests of single formats": borrowed_cases,
}
LONGEST_PROBLEM = 600
"""Characters that fit a few lines of a terminal."""

TELLING = re.compile(
    r"wanted|at most|more than|must|is not |are not |(is|has|holds|are) no |no column|cut off|is empty|twice|both|"
    r"too deeply|[a-z_]+=[^ ]+ |, but |Save it as|Say what|for [0-9]+ recordings|holds two|reads .*[0-9]|"
    r"control character|ends with a space|save an |damaged \w+: |cannot be [a-zA-Z ]+[:(]|links out"
)
"""What problems without a place in the file say: what is wanted, what is missing, what is too much, or the reason."""


@pytest.fixture(scope="module")
def everything(tmp_path_factory):
    """Return by group the bad files and what came of loading each."""
    found = {}
    for group, cases in GROUPS.items():
        found[group] = make_corpus(tmp_path_factory.mktemp("bad"), dict(cases()))
    files = [file for group in found.values() for file in group]
    answers = iter(answers_to([file.job() for file in files], at_once=16))
    return {group: list(zip(files, answers, strict=False)) for group, files in found.items()}


@pytest.fixture(params=GROUPS)
def loaded(request, everything):
    """Return those of one group."""
    return everything[request.param]


def test_no_process_hangs_or_dies(loaded):
    assert [file.name for file, answer in loaded if "broken" in answer] == []


def test_each_is_refused_by_the_one_exception(loaded):
    assert [
        (file.name, came.get("error", "was loaded"), came.get("message", ""))
        for file, came in _alone(loaded)
        if came.get("error", "" if file.case.refused else "RecordingFileError") != "RecordingFileError"
    ] == []


def test_messages_are_one_line_with_file_and_place(loaded):
    refused = [(file, came) for file, came in _alone(loaded) if came.get("error") == "RecordingFileError"]
    wrong = [(file.name, why) for file, came in refused if (why := _wrong_with(file, came))]
    assert wrong == []


def _wrong_with(file, came):
    """Say what a message lacks."""
    message, problem = came["message"], came["problem"]
    if not message.isprintable():
        return f"not one printable line: {message!r}"
    if not came["file"].startswith(os.fspath(file.path).encode("utf-8", "backslashreplace").decode()):
        return f"names {came['file']}"
    if len(problem) > LONGEST_PROBLEM:
        return f"{len(problem)} characters"
    placed = any(came[key] is not None for key in ("line", "column", "place"))
    return "" if placed or TELLING.search(problem) else f"neither place nor wish: {message}"


def test_the_rest_of_the_folder_loads_and_the_bad_file_is_listed(loaded):
    wrong = []
    for file, answer in loaded:
        if file.case.whole or not file.case.refused:
            continue
        beside = answer["beside"]
        if "error" in beside:
            wrong.append((file.name, beside["message"]))
        elif file.case.listed and not any(_is_of(file, text) for text in beside["skipped"]):
            wrong.append((file.name, "not listed", beside["skipped"]))
        elif not beside["names"]:
            wrong.append((file.name, "nothing was loaded"))
    assert wrong == []


def _is_of(file, text):
    """Tell whether a line of a report is about a file."""
    place = os.fspath(file.bad).encode("utf-8", "backslashreplace").decode()
    return text.startswith("".join(c if c.isprintable() else ascii(c)[1:-1] for c in place))


def test_an_index_that_is_bad_as_a_whole_is_refused_even_with_skip(loaded):
    whole = [(file, answer["beside"]) for file, answer in loaded if file.case.whole]
    assert [
        f.name for f, came in whole if came.get("error", "RecordingFileError") != "RecordingFileError"
    ] == []
    assert [f.name for f, came in whole if "error" not in came and not came["skipped"]] == []


def test_memory_stays_in_bounds(loaded):
    assert [
        (f.name, answer["megabytes"]) for f, answer in loaded if answer["megabytes"] > MOST_MEGABYTES
    ] == []


def test_nothing_is_warned_of_written_or_opened_outside(loaded):
    for what in ("warnings", "done", "outside"):
        assert [(file.name, answer[what]) for file, answer in loaded if answer[what]] == []


def test_an_unreadable_file(tmp_path):
    if os.geteuid() == 0:
        pytest.skip("root may read everything")
    from granular_id.io import RecordingFileError, load

    for kind in ("csv", "npz", "hdf5", "mat v7", "mat v7.3", "parquet", "mcap", "ros1", "db3"):
        path = write_good(kind, tmp_path / kind)
        path.chmod(0)
        with pytest.raises(RecordingFileError, match="cannot be read: Permission denied"):
            load(path)


def test_the_good_files_are_good(tmp_path):
    from granular_id.io import load

    for kind in PATHS:
        (tmp_path / kind).mkdir()
        data = load(write_good(kind, tmp_path / kind), rate_hz=500 if kind == "npy" else None)
        assert data[0].n_samples == 40
        assert data[0].rate_hz == 500


def _alone(loaded):
    return [(file, answer["alone"]) for file, answer in loaded]
