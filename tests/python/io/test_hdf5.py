"""HDF5 files of others: groups, attributes and texts as h5py writes them, and what leads out of the file."""

import numpy as np
import pytest

from granular_id.io import RecordingFileError, load

h5py = pytest.importorskip("h5py")

X = np.random.default_rng(4).standard_normal((4, 30, 6))


def other_file(path, write, **settings):
    with h5py.File(path, "w", **settings) as file:
        write(file)
    return path


@pytest.mark.parametrize("libver", ["earliest", "v108", "latest"])
def test_attributes_say_what_groups_and_files_are(tmp_path, libver):
    def write(file):
        for i, label in enumerate(["rice", "öats", "öats"]):
            group = file.create_group(f"push {i}")
            group["wrench"] = X[i]
            group.attrs.update({"label": label, "session": ["mon", np.bytes_("")][i % 2], "rate_hz": 250.0})
            group.attrs["operator"] = "me" * 999
        # so many lie beyond the header
        file.attrs.update({f"key {i}": "nothing" for i in range(20)} | {"speed": 0.03})

    data = load(other_file(tmp_path / "x.h5", write, libver=libver))
    assert [(r.label, r.session) for r in data] == [("rice", "mon"), ("öats", None), ("öats", "mon")]
    assert data[2].wrench.tobytes() == X[2].tobytes()
    assert data.rate_hz == 250
    assert not any("left out" in note for note in data.history[-1].notes)


def test_texts_in_chunks_of_which_some_were_never_written(tmp_path):
    def write(file):
        file["X"], file["fs"] = X, 500
        sessions = file.create_dataset("session", (4,), h5py.string_dtype(), chunks=(2,), compression="gzip")
        sessions[2:] = ["tue", "wed"]

    assert [r.session for r in load(other_file(tmp_path / "x.h5", write))] == [None, None, "tue", "wed"]


def test_packed_values_are_read(tmp_path):
    packings = [
        {"compression": "lzf", "shuffle": True},
        {"compression": "gzip", "chunks": (1, 7, 6), "fletcher32": True},
    ]
    for packing in packings:
        path = other_file(tmp_path / "x.h5", lambda file: file.create_dataset("X", data=X, **packing))  # noqa: B023
        assert np.array_equal(load(path, rate_hz=500).X, X)


def test_what_is_no_number_or_text_is_left_out_and_said(tmp_path):
    def write(file):
        file["X"], file["spectrum"] = X, np.ones((4, 30, 6), complex)
        file.attrs["label"] = np.bytes_("rice")

    path = other_file(tmp_path / "x.h5", write)
    path.write_bytes(path.read_bytes().replace(b"label", b"lab\xffl"))  # a name that is no text
    data = load(path, rate_hz=500)
    assert [r.label for r in data] == [None] * 4
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
        (lambda f: f.update({"X": h5py.ExternalLink("/etc/passwd", "/")}), "X: is a link"),
        (lambda f: f.update({"X": h5py.SoftLink("/X")}), "X: is a link"),
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
