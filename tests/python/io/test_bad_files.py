"""Hostile and damaged files of every format: refused by the one exception, or read; nothing else happens.

Files of the corpus (see ``corpus.py``) are read in forks: a part of them in every run, all of them where
``GRANULAR_ID_CASES`` is set, which is also how many damaged files of each format are tried.
"""

import os
import sys
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("resource", reason="memory is measured as POSIX systems do")
pytest.importorskip("h5py")
pytest.importorskip("mcap")
pytest.importorskip("pyarrow")
pytest.importorskip("rosbags")

from corpus import hostile_files, in_a_fork, unpack
from effort import cases
from good_files import PATHS, write_good
from granular_id.io import RecordingFileError, formats, load

EVERY_NTH = 1 if "GRANULAR_ID_CASES" in os.environ else 9
FILES = [file for file in hostile_files() if int(file.number) % EVERY_NTH == 0]
MOST_MB = 1200
NPY_HZ = {"rate_hz": 500.0}
ODD_EVENTS = (
    *("os.chmod", "os.exec", "os.fork", "os.link", "os.posix_spawn", "os.remove", "os.rename", "os.symlink"),
    *("os.system", "os.truncate", "pickle.", "shutil.", "socket.", "sqlite3.enable_load", "subprocess."),
    "urllib.",
)
"""What reading a file has no reason to do."""


def of_a_library(event, arguments):
    """Tell whether a library asks what system this is, or empties a temporary folder of its own."""
    return arguments[0] == "uname" or (event == "os.remove" and arguments[1] >= 0)


def outcome(path, outside=(), **options):
    """Read a path in a fork: read or refused, or else how it ended and what it did besides reading."""
    did = []

    def watch(event, arguments):
        if event == "open" and isinstance(arguments[0], (str, bytes)):
            opened = os.path.realpath(os.fsdecode(arguments[0]))
            flags = os.O_WRONLY | os.O_RDWR | os.O_CREAT
            writing = (arguments[2] or 0) & flags and opened != os.devnull and "/tmp" not in opened
            if writing or (opened.startswith(("/etc/", "/dev/zero", *outside)) and "/set/" not in opened):
                did.append(f"open {opened}")
        elif (
            event.startswith(ODD_EVENTS)
            and "/tmp" not in str(arguments[0])
            and not of_a_library(event, arguments)
        ):
            did.append(f"{event} {arguments}")

    def work():
        sys.addaudithook(watch)
        try:
            load(path, **options)
            said = "read"
        except RecordingFileError as error:
            said = "refused" if str(error).isprintable() else f"refused by {error!r}"
        except BaseException as error:
            said = f"raised {type(error).__name__}"
        return ascii(f"{said}: {did}"[:500]) if did else said

    answer = in_a_fork(work)
    assert answer.megabytes < MOST_MB
    return answer.verdict


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("hostile")
    unpack(place, {file.number for file in FILES})
    return place


@pytest.mark.parametrize("file", FILES, ids=lambda file: f"{file.number} {file.name}")
def test_hostile_files_come_to_what_is_stored(folder, file):
    assert outcome(file.path(folder), [f"{folder}/"], **file.options) == file.verdict


@pytest.mark.parametrize("kind", PATHS)
def test_damaged_files_are_read_or_refused(tmp_path, kind):
    """Seeds are stored by counting: the same ones damage the same bytes, as long as libraries write the same files."""
    for seed in range(cases(4)):
        path = damaged(kind, seed, tmp_path / str(seed))
        assert outcome(path, **(NPY_HZ if kind == "npy" else {})) in ("read", "refused")


def damaged(kind, seed, folder):
    """Flip, cut out, repeat or overwrite bytes of a good file; more of them with every seed."""
    rng = np.random.default_rng(seed)
    folder.mkdir()
    path = write_good(kind, folder)
    files = sorted(file for file in path.rglob("*") if file.is_file()) if path.is_dir() else [path]
    file = files[rng.integers(len(files))]
    data = bytearray(file.read_bytes())
    for _ in range(1 + seed % 8):
        start, length = int(rng.integers(len(data))), int(rng.integers(1, 9))
        part = data[start : start + length]
        data[start : start + length] = (
            bytes(byte ^ 1 << int(rng.integers(8)) for byte in part),
            b"",
            part * 2,
            rng.bytes(len(part)),
            b"\xff" * len(part),
        )[rng.integers(5)]
    file.write_bytes(data)
    return path


@pytest.mark.parametrize("kind", [kind for kind in PATHS if kind != "csv"])
def test_the_rest_of_the_folder_loads_and_the_bad_file_is_listed(tmp_path, kind):
    for label in ("peas", "rice"):
        (tmp_path / label).mkdir()
        path = write_good(kind, tmp_path / label)
    for file in [path, *path.rglob("*")] if path.is_dir() else [path]:
        if file.is_file():
            file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    data = load(tmp_path, on_error="skip", **(NPY_HZ if kind == "npy" else {}))
    assert data.y.tolist() == ["peas"] * len(data) or kind in ("npz", "archive")
    (row,) = [row for row in data.history[-1].rows if "skipped" in row]
    assert row["skipped"].startswith(str(path))


ODD = {
    "pipe": lambda place, _: os.mkfifo(place),
    "link out": lambda place, secret: place.symlink_to(secret),
    "link to a device": lambda place, _: place.symlink_to("/dev/zero"),
}


@pytest.mark.parametrize("odd", ODD)
@pytest.mark.parametrize("known", formats.FORMATS, ids=lambda known: known.name)
def test_what_is_no_file_of_the_folder_is_refused_before_it_is_opened(tmp_path, monkeypatch, known, odd):
    (tmp_path / "secret").write_text("time,fx,fy,fz,tx,ty,tz\n0,1,2,3,4,5,6\n")
    places = [tmp_path / "set" / f"a{suffix}" for suffix in known.suffixes[:1]]
    if known.is_folder:
        signs = {"parquet": "recordings.parquet", "ros": "metadata.yaml"}
        sign = tmp_path / "set" / "whole" / signs[known.name]
        sign.parent.mkdir(parents=True)
        sign.write_text("")
        places.append(tmp_path / "set" / "whole" / "data" / "a")
    opened = replace(known, read=lambda *_: pytest.fail("it was opened"))
    monkeypatch.setattr(formats, "FORMATS", (opened,))
    for place in places:
        place.parent.mkdir(exist_ok=True)
        ODD[odd](place, tmp_path / "secret")
    with pytest.raises(RecordingFileError, match="none of"):
        load(tmp_path / "set", on_error="skip")


@pytest.mark.skipif(hasattr(os, "geteuid") and os.geteuid() == 0, reason="root may read everything")
def test_an_unreadable_file(tmp_path):
    for kind in ("csv", "npz", "hdf5", "mat v7", "mat v7.3", "parquet", "mcap", "ros1", "db3"):
        path = write_good(kind, tmp_path / kind)
        path.chmod(0)
        with pytest.raises(RecordingFileError, match="cannot be read: Permission denied"):
            load(path)


def test_the_good_files_are_good(tmp_path):
    for kind in PATHS:
        (tmp_path / kind).mkdir()
        data = load(write_good(kind, tmp_path / kind), **(NPY_HZ if kind == "npy" else {}))
        assert data[0].n_samples == 40
        assert data[0].rate_hz == 500
