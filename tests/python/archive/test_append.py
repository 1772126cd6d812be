"""Appends: by many writers, killed and run again, twice the same; what is refused."""

import json
import shutil
import signal
import subprocess
import sys
import threading
from dataclasses import replace

import numpy as np
import pytest

from granular_id.archive import Appended, Archive, append
from granular_id.io import RecordingFileError, load, save
from granular_id.io.parquet import writing
from granular_id.recording import Dataset, Recording, StepReport

pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")

RNG = np.random.default_rng(7)
PUSHES = [
    Recording(RNG.standard_normal((4 + i, 6)), rate_hz=500, label="rice", name=f"push {i}") for i in range(8)
]


def names(folder):
    return Archive(folder).index["name"].to_pylist()


def files(folder):
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


def test_an_append_begins_an_archive(tmp_path):
    assert append(tmp_path / "a", Dataset(PUSHES)) == Appended(8, 0)
    samples, index = sorted((tmp_path / "a").rglob("*.parquet"), reverse=True)
    assert (samples.parent.name, index.parent.name) == ("samples", "recordings")
    assert samples.name == index.name
    assert load(tmp_path / "a") == Dataset(PUSHES)


def test_an_append_follows_what_was_saved(tmp_path):
    save(Dataset(PUSHES[4:]), tmp_path / "a", "parquet")
    assert append(tmp_path / "a", Dataset(PUSHES[2:4])) == Appended(2, 0)
    assert append(tmp_path / "a", Dataset(PUSHES[:2])) == Appended(2, 0)
    wanted = Dataset([*PUSHES[4:], *PUSHES[2:4], *PUSHES[:2]])
    archive = Archive(tmp_path / "a")
    assert load(archive.folder) == wanted
    assert archive.index["id"].to_pylist() == list(range(8))
    assert [r for part in archive for r in part] == list(wanted)
    assert [(g.start, g.stop) for g in archive.row_groups] == [(0, 4), (4, 6), (6, 8)]


def test_appends_stand_in_the_order_in_which_they_were_written(tmp_path, monkeypatch):
    for at, push in ((5.0, PUSHES[0]), (3.0, PUSHES[1]), (4.0, PUSHES[2])):
        monkeypatch.setattr("granular_id.io.parquet.writing.time.time", lambda at=at: at)
        append(tmp_path, Dataset([push]))
    assert names(tmp_path) == ["push 1", "push 2", "push 0"]


def test_the_same_append_twice_is_one(tmp_path):
    append(tmp_path, Dataset(PUSHES))
    before = files(tmp_path)
    assert append(tmp_path, Dataset(PUSHES)) == Appended(0, 8)
    assert files(tmp_path) == before


def test_only_what_is_not_there_is_added(tmp_path):
    append(tmp_path, Dataset(PUSHES[:5]))
    assert append(tmp_path, Dataset([*PUSHES[3:], PUSHES[7]])) == Appended(3, 3)
    assert load(tmp_path) == Dataset(PUSHES)


@pytest.mark.parametrize(
    "change",
    [
        {"wrench": PUSHES[0].wrench + 1},
        {"name": "x"},
        {"label": None},
        {"session": "s"},
        {"start_time": 1.0},
        {"flags": [1] * 4},
    ],
)
def test_another_recording_is_added(tmp_path, change):
    append(tmp_path, Dataset(PUSHES[:1]))
    assert append(tmp_path, Dataset([replace(PUSHES[0], **change)])) == Appended(1, 0)


def test_many_recordings_go_into_several_files(tmp_path, monkeypatch):
    monkeypatch.setattr("granular_id.io.parquet.writing._GROUPS_PER_PART", 2)
    monkeypatch.setattr("granular_id.io.parquet.writing.RECORDINGS_PER_GROUP", 3)
    told = []
    append(tmp_path, Dataset(PUSHES), progress=lambda *step: told.append(step[:2]))
    assert len(files(tmp_path)) == 4
    assert load(tmp_path) == Dataset(PUSHES)
    assert told == [(3, 8), (6, 8), (8, 8)]


def test_history_is_kept_once(tmp_path):
    one, two = (StepReport("load", {"format": name}) for name in ("csv", "npz"))
    append(tmp_path, Dataset(PUSHES[:1], [one]))
    append(tmp_path, Dataset(PUSHES[1:2], [one, two]))
    append(tmp_path, Dataset(PUSHES[2:3]))
    assert list(load(tmp_path).history[:-1]) == [one, two]


