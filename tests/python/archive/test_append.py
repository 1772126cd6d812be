"""Appends: by many writers, killed and run again, twice the same; what is refused."""

import json
import signal
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from archive_cases import index_in, rewrite
from granular_id.archive import Appended, Archive, append, check
from granular_id.io import RecordingFileError, load, save
from granular_id.io.parquet import writing
from granular_id.io.parquet.writing import Appender
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


def test_append_begins_an_archive(tmp_path):
    assert append(tmp_path / "a", Dataset(PUSHES)) == Appended(8, 0)
    index, samples = files(tmp_path / "a")
    assert (index[:11], samples[:13]) == ("recordings-", "samples/part-")
    assert index[11:] == samples[13:]
    assert load(tmp_path / "a") == Dataset(PUSHES)


def test_append_follows_what_was_saved(tmp_path):
    save(Dataset(PUSHES[4:]), tmp_path / "a", "parquet")
    assert append(tmp_path / "a", Dataset(PUSHES[2:4])) == Appended(2, 0)
    assert append(tmp_path / "a", Dataset(PUSHES[:2])) == Appended(2, 0)
    wanted = Dataset([*PUSHES[4:], *PUSHES[2:4], *PUSHES[:2]])
    archive = Archive(tmp_path / "a")
    assert load(archive.folder) == wanted
    assert [r for part in archive for r in part] == list(wanted)
    assert [(g.start, g.stop) for g in archive.row_groups] == [(0, 4), (4, 6), (6, 8)]


def test_appends_stand_in_the_order_in_which_they_were_written(tmp_path, monkeypatch):
    for at, push in ((5.0, PUSHES[0]), (3.0, PUSHES[1]), (4.0, PUSHES[2])):
        monkeypatch.setattr("granular_id.io.parquet.writing.time.time", lambda at=at: at)
        append(tmp_path, Dataset([push]))
    assert names(tmp_path) == ["push 1", "push 2", "push 0"]


def test_same_append_twice_is_one(tmp_path):
    append(tmp_path, Dataset(PUSHES))
    before = files(tmp_path)
    assert append(tmp_path, Dataset(PUSHES)) == Appended(0, 8)
    assert files(tmp_path) == before


def test_append_adds_only_what_is_not_there(tmp_path):
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
def test_recording_that_differs_is_added(tmp_path, change):
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


def test_history_that_appends_share_is_kept_once(tmp_path):
    one, two = (StepReport("load", {"format": name}) for name in ("csv", "npz"))
    append(tmp_path, Dataset(PUSHES[:1], [one]))
    append(tmp_path, Dataset(PUSHES[1:2], [one, two]))
    append(tmp_path, Dataset(PUSHES[2:3]))
    assert list(load(tmp_path).history[:-1]) == [one, two]


def test_of_two_that_append_the_same_the_quicker_counts(tmp_path, monkeypatch):
    real = writing._write_samples

    def overtaken(*arguments):
        monkeypatch.setattr(writing, "_write_samples", real)
        yield from real(*arguments)
        assert append(tmp_path, Dataset(PUSHES)) == Appended(8, 0)

    monkeypatch.setattr(writing, "_write_samples", overtaken)
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
def test_append_that_was_killed_is_run_again(tmp_path):
    append(tmp_path, Dataset(PUSHES))
    for when in ("_write_index", "_sync"):  # the samples have their name, and before that
        assert writer(tmp_path, 1, 2, killed_at=when).wait(60) == -signal.SIGKILL
        assert len(Archive(tmp_path).index) == 8
    assert writer(tmp_path, 1, 2).wait(60) == 0
    assert names(tmp_path) == [*(push.name for push in PUSHES), "1", "2"]
    report = check(tmp_path, progress=False)
    assert (report.ok, len(report.leftovers)) == (True, 2), "temporary ones"


