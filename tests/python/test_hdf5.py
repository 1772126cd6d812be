"""HDF5 files: whole data sets there and back, h5py as the other side, files of others, and hostile ones."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

from dataset_strategies import assert_same_bits, datasets
from granular_id.io import RecordingFileError, load, save
from granular_id.recording import Dataset, Recording, StepReport

h5py = pytest.importorskip("h5py")

AXES = ["fx", "fy", "fz", "tx", "ty", "tz"]
X = np.random.default_rng(4).standard_normal((4, 30, 6))


def small():
    regular = Recording(
        X[0], rate_hz=500, label="öat", session="mon", start_time=1.7e9, name="one", meta={"d": [17]}
    )
    stamped = Recording(X[1][:3], time_s=[0, 0.25, 0.375], name="two", trigger_index=1, flags=[0, 1, 2])
    return Dataset([regular, stamped], [StepReport("load", {"format": "csv"})])


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=40)
@given(dataset=datasets())
def test_what_is_saved_is_loaded_to_the_last_bit(tmp_path, dataset):
    path = tmp_path / "set.h5"
    path.unlink(missing_ok=True)
    read = load(save(dataset, path))
    assert_same_bits(read, dataset)
    assert read == dataset
    assert read.history[:-1] == dataset.history


def test_plain_h5py_reads_what_is_saved(tmp_path):
    with h5py.File(save(small(), tmp_path / "set.hdf5")) as file:
        assert dict(file.attrs) == {"format": b"granular_id recordings", "version": 1}
        assert file["wrench"][()].tobytes() == np.concatenate([X[0], X[1][:3]]).tobytes()
        assert file["wrench"].attrs["axes"].tolist() == [axis.encode() for axis in AXES]
        assert file["wrench"].attrs["units"].tolist() == [b"N"] * 3 + [b"N m"] * 3
        assert np.array_equal(file["time_s"][()], [np.nan] * 30 + [0, 0.25, 0.375], equal_nan=True)
        assert file["flags"][()].tolist() == [0] * 31 + [1, 2]
        group = file["recordings"]
        assert group["n_samples"][()].tolist() == [30, 3]
        assert group["label"].asstr()[()].tolist() == ["öat", ""]
        assert group["session"].asstr()[()].tolist() == ["mon", ""]
        assert group["name"].asstr()[()].tolist() == ["one", "two"]
        assert np.array_equal(group["rate_hz"][()], [500, np.nan], equal_nan=True)
        assert group["rate_hz"].attrs["units"] == b"Hz"
        assert np.array_equal(group["start_time"][()], [1.7e9, np.nan], equal_nan=True)
        assert group["trigger_index"][()].tolist() == [-1, 1]
        assert [json.loads(line) for line in group["meta"].asstr()[()].split("\n")] == [{"d": [17]}, {}]
        assert json.loads(file["history"].asstr()[()]) == [small().history[0].to_dict()]


def own_file(path, **change):
    """Write the format by plain h5py, packed as other programs may; a change of None leaves something out."""
    values = {
        "wrench": X[:2].reshape(60, 6),
        "recordings/n_samples": [30, 30],
        "recordings/rate_hz": [500.0, 100.0],
        "recordings/start_time": [np.nan, np.nan],
        "recordings/trigger_index": [-1, 2],
        "recordings/label": np.array(["rice", ""], "S"),
        "recordings/session": np.array(["", ""], "S1"),
        "recordings/name": np.array(["a", "b"], "S"),
        "recordings/meta": np.bytes_('{}\n{"fill_mm": 80}'),
        "history": np.bytes_("[]"),
        **change,
    }
    with h5py.File(path, "w") as file:
        file.attrs["format"] = np.bytes_("granular_id recordings")
        file.attrs["version"] = np.int16(change.pop("version", 1))
        for name, value in values.items():
            if value is not None and name != "version":
                packed = {"compression": "gzip", "shuffle": True} if name == "wrench" else {}
                file.create_dataset(name, data=value, **packed)
        if "wrench" in file:
            file["wrench"].attrs["axes"] = np.array(AXES, "S")
    return path


def test_what_plain_h5py_writes_in_the_format_is_loaded(tmp_path):
    expected = [
        Recording(X[0], rate_hz=500, label="rice", name="a"),
        Recording(X[1], rate_hz=100, name="b", trigger_index=2, meta={"fill_mm": 80}),
    ]
    read = load(own_file(tmp_path / "x.h5", extra=[1, 2]))
    assert read == Dataset(expected)
    assert any("not read: extra" in note for note in read.history[-1].notes)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"version": 2}, "is of version 2; this granular_id reads version 1"),
        ({"wrench": None}, "wrench: is missing"),
        ({"recordings/label": None}, "recordings/label: is missing"),
        ({"recordings/label": ["rice", "peas"]}, "changing length"),
        ({"recordings/label": [1, 2]}, "label: .*wanted texts"),
        ({"recordings/label": np.array([b"\xff", b"a"])}, "is not UTF-8"),
        ({"recordings/n_samples": [30, 31]}, "n_samples adds up to 61"),
        ({"recordings/n_samples": [30.0, 30.0]}, "wanted whole numbers"),
        ({"recordings/rate_hz": [500.0, -1.0]}, r"rate_hz\[1\]"),
        ({"recordings/rate_hz": [500.0]}, "rate_hz has shape"),
        ({"recordings/meta": np.bytes_("{}")}, "meta has 1 values for 2"),
        ({"recordings/meta": np.bytes_("{}\n{")}, r"meta\[1\] is not JSON"),
        ({"history": np.bytes_("{}")}, "history"),
        ({"wrench": np.full((60, 6), np.nan)}, r"wrench\[0, 0\].* is nan"),
        ({"wrench": X[0]}, "n_samples"),
        ({"wrench": np.ones((60, 6), complex)}, "wrench"),
    ],
)
def test_files_in_the_format_that_contradict_themselves(tmp_path, change, message):
    with pytest.raises(RecordingFileError, match=message) as caught:
        load(own_file(tmp_path / "x.h5", **change))
    assert caught.value.path.endswith("x.h5")


def other_file(path, write):
    with h5py.File(path, "w") as file:
        write(file)
    return path


def test_arrays_with_labels_of_changing_length(tmp_path):
    def write(file):
        file["X"], file["y"], file["fs"] = X, ["rice", "peas", "rice", "öats"], 500

    data = load(other_file(tmp_path / "x.h5", write))
    assert data.y.tolist() == ["rice", "peas", "rice", "öats"]
    assert data.X.tobytes() == X.tobytes()
    assert data.rate_hz == 500


def test_groups_whose_attributes_say_what_they_are(tmp_path):
    def write(file):
        for i, material in enumerate(["rice", "peas"]):
            for k in range(2):
                group = file.create_group(f"{material}/{k}")
                group["wrench"] = X[2 * i + k]
                group.attrs.update({"rate_hz": 250.0, "session": np.bytes_(f"s{k}"), "label": "?"})

    data = load(other_file(tmp_path / "x.h5", write))
    assert [(r.name, r.label, r.session) for r in data] == [
        ("peas/0", "peas", "s0"),
        ("peas/1", "peas", "s1"),
        ("rice/0", "rice", "s0"),
        ("rice/1", "rice", "s1"),
    ]
    assert data[2].wrench.tobytes() == X[0].tobytes()
    assert any("the attribute label has no fixed width" in note for note in data.history[-1].notes)
    assert data.rate_hz == 250


def test_attributes_of_a_data_set_stand_beside_it(tmp_path):
    def write(file):
        for i in range(2):
            file[f"rice_{i}"] = X[i]
            file[f"rice_{i}"].attrs["sampling_rate"] = 100

    data = load(other_file(tmp_path / "x.h5", write))
    assert data.rate_hz == 100
    assert data.labels == ("rice",)


def _external_values(file):
    file.create_dataset("X", shape=X.shape, external=[("/etc/passwd", 0, X.nbytes)], dtype="f8")


def _virtual(file):
    layout = h5py.VirtualLayout(X.shape, "f8")
    layout[:] = h5py.VirtualSource("elsewhere.h5", "X", X.shape)
    file.create_virtual_dataset("X", layout)


def _loop(file):
    file["X"] = X
    inner = file.create_group("a/b")
    inner["c"] = file["a"]


def _texts_of_gigabytes(file):
    """Change the length that stands for a text in the file: the library would take the memory at once."""
    file["X"], file["y"] = X, ["rice"] * 4
    offset = file["y"].id.get_offset()
    file.flush()
    with Path(file.filename).open("r+b") as raw:
        raw.seek(offset)
        raw.write((0xF0000000).to_bytes(4, "little"))


def _long_texts(file):
    file["X"] = X
    file["names"] = np.array(["a"] * 200_001, h5py.string_dtype())


@pytest.mark.parametrize(
    ("write", "message"),
    [
        (lambda f: f.update({"X": h5py.ExternalLink("/etc/passwd", "/")}), "X: is a link to another file"),
        (lambda f: f.update({"X": h5py.SoftLink("/X")}), "X: is a link by name, which is not followed"),
        (_external_values, "X: keeps its values in other files"),
        (_virtual, "X: keeps its values in other files"),
        (_loop, "a group that lies at two places"),
        (lambda f: f.create_dataset("X", data=X, compression="lzf"), "X: is packed with"),
        (lambda f: f.create_dataset("X", (10**6, 100, 6), "f8"), "would expand from"),
        (
            lambda f: f.create_dataset("X", (10**4, 1600, 6), "f8", compression="gzip", fillvalue=1),
            "chunks|expand",
        ),
        (_texts_of_gigabytes, "y: would expand from|damaged"),
        (_long_texts, "200001"),
        (lambda f: f.update({"X": "only a text"}), "."),
        (lambda f: None, "."),
    ],
)
def test_hostile_and_useless_files(tmp_path, write, message):
    with pytest.raises(RecordingFileError, match=message):
        load(other_file(tmp_path / "x.h5", write), rate_hz=500)


def test_a_bomb_of_zeros_is_refused(tmp_path):
    def write(file):
        bomb = file.create_dataset(
            "X", (1, 40_000_000, 6), "f8", chunks=(1, 1_000_000, 6), compression="gzip"
        )
        bomb[0, :1_000_000] = 0.0

    with pytest.raises(RecordingFileError, match="would expand from"):
        load(other_file(tmp_path / "x.h5", write), rate_hz=500)


@pytest.mark.parametrize("tenth", range(10))
def test_cut_off(tmp_path, tenth):
    path = save(small(), tmp_path / "x.h5")
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * tenth // 10])
    with pytest.raises(RecordingFileError, match=r"x\.h5"):
        load(path)


def test_text_and_other_files_in_place_of_hdf5(tmp_path):
    for data in (b"", b"fx,fy\n1,2\n", bytes(range(256)) * 20, b"\x89HDF\r\n\x1a\n" + bytes(500)):
        (tmp_path / "x.h5").write_bytes(data)
        with pytest.raises(RecordingFileError, match=r"x\.h5"):
            load(tmp_path / "x.h5")


def test_an_attribute_with_a_name_that_is_no_text_means_nothing(tmp_path):
    def write(file):
        file["X"] = X
        file.attrs["label"] = np.bytes_("rice")

    path = other_file(tmp_path / "x.h5", write)
    path.write_bytes(path.read_bytes().replace(b"label", b"lab\xffl"))
    assert load(path, rate_hz=500)[0].label is None


def test_complex_numbers_and_records_are_left_out_and_said(tmp_path):
    def write(file):
        file["X"], file["spectrum"] = X, np.ones((4, 30, 6), complex)

    data = load(other_file(tmp_path / "x.h5", write), rate_hz=500)
    assert len(data) == 4
    assert any("spectrum" in note for note in data.history[-1].notes)


def test_an_interrupt_leaves_nothing_and_nothing_is_overwritten(tmp_path):
    def interrupt(done, total, what):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        save(small(), tmp_path / "x.h5", progress=interrupt)
    assert os.listdir(tmp_path) == []  # noqa: PTH208 (hidden files too)
    save(small(), tmp_path / "x.h5")
    with pytest.raises(FileExistsError, match="nothing is overwritten"):
        save(small(), tmp_path / "x.h5")