def test_threads_append_at_once(tmp_path):
    def add(i):
        append(tmp_path, Dataset(PUSHES[2 * i : 2 * i + 2]))

    threads = [threading.Thread(target=add, args=(i % 4,)) for i in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(names(tmp_path)) == [push.name for push in PUSHES]
    assert len(files(tmp_path)) == 8


def test_of_two_that_append_the_same_the_quicker_one_counts(tmp_path, monkeypatch):
    real = writing._write_part

    def overtaken(*arguments):
        monkeypatch.setattr(writing, "_write_part", real)
        yield from real(*arguments)
        assert append(tmp_path, Dataset(PUSHES)) == Appended(8, 0)

    monkeypatch.setattr(writing, "_write_part", overtaken)
    assert append(tmp_path, Dataset(PUSHES)) == Appended(0, 8)
    assert load(tmp_path) == Dataset(PUSHES)
    assert len(files(tmp_path)) == 2


WRITER = """
import os, signal, sys
import numpy as np
from granular_id.archive import append
from granular_id import _files
from granular_id.io.parquet import writing
from granular_id.recording import Dataset, Recording

folder, when, *numbers = sys.argv[1:]
if when:
    def killed(*_):
        os.kill(os.getpid(), signal.SIGKILL)
    setattr(writing if hasattr(writing, when) else _files, when, killed)
for number in numbers:
    wrench = np.random.default_rng(int(number)).standard_normal((50, 6))
    append(folder, Dataset([Recording(wrench, rate_hz=500, name=number)]))
"""


def writer(folder, *numbers, killed_at=""):
    return subprocess.Popen([sys.executable, "-c", WRITER, str(folder), killed_at, *map(str, numbers)])


def test_processes_append_at_once(tmp_path):
    writers = [writer(tmp_path, *range(10 * i, 10 * i + 10)) for i in range(3)]
    assert [each.wait(60) for each in writers] == [0, 0, 0]
    assert sorted(names(tmp_path), key=int) == [str(i) for i in range(30)]
    assert len(load(tmp_path)) == 30


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="there is no SIGKILL here")
def test_an_append_that_was_killed_is_run_again(tmp_path):
    append(tmp_path, Dataset(PUSHES))
    before = files(tmp_path)
    for when in ("_write_index", "_sync"):  # the samples have their name, and before that
        assert writer(tmp_path, 1, 2, killed_at=when).wait(60) == -signal.SIGKILL
        assert len(Archive(tmp_path).index) == 8
    assert writer(tmp_path, 1, 2).wait(60) == 0
    assert names(tmp_path) == [*(push.name for push in PUSHES), "1", "2"]
    assert len(files(tmp_path)) == len(before) + 4  # no temporary ones


