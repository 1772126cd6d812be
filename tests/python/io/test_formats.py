"""Every writable format gives back the same data set, and writes names that are safe and nothing half."""

from __future__ import annotations

import sys
import unicodedata
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

from dataset_strategies import assert_same_bits, datasets
from effort import cases
from good_files import write_good
from granular_id.io import RecordingFileError, load, save, sources
from granular_id.io.formats import FORMATS
from granular_id.recording import Dataset, Recording
from granular_id.synthetic import synthesize
from layouts_written import to_h5

for library in ("h5py", "pyarrow", "mcap", "rosbags"):
    pytest.importorskip(library)

NAMES = ("csv", "npz", "parquet")


def place(folder, name):
    """Where a data set of several recordings can be written."""
    return folder / ("set.npz" if name == "npz" else "set")


@pytest.fixture(scope="module")
def pushes():
    data = synthesize(["rice", "oat flakes"], n_per_class=2, sessions=2, seed=3)
    return data.align(n_samples=300, trigger="recorded", lead_s=0.05)


@pytest.mark.parametrize("name", NAMES)
@given(data=datasets())
@settings(max_examples=cases(15), suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_any_data_set_comes_back_to_the_last_bit(tmp_path_factory, name, data):
    path = place(tmp_path_factory.mktemp("any"), name)
    back = load(save(data, path, name))
    assert_same_bits(back, data)
    assert back.history[:-1] == data.history


@pytest.mark.parametrize("name", ["npz", "parquet"])
def test_a_stated_rate_that_is_not_the_files_is_refused(tmp_path, name, pushes):
    path = save(pushes, place(tmp_path, name), name)
    assert load(path, rate_hz=500) == pushes
    with pytest.raises(RecordingFileError, match=r"500 Hz|does not fit the stamps"):
        load(path, rate_hz=250)


@pytest.mark.parametrize("name", NAMES)
def test_writing_tells_how_far_it_is_and_overwrites_nothing(tmp_path, name, pushes):
    calls = []
    path = place(tmp_path, name)
    if not path.suffix:
        path.mkdir()  # that it is there does not matter while it is empty
    assert save(pushes, path, name, progress=lambda *call: calls.append(call)) == path
    assert [done for done, _, _ in calls] == sorted(done for done, _, _ in calls)
    assert calls[-1][0] == calls[-1][1]
    before = sorted((p, p.stat().st_mtime_ns) for p in tmp_path.rglob("*"))
    with pytest.raises(FileExistsError, match=path.name):
        save(pushes, path, name)
    with pytest.raises(FileNotFoundError, match="no such folder"):
        save(pushes, tmp_path / "nowhere" / path.name, name)
    assert sorted((p, p.stat().st_mtime_ns) for p in tmp_path.rglob("*")) == before


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_nothing_is_left_when_writing_fails(tmp_path, name, error, pushes):
    def failing(*_):
        raise error

    with pytest.raises(type(error)):
        save(pushes, place(tmp_path, name), name, progress=failing)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("path", "name"),
    [
        *(("set.xlsx", None), ("set.mat", None), ("set.csv", None), ("set.mcap", None)),
        *(("set.npz", "parquet"), ("set", "excel"), ("set", "npz"), ("set.parquet", "csv")),
    ],
)
def test_formats_that_cannot_be_written_are_refused(tmp_path, path, name, pushes):
    with pytest.raises(ValueError, match=rf"{path} cannot be written.*in \.npz, or that of a folder"):
        save(pushes, tmp_path / path, name)
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(TypeError, match="dataset must be a Dataset, got list"):
        save([], tmp_path / path, name)


def test_a_folder_of_several_formats(tmp_path):
    wrench = np.arange(60.0).reshape(10, 6)
    one = Dataset([Recording(wrench, rate_hz=500, name="x")])
    (tmp_path / "rice").mkdir()
    (tmp_path / "oats").mkdir()
    np.save(tmp_path / "rice" / "1.npy", wrench)
    save(one, tmp_path / "rice" / "2.npz")
    write_good("mcap", tmp_path / "rice")
    to_h5({"wrench": wrench}, tmp_path / "oats" / "1.h5")
    save(one, tmp_path / "oats" / "2", "parquet")
    (tmp_path / "rice" / "notes.txt").write_text("passed over")
    data = load(tmp_path, rate_hz=500)
    assert data.y.tolist() == ["oats"] * 2 + ["rice"] * 3
    assert [np.array_equal(recording.wrench, wrench) for recording in data] == [True] * 4 + [False]