def test_first_append_that_was_killed_is_run_again(tmp_path, monkeypatch):
    with monkeypatch.context() as once:
        once.setattr("granular_id.io.parquet.writing._write_index", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            append(tmp_path / "a", Dataset(PUSHES))
    with pytest.raises(RecordingFileError, match=r"is no archive: no recordings-\*.parquet lies in it"):
        Archive(tmp_path / "a")
    assert append(tmp_path / "a", Dataset(PUSHES)) == Appended(8, 0)
    assert load(tmp_path / "a") == Dataset(PUSHES)


def test_append_to_a_full_disk_leaves_nothing_half_written(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("granular_id._files._sync", full)
    with pytest.raises(
        OSError, match=r"cannot write .*samples/part-[0-9a-f]{32}.parquet: No space left on device"
    ):
        append(tmp_path / "a", Dataset(PUSHES))
    assert not (tmp_path / "a").exists()


def test_appender_reads_each_index_file_once(tmp_path, monkeypatch):
    append(tmp_path, Dataset(PUSHES[:1]))
    real, opened = writing.open_parquet, []

    def watched(path, *arguments):
        opened.append(path.name)
        return real(path, *arguments)

    monkeypatch.setattr(writing, "open_parquet", watched)
    appender = Appender(tmp_path)
    for push in (*PUSHES[1:6], PUSHES[3]):
        appender.append(Dataset([push]))
    assert names(tmp_path) == [one.name for one in PUSHES[:6]]
    assert len(opened) == len(set(opened)) == 6


def test_appender_knows_what_others_append_meanwhile(tmp_path):
    append(tmp_path, Dataset(PUSHES[:1]))
    appender = Appender(tmp_path)
    assert writer(tmp_path, 1).wait(60) == 0
    one = Recording(np.random.default_rng(1).standard_normal((50, 6)), rate_hz=500, name="1")
    assert appender.append(Dataset([one, PUSHES[0]])) == Appended(0, 2)
    for path in tmp_path.glob("recordings-*"):
        path.unlink()
    assert appender.append(Dataset(PUSHES)) == Appended(8, 0), "another archive in its place"


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
def test_folder_of_something_else_is_refused(tmp_path, place):
    (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / place).write_text("x")
    for look in (lambda: append(tmp_path, Dataset(PUSHES)), lambda: Appender(tmp_path)):
        with pytest.raises(FileExistsError, match=f"holds '{place[:7]}.*'; wanted an archive, or a new"):
            look()
    assert files(tmp_path) == [place]


def test_what_a_killed_append_leaves_is_no_hindrance(tmp_path):
    (tmp_path / "samples").mkdir()
    for place in (f".recordings-{'0' * 16}.parquet", f"samples/part-{'0' * 32}.parquet"):
        (tmp_path / place).touch()
    Appender(tmp_path, PUSHES[0].axes)
    assert append(tmp_path, Dataset(PUSHES)) == Appended(8, 0)


def test_append_to_a_file_is_refused(tmp_path):
    (tmp_path / "a").write_text("x")
    with pytest.raises(NotADirectoryError, match="is or lies in a file"):
        append(tmp_path / "a", Dataset(PUSHES))


@pytest.mark.parametrize("written", [None, "now", {}])
def test_index_file_says_when_it_was_written(tmp_path, written):
    append(tmp_path, Dataset(PUSHES))
    path = index_in(tmp_path)
    mark = json.loads(pq.read_metadata(path).metadata[b"granular_id"])
    rewrite(path, labels={"granular_id": json.dumps({**mark, "written": written})})
    with pytest.raises(RecordingFileError, match=r"recordings-.*: reading its columns failed with"):
        Archive(tmp_path)


def test_index_file_of_other_axes_is_refused(tmp_path):
    for folder, axes in (("a", None), ("b", tuple("abcdef"))):
        append(tmp_path / folder, Dataset([replace(PUSHES[0], axes=axes or PUSHES[0].axes)]))
    index = index_in(tmp_path / "b")
    index.rename(tmp_path / "a" / index.name)
    with pytest.raises(RecordingFileError, match="lists other axes"):
        Archive(tmp_path / "a")


def test_index_file_lists_only_its_own_samples(tmp_path):
    append(tmp_path, Dataset(PUSHES))
    index_in(tmp_path).rename(tmp_path / f"recordings-{'0' * 32}.parquet")
    with pytest.raises(RecordingFileError, match=r"samples/part-0{32}.parquet: cannot be read: No such file"):
        load(tmp_path)
