"""Data sets in one NPZ or HDF5 file: there and back to the last bit, with plain numpy and h5py as the other side."""

import json
import os

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

from dataset_strategies import assert_same_bits, datasets
from effort import cases
from granular_id.io import RecordingFileError, load, save
from granular_id.recording import Dataset, Recording, StepReport
from layouts_written import AXES, X

h5py = pytest.importorskip("h5py")

PUSHES = X[:2, :30]
BESIDE = ("wrench", "history", "time_s", "flags")
"""What lies at the top of an HDF5 file; the rest lies in the group ``recordings``."""

VALUES = {
    "version": 1,
    "axes": AXES,
    "wrench": PUSHES.reshape(60, 6),
    "n_samples": [30, 30],
    "rate_hz": [500.0, 100.0],
    "start_time": [np.nan, np.nan],
    "trigger_index": [-1, 2],
    "label": ["rice", ""],
    "session": ["", ""],
    "name": ["a", "b"],
    "meta": '{}\n{"fill_mm": 80}',
    "history": "[]",
}

both = pytest.mark.parametrize("form", ["npz", "h5"])


def small():
    regular = Recording(
        PUSHES[0],
        rate_hz=500,
        label="öat",
        session="mon",
        start_time=1.7e9,
        name="one",
        meta={"tool": {"d_mm": 17}},
    )
    stamped = Recording(PUSHES[1, :3], time_s=[0, 0.25, 0.375], name="two", trigger_index=1, flags=[0, 1, 2])
    return Dataset([regular, stamped], [StepReport("load", {"format": "csv"})])


def plain(path):
    """What numpy or h5py alone find in a file, by the names in NPZ files."""
    if path.suffix == ".npz":
        with np.load(path, allow_pickle=False) as file:
            found = dict(file)
        mark, _, version = str(found.pop("format")).rpartition(" ")
        texts = {name: found[name].tobytes().decode() for name in ("meta", "history")}
        return found | texts | {"format": mark, "version": int(version)}
    with h5py.File(path) as file:
        group = file["recordings"]
        found = {name: file[name][()] for name in BESIDE if name in file}
        found |= {name: group[name][()] for name in group}
        units = [unit.decode() for unit in file["wrench"].attrs["units"]]
        assert units == ["N"] * 3 + ["N m"] * 3
        assert group["rate_hz"].attrs["units"] == b"Hz"
        texts = {name: group[name].asstr()[()] for name in ("label", "session", "name")}
        texts |= {"meta": group["meta"].asstr()[()], "history": file["history"].asstr()[()]}
        axes = np.array([axis.decode() for axis in file["wrench"].attrs["axes"]])
        about = {"format": file.attrs["format"].decode(), "version": file.attrs["version"]}
        return found | texts | about | {"axes": axes}


def written(folder, form, **change):
    """Write the layout by numpy or h5py alone, packed as other programs may; None leaves something out."""
    values = {name: value for name, value in (VALUES | change).items() if value is not None}
    version, axes, path = values.pop("version"), values.pop("axes"), folder / f"x.{form}"
    if form == "npz":
        for name in ("meta", "history"):
            if isinstance(values.get(name), str):
                values[name] = np.frombuffer(values[name].encode(), np.uint8)
        np.savez_compressed(path, format=f"granular_id recordings {version}", axes=axes, **values)
        return path
    with h5py.File(path, "w") as file:
        file.attrs["format"], file.attrs["version"] = "granular_id recordings", np.int16(version)
        for name, value in values.items():
            packed = {"compression": "gzip", "shuffle": True} if name == "wrench" else {}
            file.create_dataset(name if name in BESIDE else f"recordings/{name}", data=value, **packed)
        if "wrench" in file:
            file["wrench"].attrs["axes"] = axes
    return path


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=cases(15))
@both
@given(dataset=datasets())
def test_what_is_saved_is_loaded_to_the_last_bit(tmp_path, form, dataset):
    path = tmp_path / f"set.{form}"
    path.unlink(missing_ok=True)
    read = load(save(dataset, path))
    assert_same_bits(read, dataset)
    assert read == dataset
    assert read.history[:-1] == dataset.history


@both
def test_plain_libraries_read_what_is_saved(tmp_path, form):
    found = plain(save(small(), tmp_path / f"set.{form}"))
    assert (found["format"], found["version"]) == ("granular_id recordings", 1)
    assert found["wrench"].tobytes() == np.concatenate([PUSHES[0], PUSHES[1, :3]]).tobytes()
    assert found["axes"].tolist() == AXES
    assert np.array_equal(found["time_s"], [np.nan] * 30 + [0, 0.25, 0.375], equal_nan=True)
    assert found["flags"].tolist() == [0] * 31 + [1, 2]
    assert found["n_samples"].tolist() == [30, 3]
    assert found["label"].tolist() == ["öat", ""]
    assert found["session"].tolist() == ["mon", ""]
    assert found["name"].tolist() == ["one", "two"]
    assert np.array_equal(found["rate_hz"], [500, np.nan], equal_nan=True)
    assert np.array_equal(found["start_time"], [1.7e9, np.nan], equal_nan=True)
    assert found["trigger_index"].tolist() == [-1, 1]
    assert [json.loads(line) for line in found["meta"].split("\n")] == [{"tool": {"d_mm": 17}}, {}]
    assert json.loads(found["history"]) == [small().history[0].to_dict()]


