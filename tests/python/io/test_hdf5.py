"""HDF5 files: whole data sets there and back, h5py as the other side, and files of others."""

import json
import os

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

from dataset_strategies import assert_same_bits, datasets
from effort import cases
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


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=cases(15))
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
        ({"recordings/label": ["rice"]}, "label"),
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
                group.attrs.update({"rate_hz": 250.0, "session": np.bytes_(f"s{k}")})

    data = load(other_file(tmp_path / "x.h5", write))
    assert [(r.name, r.label, r.session) for r in data] == [
        ("peas/0", "peas", "s0"),
        ("peas/1", "peas", "s1"),
        ("rice/0", "rice", "s0"),
        ("rice/1", "rice", "s1"),
    ]
    assert data[2].wrench.tobytes() == X[0].tobytes()
    assert data.rate_hz == 250


@pytest.mark.parametrize("libver", ["earliest", "v108"])
def test_attributes_as_h5py_writes_text_by_default(tmp_path, libver):
    with h5py.File(tmp_path / "x.h5", "w", libver=libver) as file:
        for i, label in enumerate(["rice", "öats", "öats"]):
            group = file.create_group(f"push {i}")
            group["wrench"] = X[i]
            group.attrs.update(
                {"label": label, "session": ["mon", ""][i % 2], "rate_hz": 250, "operator": "me" * 999}
            )
    data = load(tmp_path / "x.h5")
    assert [(r.label, r.session) for r in data] == [("rice", "mon"), ("öats", None), ("öats", "mon")]
    assert not any("left out" in note for note in data.history[-1].notes)


def test_attributes_beyond_the_header_are_read(tmp_path):
    with h5py.File(tmp_path / "x.h5", "w", libver="latest") as file:
        file["X"], file["fs"] = X[0], 250
        file.attrs.update({f"key {i}": "so many lie elsewhere" for i in range(20)} | {"label": "rice"})
    assert load(tmp_path / "x.h5")[0].label == "rice"


def test_a_file_in_the_format_whose_texts_are_of_changing_length(tmp_path):
    path = own_file(tmp_path / "x.h5", **{"recordings/label": ["rice", "öat flakes"], "history": "[]"})
    with h5py.File(path, "a") as file:
        file.attrs["format"] = "granular_id recordings"
        file["wrench"].attrs["axes"] = AXES
    assert load(path).y.tolist() == ["rice", "öat flakes"]


@pytest.mark.parametrize("packing", [{}, {"compression": "gzip"}, {"compression": "gzip", "shuffle": True}])
def test_texts_in_chunks_of_which_some_were_never_written(tmp_path, packing):
    def write(file):
        file["X"], file["fs"] = X, 500
        labels = file.create_dataset("y", (4,), h5py.string_dtype(), chunks=(2,), **packing)
        sessions = file.create_dataset("session", (4,), h5py.string_dtype(), chunks=(2,), **packing)
        labels[:], sessions[2:] = ["rice", "peas", "rice", "öats"], ["tue", "wed"]

    data = load(other_file(tmp_path / "x.h5", write))
    assert data.y.tolist() == ["rice", "peas", "rice", "öats"]
    assert [r.session for r in data] == [None, None, "tue", "wed"]


@pytest.mark.parametrize("dtype", ["<f8", ">f8", "<f4", "<i2"])
@pytest.mark.parametrize(
    "packing",
    [
        {},
        {"compression": "lzf", "shuffle": True},
        {"compression": "gzip", "chunks": (1, 7, 6), "fletcher32": True},
    ],
)
def test_values_are_those_that_h5py_reads(tmp_path, dtype, packing):
    values = np.rint(X * 10).astype(dtype)

    def write(file):
        file.create_dataset("X", data=values, **packing)

    assert (values == load(other_file(tmp_path / "x.h5", write), rate_hz=500).X).all()


def test_what_was_never_written_is_the_fill_value(tmp_path):
    def write(file):
        file.create_dataset("X", shape=(2, 9, 6), dtype="f8", fillvalue=2.5)

    assert (load(other_file(tmp_path / "x.h5", write), rate_hz=500).X == 2.5).all()


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


def _virtual(file):
    layout = h5py.VirtualLayout(X.shape, "f8")
    layout[:] = h5py.VirtualSource("elsewhere.h5", "X", X.shape)
    file.create_virtual_dataset("X", layout)


def _loop(file):
    file["X"] = X
    inner = file.create_group("a/b")
    inner["c"] = file["a"]


def _texts_in_another_file(file):
    file["X"] = X
    file.create_dataset("labels", (4,), "S4", external=[("/etc/passwd", 0, 16)])


@pytest.mark.parametrize(
    ("write", "message"),
    [
        (
            lambda f: f.update({"X": h5py.ExternalLink("/etc/passwd", "/")}),
            "X: is a link, which is not followed",
        ),
        (lambda f: f.update({"X": h5py.SoftLink("/X")}), "X: is a link, which is not followed"),
        (
            lambda f: f.create_dataset("X", X.shape, "f8", external=[("/etc/passwd", 0, X.nbytes)]),
            "X: keeps its values in other files",
        ),
        (_texts_in_another_file, "labels: keeps its values in other files"),
        (_virtual, "X: keeps its values in other files"),
        (_loop, "a group that lies at two places"),
        (lambda f: f.create_dataset("X", (10**6, 100, 6), "f8"), "X: would expand from"),
        (lambda f: f.create_dataset("X", data=h5py.Empty("f8")), "no recordings"),
        (lambda f: None, "no recordings"),
    ],
)
def test_other_files_bombs_and_useless_files_are_refused(tmp_path, write, message):
    with pytest.raises(RecordingFileError, match=message):
        load(other_file(tmp_path / "x.h5", write), rate_hz=500)


def test_cut_off_and_no_hdf5(tmp_path):
    path = save(small(), tmp_path / "x.h5")
    data = path.read_bytes()
    parts = [data[: len(data) * tenth // 10] for tenth in range(10)]
    for part in (*parts, b"fx,fy\n1,2\n", b"\x89HDF\r\n\x1a\n" + bytes(500)):
        path.write_bytes(part)
        with pytest.raises(RecordingFileError, match=r"x\.h5"):
            load(path)
    path.write_bytes(data)  # the same file to the operating system
    assert load(path) == small()
