"""Hostile and damaged files of every format: refused by the one exception, or read; nothing reaches this process.

The corpus (see ``corpus.py``) goes through ``isolate=True``: a part of it in every run, all of it where
``GRANULAR_ID_CASES`` is set, which is also how many damaged files of each format are tried.
"""

import json
import os
import shutil
import sys
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("resource", reason="memory is measured and limited as POSIX systems do")
pytest.importorskip("h5py")
pytest.importorskip("mcap")
pytest.importorskip("pyarrow")
pytest.importorskip("rosbags")

import resource

from corpus import hostile_files, unpack
from effort import cases
from good_files import PATHS, write_good
from granular_id.io import RecordingFileError, formats, isolate, load

EVERY_NTH = 1 if "GRANULAR_ID_CASES" in os.environ else 9
FILES = hostile_files()[::EVERY_NTH]
GIB = 1 << 30
KILO = 1 if sys.platform == "darwin" else 1024
NPY_HZ = {"rate_hz": 500.0}

WATCH = """
import os, sys
from granular_id.io import isolate

told = open({told!r}, "a", buffering=1)
ODD = ("os.chmod", "os.exec", "os.fork", "os.link", "os.posix_spawn", "os.remove", "os.rename", "os.symlink",
       "os.system", "os.truncate", "pickle.", "shutil.", "socket.", "sqlite3.enable_load", "subprocess.", "urllib.")
OUTSIDE = ("/etc/", "/dev/zero", {places!r} + "/")

def of_a_library(event, arguments):
    # asks what system this is, or empties a temporary folder of its own
    return arguments[0] == "uname" or event == "os.remove" and arguments[1] >= 0

def watch(event, arguments):
    if event == "open" and isinstance(arguments[0], (str, bytes)):
        path = os.path.realpath(os.fsdecode(arguments[0]))
        writing = (arguments[2] or 0) & (os.O_WRONLY | os.O_RDWR | os.O_CREAT) and path != os.devnull
        if (path.startswith(OUTSIDE) and "/set/" not in path) or (writing and "/tmp" not in path):
            print(event, ascii(path), file=told)
    elif event.startswith(ODD) and "/tmp" not in str(arguments[0]) and not of_a_library(event, arguments):
        print(event, ascii(arguments), file=told)

sys.addaudithook(watch)
isolate._serve()
"""
"""What the child runs: it tells what it opens outside of the data set, and does besides reading."""


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """Let calls of `load` share a child, which saves the half second of its start; return what it tells of itself."""
    told = tmp_path_factory.mktemp("told") / "told"
    real, readers = isolate.IsolatedReader, {}

    @contextmanager
    def shared(_, options):
        yield readers.setdefault(options, real([], options))

    with pytest.MonkeyPatch.context() as patch:
        code = WATCH.format(told=str(told), places=str(tmp_path_factory.getbasetemp()))
        patch.setattr(isolate, "_CHILD", ("-c", code))
        patch.setattr(isolate, "IsolatedReader", shared)
        yield told
    for reader in readers.values():
        reader._end()


def outcome(path, **options):
    try:
        load(path, isolate=True, **options)
    except RecordingFileError as error:
        return "refused" if str(error).isprintable() else f"refused by {error!r}"
    return "read"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("hostile")
    unpack(place, {file.number for file in FILES})
    return place


@pytest.mark.parametrize("file", FILES, ids=lambda file: f"{file.number} {file.name}")
def test_hostile_files_come_to_what_is_stored(told, folder, file):
    told.write_text("")
    assert outcome(file.path(folder), **file.options) == file.verdict
    assert told.read_text() == "", "it led to another file, or the child did more than read"


def test_memory_of_children_stays_in_bounds():
    assert resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * KILO < GIB


WIDE = {"observation.wrench": {"dtype": "float64", "shape": [10**9, 6], "names": None}}
SPOILT = {
    "a path out of the folder": ({"data_path": "../secret.parquet"}, "read"),  # paths are those of the layout
    "a path as wide as memory": ({"data_path": "{chunk_index:0999999999d}"}, "read"),
    "a window larger than memory": ({"features": WIDE}, "refused"),
    "an endless rate": ({"fps": 10**400}, "refused"),
    "counts that are too large": ({"total_episodes": 10**15, "chunks_size": 0}, "refused"),
}


@pytest.mark.parametrize("spoilt", SPOILT)
def test_hostile_data_sets_of_lerobot(told, tmp_path, spoilt):
    (tmp_path / "set").mkdir()
    path, (entries, verdict) = write_good("lerobot", tmp_path / "set"), SPOILT[spoilt]
    shutil.copy(path / "data/chunk-000/file-000.parquet", tmp_path / "secret.parquet")
    info = path / "meta" / "info.json"
    info.write_text(json.dumps(json.loads(info.read_text(encoding="utf-8")) | entries), encoding="utf-8")
    told.write_text("")
    assert outcome(path) == verdict
    assert told.read_text() == "", "it led to another file, or the child did more than read"


@pytest.mark.parametrize("kind", PATHS)
def test_damaged_files_are_read_or_refused(told, tmp_path, kind):
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


@pytest.mark.parametrize("kind", [kind for kind in PATHS if kind not in ("gm10", "csv")])
def test_the_rest_of_the_folder_loads_and_the_bad_file_is_listed(tmp_path, kind):
    for label in ("peas", "rice"):
        (tmp_path / label).mkdir()
        path = write_good(kind, tmp_path / label)
    for file in [path, *path.rglob("*")] if path.is_dir() else [path]:
        if file.is_file():
            file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    data = load(tmp_path, on_error="skip", **(NPY_HZ if kind == "npy" else {}))
    assert data.y.tolist() == ["peas"] * len(data) or kind in ("npz", "hdf5", "archive", "lerobot", "mcap")
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
        signs = {"parquet": "recordings.parquet", "ros": "metadata.yaml", "lerobot": "meta/info.json"}
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
        assert data[0].rate_hz == 500 or kind == "gm10"
