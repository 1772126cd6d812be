"""HDF5 files of others: groups, attributes and texts as h5py writes them, and what leads out of the file."""

import numpy as np
import pytest

from granular_id.io import RecordingFileError, load

h5py = pytest.importorskip("h5py")

X = np.random.default_rng(4).standard_normal((4, 30, 6))


def other_file(path, write):
    with h5py.File(path, "w") as file:
        write(file)
    return path


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


def test_texts_in_chunks_of_which_some_were_never_written(tmp_path):
    def write(file):
        file["X"], file["fs"] = X, 500
        sessions = file.create_dataset("session", (4,), h5py.string_dtype(), chunks=(2,), compression="gzip")
        sessions[2:] = ["tue", "wed"]

    assert [r.session for r in load(other_file(tmp_path / "x.h5", write))] == [None, None, "tue", "wed"]


@pytest.mark.parametrize(
    "packing",
    [
        {"compression": "lzf", "shuffle": True},
        {"compression": "gzip", "chunks": (1, 7, 6), "fletcher32": True},
    ],
)
def test_packed_values_are_read(tmp_path, packing):
    def write(file):
        file.create_dataset("X", data=np.rint(X * 10), **packing)

    assert (np.rint(X * 10) == load(other_file(tmp_path / "x.h5", write), rate_hz=500).X).all()


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
