"""Appends: by many writers, killed and run again, twice the same; what is refused."""

import signal
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from archive_cases import index_in
from granular_id.archive import Appended, Archive, append, check
from granular_id.io import RecordingFileError, load, save
from granular_id.io.parquet import writing
from granular_id.io.parquet.writing import Appender
from granular_id.recording import Dataset, Recording, StepReport

pytest.importorskip("pyarrow.parquet")

RNG = np.random.default_rng(7)
PUSHES = [
    Recording(RNG.standard_normal((4 + i, 6)), rate_hz=500, label="rice", name=f"push {i}") for i in range(8)
]


def names(folder):
    return Archive(folder).index["name"].to_pylist()


def files(folder):
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


def test_append_begins_and_continues_an_archive(tmp_path):
    assert append(tmp_path / "a", Dataset(PUSHES[4:])) == Appended(4, 0)
    index, samples = files(tmp_path / "a")
    assert (index[:11], samples[:13], index[11:]) == ("recordings-", "samples/part-", samples[13:])
    assert append(tmp_path / "a", Dataset(PUSHES[2:4])) == Appended(2, 0)
    assert append(tmp_path / "a", Dataset(PUSHES[:2])) == Appended(2, 0)
    wanted = [*PUSHES[4:], *PUSHES[2:4], *PUSHES[:2]]
    archive = Archive(tmp_path / "a")
    assert load(archive.folder) == Dataset(wanted)
    assert [r for part in archive for r in part] == wanted
    assert [(g.start, g.stop) for g in archive.row_groups] == [(0, 4), (4, 6), (6, 8)]


def test_appends_stand_in_the_order_of_their_clocks(tmp_path, monkeypatch):
    for at, push in ((5.0, PUSHES[0]), (3.0, PUSHES[1]), (4.0, PUSHES[2])):
        monkeypatch.setattr("granular_id.io.parquet.writing.time.time", lambda at=at: at)
        append(tmp_path, Dataset([push]))
    assert names(tmp_path) == ["push 1", "push 2", "push 0"]


def test_append_adds_only_what_is_not_there(tmp_path):
    save(Dataset(PUSHES[:5]), tmp_path / "a", "parquet")
    before = files(tmp_path)
    assert append(tmp_path / "a", Dataset(PUSHES[:5])) == Appended(0, 5)
    assert files(tmp_path) == before
    assert append(tmp_path / "a", Dataset([*PUSHES[3:], PUSHES[7]])) == Appended(3, 3)
    assert load(tmp_path / "a") == Dataset(PUSHES)


@pytest.mark.parametrize(
    "change",
    [
        {"wrench": PUSHES[0].wrench + 1},
        *({"name": "x"}, {"label": None}, {"session": "s"}, {"start_time": 1.0}, {"flags": [1] * 4}),
    ],
    ids=lambda change: next(iter(change)),
)
def test_append_adds_a_recording_that_differs(tmp_path, change):
    append(tmp_path, Dataset(PUSHES[:1]))
    assert append(tmp_path, Dataset([replace(PUSHES[0], **change)])) == Appended(1, 0)


def test_history_that_appends_share_is_held_once(tmp_path):
    one, two = (StepReport("load", {"format": name}) for name in ("csv", "npz"))
    append(tmp_path, Dataset(PUSHES[:1], [one]))
    append(tmp_path, Dataset(PUSHES[1:2], [one, two]))
    append(tmp_path, Dataset(PUSHES[2:3]))
    assert list(load(tmp_path).history[:-1]) == [one, two]


def test_append_of_the_same_at_once_counts_for_the_quicker(tmp_path, monkeypatch):
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
    writing.append(folder, Dataset([Recording(wrench, rate_hz=500, name=number)]))
"""


def writer(folder, *numbers, killed_at=""):
    return subprocess.Popen([sys.executable, "-c", WRITER, str(folder), killed_at, *map(str, numbers)])


def test_processes_append_at_once(tmp_path):
    writers = [writer(tmp_path, *range(10 * i, 10 * i + 10)) for i in range(2)]
    assert [each.wait(120) for each in writers] == [0, 0]
    assert sorted(names(tmp_path), key=int) == [str(i) for i in range(20)]


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="there is no SIGKILL here")
def test_append_that_was_killed_is_run_again(tmp_path):
    assert writer(tmp_path, 1, 2, killed_at="_sync").wait(120) == -signal.SIGKILL
    with pytest.raises(RecordingFileError, match=r"is no archive: no recordings-\*.parquet lies in it"):
        Archive(tmp_path)
    append(tmp_path, Dataset(PUSHES))
    # the samples have their name
    assert writer(tmp_path, 1, 2, killed_at="_write_index").wait(120) == -signal.SIGKILL
    assert len(Archive(tmp_path).index) == 8
    assert writer(tmp_path, 1, 2).wait(120) == 0
    assert names(tmp_path) == [*(push.name for push in PUSHES), "1", "2"]
    report = check(tmp_path, progress=False)
    assert (report.ok, len(report.leftovers)) == (True, 2), "temporary ones"


def test_append_to_a_full_disk_leaves_nothing(tmp_path):
    resource = pytest.importorskip("resource")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
    try:
        with pytest.raises(
            OSError, match=r"^cannot write .*samples/part-[0-9a-f]{32}.parquet: .*File too large"
        ):
            append(tmp_path / "a", Dataset(PUSHES))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
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
    append(tmp_path, Dataset(PUSHES[1:3]))
    assert appender.append(Dataset(PUSHES[:3])) == Appended(0, 3)
    for path in tmp_path.glob("recordings-*"):
        path.unlink()
    assert appender.append(Dataset(PUSHES)) == Appended(8, 0), "another archive in its place"


def test_append_of_other_axes_is_refused(tmp_path):
    append(tmp_path, Dataset(PUSHES))
    other = Dataset([Recording(np.ones((3, 2)), rate_hz=5, axes=("wx", "ax"))])
    message = r"has the axes wx ax, and the archive .* fx fy fz tx ty tz; add it"
    with pytest.raises(ValueError, match=f"^dataset {message}"):
        append(tmp_path, other)
    with pytest.raises(ValueError, match=f"^the sensor {message}"):
        Appender(tmp_path, other.axes, "the sensor")


@pytest.mark.parametrize("place", ["notes.txt", "rice/a.parquet"])
def test_append_to_something_else_is_refused(tmp_path, place):
    (tmp_path / place).parent.mkdir(exist_ok=True)
    (tmp_path / place).write_text("x")
    with pytest.raises(FileExistsError, match=f"holds '{place[:4]}.*'; wanted an archive, or a new"):
        append(tmp_path, Dataset(PUSHES))
    with pytest.raises(NotADirectoryError, match="is or lies in a file"):
        append(tmp_path / place, Dataset(PUSHES))
    assert files(tmp_path) == [place]


def test_index_file_of_other_axes_is_refused(tmp_path):
    append(tmp_path / "a", Dataset(PUSHES[:1]))
    append(tmp_path / "b", Dataset([replace(PUSHES[0], axes=tuple("abcdef"))]))
    index = index_in(tmp_path / "b")
    index.rename(tmp_path / "a" / index.name)
    with pytest.raises(RecordingFileError, match="lists other axes"):
        Archive(tmp_path / "a")


def test_index_file_lists_only_its_own_samples(tmp_path):
    append(tmp_path, Dataset(PUSHES))
    index_in(tmp_path).rename(tmp_path / f"recordings-{'0' * 32}.parquet")
    with pytest.raises(RecordingFileError, match=r"samples/part-0{32}.parquet: cannot be read: No such file"):
        load(tmp_path)