def test_label_of_index_wins_over_file_over_folder(tmp_path):
    known = Recording(np.zeros((4, 6)), rate_hz=500, label="basmati", session="tuesday", name="x")
    (tmp_path / "rice").mkdir()
    save(Dataset([known]), tmp_path / "rice" / "1.npz")
    data = load(tmp_path)
    assert (data[0].label, data[0].session) == ("basmati", "tuesday")
    assert data.history[-1].notes[0] == "label: what the file says ('basmati' of rice/1.npz)"
    assert load(tmp_path, label="folder")[0].label == "rice"
    (tmp_path / "index.csv").write_text(
        'file,label,operator,trigger_index\nrice/1.npz,jasmine,"Ann, Bob",2\n'
    )
    (indexed,) = load(tmp_path)
    assert (indexed.label, indexed.session, indexed.trigger_index) == ("jasmine", "tuesday", 2)
    assert dict(indexed.meta) == {"operator": "Ann, Bob"}
    save(Dataset([known] * 2), tmp_path / "two.npz")
    (tmp_path / "index.csv").write_text("file,label,trigger_index\ntwo.npz,rice,2\n")
    with pytest.raises(RecordingFileError, match=r"two\.npz: start_time and trigger_index .* a file of 2"):
        load(tmp_path)


@pytest.mark.parametrize("text", ["", "3", '[{"step": 4}]'])
def test_a_broken_history_is_refused(tmp_path, text, pushes):
    save(pushes, tmp_path / "set", "csv")
    (tmp_path / "set" / "history.json").write_text(text)
    with pytest.raises(RecordingFileError, match=r"history\.json: is no history of a data set"):
        load(tmp_path / "set")


@pytest.mark.parametrize("error", [KeyError("x"), RecursionError()])
def test_errors_of_libraries_name_the_file(tmp_path, monkeypatch, error):
    for name in ("rice_1.csv", "rice_2.csv"):
        (tmp_path / name).write_text("fx,fy,fz,tx,ty,tz\n1,2,3,4,5,6\n1,2,3,4,5,6\n")

    def read(source, options):
        if source.path.name == "rice_2.csv":
            raise error
        return FORMATS[0].read(source, options)

    monkeypatch.setattr(sources, "FORMATS", (replace(FORMATS[0], read=read),))
    with pytest.raises(RecordingFileError, match=r"rice_2\.csv: reading it as csv failed with") as caught:
        load(tmp_path, rate_hz=10)
    assert caught.value.__cause__ is error
    assert load(tmp_path, rate_hz=10, on_error="skip").names == ("rice_1.csv",)


@pytest.mark.parametrize(
    ("file", "library"),
    [("x.csv", "pandas"), ("x.mcap", "rosbags.highlevel"), ("x.bag", "rosbags.highlevel")],
)
def test_a_missing_library_is_named_with_its_extra(tmp_path, monkeypatch, file, library):
    (tmp_path / file).write_text("fx,fy,fz,tx,ty,tz\n1,2,3,4,5,6\n")
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(ImportError, match=rf"^{library.partition('.')[0]} is needed .*pip install '"):
        load(tmp_path / file)


LABELS = (
    "../../up|/etc/passwd|a/b|a\\b|CON|com1.txt|com\u00b9|.hidden|...|\u00e4|rice|Gru\u0308tze & \u9162|"
    "\u0915\u094d\u0937\u0947\u0924\u094d\u0930|\u0301rice|\u0645\u06cc\u200c\u0634\u0648\u062f"
)


def sample(**fields):
    return Recording(np.random.default_rng(1).normal(size=(3, 6)), **{"rate_hz": 500, **fields})


def test_labels_never_become_paths(tmp_path):
    labels = [*LABELS.split("|"), "x" * 300, "\u9162" * 300, "\U0001f35a" * 3 + "\U00020000" * 300]
    data = Dataset([sample(label=label) for label in labels])
    folder = save(data, tmp_path / "set", "csv")
    assert load(folder).y.tolist() == labels
    written = sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*"))
    assert len(list(tmp_path.iterdir())) == 1
    for name in written:
        assert unicodedata.is_normalized("NFC", name)
        assert all(c in "._-/" or unicodedata.category(c)[0] in "LMN" for c in name)
        for part in name.split("/"):
            assert part[0] not in "._-"
            assert part[-1] not in "._- "
            assert len(part.encode()) < 143
            assert part.split(".")[0].lower() not in {"con", "com1", "com\u00b9"}
    assert (folder / "Gr\u00fctze_\u9162").is_dir()


def test_files_read_without_the_index_too(tmp_path):
    data = Dataset([sample(label="rice"), sample(label="rice", flags=[0, 1, 0]), sample(label=None)])
    folder = save(data, tmp_path / "set", "csv")
    assert (folder / "index.csv").read_text().splitlines()[0] == (
        "file,label,session,start_time,rate_hz,trigger_index,name,meta"
    )
    (folder / "index.csv").unlink()
    back = load(folder)
    assert back.names == ("rice/rice_1.csv", "rice/rice_2.csv", "unlabelled/unlabelled_3.csv")
    assert [r.rate_hz for r in back] == [500] * 3
    assert back[1].flags.tolist() == [0, 1, 0]


def test_relative_paths_have_ordinary_permissions(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert load(save(Dataset([sample(label="rice")]), "set", "csv")).labels == ("rice",)
    (tmp_path / "plain").mkdir()
    assert (tmp_path / "set").stat().st_mode == (tmp_path / "plain").stat().st_mode