def test_the_first_append_that_was_killed_is_run_again(tmp_path, monkeypatch):
    with monkeypatch.context() as once:
        once.setattr("granular_id.io.parquet.writing._write_index", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            append(tmp_path / "a", Dataset(PUSHES))
    with pytest.raises(RecordingFileError, match="is part of an archive"):
        load(tmp_path / "a", rate_hz=500)
    assert append(tmp_path / "a", Dataset(PUSHES)) == Appended(8, 0)
    assert load(tmp_path / "a") == Dataset(PUSHES)


def test_what_cannot_be_written_leaves_nothing_half_written(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("granular_id._files._sync", full)
    with pytest.raises(
        OSError, match=r"cannot write .*samples/[0-9a-f]{32}.parquet: No space left on device"
    ):
        append(tmp_path / "a", Dataset(PUSHES))
    assert not (tmp_path / "a").exists()


def test_a_process_reads_each_index_file_once(tmp_path, monkeypatch):
    save(Dataset(PUSHES[:1]), tmp_path / "a", "parquet")
    real, opened = writing.open_parquet, []

    def watched(path, *arguments):
        opened.append(path.name)
        return real(path, *arguments)

    monkeypatch.setattr(writing, "open_parquet", watched)
    for push in PUSHES[1:6]:
        assert append(tmp_path / "a", Dataset([push])) == Appended(1, 0)
    assert len(opened) == len(set(opened)) == 5
    opened.clear()
    assert append(tmp_path / "a", Dataset(PUSHES[3:4])) == Appended(0, 1)
    assert len(opened) == 2, "the newest one, and the one that lists it"


def test_what_others_append_meanwhile_is_known(tmp_path):
    append(tmp_path, Dataset(PUSHES[:1]))
    assert writer(tmp_path, 1).wait(60) == 0
    one = Recording(np.random.default_rng(1).standard_normal((50, 6)), rate_hz=500, name="1")
    assert append(tmp_path, Dataset([one, PUSHES[0]])) == Appended(0, 2)


def test_another_archive_in_the_place_of_one_is_not_taken_for_it(tmp_path):
    for make in (append, lambda folder, data: save(data, folder, "parquet")):
        for pushes in (PUSHES[:2], PUSHES[1:3]):
            make(tmp_path / "a", Dataset(pushes))
            n_present = len({one.name for one in pushes} & {"push 0", "push 1"})
            assert append(tmp_path / "a", Dataset(PUSHES[:2])) == Appended(2 - n_present, n_present)
            shutil.rmtree(tmp_path / "a")


def test_what_is_remembered_is_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr(writing, "_MOST_BYTES", 3 * 312 + 100)
    writing._remembered.clear()
    for folder in "abcd":
        for push in PUSHES[:2]:
            append(tmp_path / folder, Dataset([push]))
    assert [path[-1] for path, _ in writing._remembered] == ["b", "c", "d"]
    assert append(tmp_path / "a", Dataset(PUSHES)) == Appended(6, 2)


def test_progress_is_shown_or_told(tmp_path, capsys):
    append(tmp_path / "a", Dataset(PUSHES))
    assert capsys.readouterr().err == ""
    assert append(tmp_path / "b", Dataset(PUSHES), progress=True) == Appended(8, 0)
    with pytest.raises(TypeError, match="progress must be a bool or callable, got int"):
        append(tmp_path / "c", Dataset(PUSHES), progress=1)
    assert not (tmp_path / "c").exists()


def test_other_axes_are_refused(tmp_path):
    append(tmp_path, Dataset(PUSHES))
    other = Recording(np.ones((3, 2)), rate_hz=5, axes=("wx", "ax"))
    with pytest.raises(
        ValueError, match=r"^dataset has the axes wx ax, and the archive .* fx fy fz tx ty tz; add it"
    ):
        append(tmp_path, Dataset([other]))


@pytest.mark.parametrize("place", ["notes.txt", "samples/a.csv", "samples/rice/a.parquet"])
def test_a_folder_of_something_else_is_refused(tmp_path, place):
    (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / place).write_text("x")
    for look in (lambda: append(tmp_path, Dataset(PUSHES)), lambda: writing.check_archive(tmp_path)):
        with pytest.raises(FileExistsError, match=f"holds '{place[:7]}.*'; wanted an archive, or a new"):
            look()
    assert files(tmp_path) == [place]


def test_what_a_look_or_an_append_that_was_killed_leaves_is_no_hindrance(tmp_path):
    (tmp_path / "samples").mkdir()
    for place in (f".recordings-{'0' * 16}.parquet", f"samples/{'0' * 32}.parquet"):
        (tmp_path / place).touch()
    writing.check_archive(tmp_path, PUSHES[0].axes)
    assert append(tmp_path, Dataset(PUSHES)) == Appended(8, 0)


def test_a_file_is_refused(tmp_path):
    (tmp_path / "a").write_text("x")
    with pytest.raises(FileExistsError, match="is a file; wanted an archive"):
        append(tmp_path / "a", Dataset(PUSHES))


def rewrite_mark(path, **changes):
    table, labels = pq.ParquetFile(path).read(), dict(pq.read_metadata(path).metadata)
    labels[b"granular_id"] = json.dumps({**json.loads(labels[b"granular_id"]), **changes}).encode()
    pq.write_table(table.replace_schema_metadata(labels), path)


@pytest.mark.parametrize("written", [None, "now", True, float("nan")])
def test_an_index_file_says_when_it_was_written(tmp_path, written):
    append(tmp_path, Dataset(PUSHES))
    rewrite_mark(next((tmp_path / "recordings").iterdir()), written=written)
    with pytest.raises(
        RecordingFileError, match=r"footer: .* says that it was written at .*; wanted seconds"
    ):
        Archive(tmp_path)


def test_an_index_file_of_other_axes_is_refused(tmp_path):
    for folder in ("a", "b"):
        axes = ("fx", "fy", "fz", "tx", "ty", "tz") if folder == "a" else tuple("abcdef")
        append(tmp_path / folder, Dataset([replace(PUSHES[0], axes=axes)]))
    index = next((tmp_path / "b" / "recordings").iterdir())
    index.rename(tmp_path / "a" / "recordings" / index.name)
    with pytest.raises(RecordingFileError, match="lists other axes"):
        Archive(tmp_path / "a")


def test_an_index_file_lists_only_its_own_samples(tmp_path):
    append(tmp_path, Dataset(PUSHES))
    index = next((tmp_path / "recordings").iterdir())
    index.rename(index.with_name("0" * 32 + ".parquet"))
    with pytest.raises(
        RecordingFileError, match=r"column file: row 0 holds 'samples/.*wanted samples/0{32}.parquet"
    ):
        Archive(tmp_path)