@both
def test_what_plain_libraries_write_in_the_layout_is_loaded(tmp_path, form):
    expected = [
        Recording(PUSHES[0], rate_hz=500, label="rice", name="a"),
        Recording(PUSHES[1], rate_hz=100, name="b", trigger_index=2, meta={"fill_mm": 80}),
    ]
    assert load(written(tmp_path, form)) == Dataset(expected)


@pytest.mark.parametrize(("form", "place"), [("npz", "extra"), ("h5", "flavour")])
def test_what_is_no_part_of_the_layout_is_said(tmp_path, form, place):
    path = written(tmp_path, form, **({"extra": [1, 2]} if form == "npz" else {}))
    if form == "h5":
        with h5py.File(path, "a") as file:
            file["flavour"] = 1
    assert any(f"not read: {place}" in note for note in load(path).history[-1].notes)


CONTRADICTIONS = [
    ({"version": 2}, "version 2;|'granular_id recordings 2'"),
    ({"wrench": None}, "wrench'? ?(is|: is) missing"),
    ({"label": None}, "label'? ?(is|: is) missing"),
    ({"label": ["rice"]}, "label"),
    ({"label": [1, 2]}, "label.*wanted (a list of )?texts"),
    ({"n_samples": [30, 31]}, "n_samples adds up to 61"),
    ({"n_samples": [30.0, 30.0]}, "wanted whole numbers"),
    ({"rate_hz": [500.0, -1.0]}, r"rate_hz\[1\]"),
    ({"rate_hz": [500.0]}, "rate_hz has shape"),
    ({"meta": "{}"}, "meta has 1 values for 2"),
    ({"meta": "{}\n{"}, r"meta\[1\] is not JSON"),
    ({"history": "{}"}, "history"),
    ({"wrench": np.full((60, 6), np.nan)}, r"wrench\[0, 0\].* is nan"),
    ({"wrench": PUSHES[0]}, "n_samples"),
    ({"wrench": np.ones((60, 6), complex)}, "wrench"),
]


@both
@pytest.mark.parametrize(("change", "message"), CONTRADICTIONS)
def test_files_that_contradict_themselves_are_refused(tmp_path, form, change, message):
    path = written(tmp_path, form, **change)
    with pytest.raises(RecordingFileError, match=message) as caught:
        load(path)
    assert caught.value.path == str(path)


@pytest.mark.parametrize(
    ("form", "change", "message"),
    [
        ("h5", {"label": np.array([b"\xff", b"a"])}, "is not UTF-8"),
        ("npz", {"label": np.array([0x7FFFFFFF, 0], "<u4").view("<U1")}, "label: .*wanted a list of texts"),
        ("npz", {"meta": np.array([255], np.uint8)}, "array meta as UTF-8"),
        ("npz", {"meta": np.zeros(2)}, "array meta: has shape"),
    ],
)
def test_texts_that_are_none_are_refused(tmp_path, form, change, message):
    with pytest.raises(RecordingFileError, match=message):
        load(written(tmp_path, form, **change))


@both
def test_files_that_are_cut_off_or_of_another_kind_are_refused(tmp_path, form):
    path = save(small(), tmp_path / f"x.{form}")
    data = path.read_bytes()
    parts = [data[: len(data) * tenth // 10] for tenth in range(10)]
    for part in (*parts, b"fx,fy\n1,2\n", b"\x89HDF\r\n\x1a\n" + bytes(500), b"PK\3\4" + bytes(500)):
        path.write_bytes(part)
        with pytest.raises(RecordingFileError, match=path.name):
            load(path)
    path.write_bytes(data)  # the same file to the operating system
    assert load(path) == small()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="has no pipes in folders")
def test_links_to_other_files_are_not_opened(tmp_path):
    path = written(tmp_path, "h5")
    os.mkfifo(tmp_path / "pipe.h5")  # whoever opens it waits for ever
    for name in ("flags", "wrench"):
        with h5py.File(path, "a") as file:
            file.pop(name, None)
            file[name] = h5py.ExternalLink("pipe.h5", "/x")
        with pytest.raises(RecordingFileError, match=f"{name}: is a link, which is not followed"):
            load(path)


@both
def test_nothing_is_overwritten_or_left_half_written(tmp_path, form):
    def stop(done, total, what):
        raise KeyboardInterrupt

    path = tmp_path / f"x.{form}"
    with pytest.raises(KeyboardInterrupt):
        save(small(), path, progress=stop)
    assert list(tmp_path.iterdir()) == []
    save(small(), path)
    with pytest.raises(FileExistsError, match="nothing is overwritten"):
        save(small(), path)
    assert load(path) == small()


def test_the_same_data_gives_the_same_bytes(tmp_path):
    one, other = save(small(), tmp_path / "a.npz"), save(small(), tmp_path / "b.npz")
    assert one.read_bytes() == other.read_bytes()


@pytest.mark.data
def test_a_thousand_real_recordings_keep_every_bit(tmp_path, data_dir):
    dataset = load(data_dir / "sliding_wrench")
    assert_same_bits(load(save(dataset, tmp_path / "sliding.npz")), dataset)
