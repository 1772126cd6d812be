"""Hostile and damaged files of every format: refused by the one exception, or read, and no more than read.

The corpus (see ``corpus.py``) goes through whole in every run, each file in a process of its own.
"""

import os
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("fcntl", reason="files are read in forks")
pytest.importorskip("h5py")
pytest.importorskip("mcap")
pytest.importorskip("pyarrow")
pytest.importorskip("rosbags")

from corpus import outcomes, outcomes_of_all, rows
from effort import cases
from good_files import PATHS, write_good
from granular_id.io import RecordingFileError, formats, load, sources


def test_hostile_files_are_read_or_refused_as_stored():
    found = zip(rows(), outcomes_of_all(), strict=True)
    assert {row[1]: outcome for row, outcome in found if outcome != row[-1]} == {}


def test_damaged_files_are_read_or_refused(tmp_path):
    """Seeds are stored by counting: the same ones damage the same bytes, as long as libraries write the same files."""
    files = {
        (kind, seed): (damaged(kind, seed, tmp_path / kind / str(seed) / "set"), _options(kind))
        for kind in PATHS
        for seed in range(cases(4))
    }
    good = (
        "read",
        "refused",
        "ended by -11",
    )  # HDF5 may crash: files of unknown origin are loaded in a container
    found = zip(files, outcomes(files.values()), strict=True)
    assert {place: outcome for place, outcome in found if outcome not in good} == {}


def _options(kind):
    return {"rate_hz": 500.0} if kind == "npy" else {}


def damaged(kind, seed, folder):
    """Flip, cut out, repeat or overwrite bytes of a good file; more of them with every seed."""
    rng = np.random.default_rng(seed)
    folder.mkdir(parents=True)
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
    data = load(tmp_path, on_error="skip", **_options(kind))
    assert kind in ("npz", "archive") or data.y.tolist() == ["peas"] * len(data)
    (row,) = [row for row in data.history[-1].rows if "skipped" in row]
    assert row["skipped"].startswith(str(path))


ODD = {
    "pipe": lambda place, _: os.mkfifo(place),
    "link out": lambda place, secret: place.symlink_to(secret),
    "link to a device": lambda place, _: place.symlink_to("/dev/zero"),
}


@pytest.mark.parametrize("odd", ODD)
@pytest.mark.parametrize("known", formats.FORMATS, ids=lambda known: known.name)
def test_no_file_of_the_folder_is_refused_unopened(tmp_path, monkeypatch, known, odd):
    (tmp_path / "secret").write_text("time,fx,fy,fz,tx,ty,tz\n0,1,2,3,4,5,6\n")
    places = [tmp_path / "set" / f"a{suffix}" for suffix in known.suffixes[:1]]
    if known.sign:
        signs = {"parquet": f"recordings-{'0' * 32}.parquet", "ros": "metadata.yaml"}
        sign = tmp_path / "set" / "whole" / signs[known.name]
        sign.parent.mkdir(parents=True)
        sign.write_text("")
        places.append(tmp_path / "set" / "whole" / "data" / "a")
    opened = replace(known, read=lambda *_: pytest.fail("it was opened"))
    monkeypatch.setattr(sources, "FORMATS", (opened,))
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
