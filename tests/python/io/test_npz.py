"""NPZ and NPY files: whole data sets there and back, with plain numpy as the other side in both directions."""

import json

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

from dataset_strategies import assert_same_bits, datasets
from granular_id.io import RecordingFileError, load, save
from granular_id.io.npz.npz import save_npz
from granular_id.recording import Dataset, Recording

RNG = np.random.default_rng(5)
ONE = RNG.normal(size=(50, 6))
WRENCH = np.arange(36.0).reshape(2, 3, 6) - 17.5


def _small() -> Dataset:
    regular = Recording(
        WRENCH[0],
        rate_hz=500,
        label="oat flakes",
        session="mon",
        start_time=1.7e9,
        name="one",
        meta={"tool": {"d_mm": 17}},
    )
    stamped = Recording(
        WRENCH[1], time_s=[0, 0.25, 0.375], name="two", trigger_index=1, flags=[0, 1, 2], label="peas"
    )
    return Dataset([regular, stamped])


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=40)
@given(dataset=datasets())
def test_what_is_saved_is_loaded_to_the_last_bit(tmp_path, dataset):
    path = tmp_path / "set.npz"
    path.unlink(missing_ok=True)
    read = load(save(dataset, path))
    assert_same_bits(read, dataset)
    assert read == dataset
    assert read.history[:-1] == dataset.history


def test_plain_numpy_reads_what_is_saved(tmp_path):
    with np.load(save(_small(), tmp_path / "set.npz"), allow_pickle=False) as arrays:
        assert str(arrays["format"]) == "granular_id recordings 1"
        assert arrays["axes"].tolist() == ["fx", "fy", "fz", "tx", "ty", "tz"]
        assert np.array_equal(arrays["wrench"], WRENCH.reshape(6, 6))
        assert arrays["n_samples"].tolist() == [3, 3]
        assert arrays["label"].tolist() == ["oat flakes", "peas"]
        assert arrays["session"].tolist() == ["mon", ""]
        assert arrays["name"].tolist() == ["one", "two"]
        assert np.array_equal(arrays["rate_hz"], [500, np.nan], equal_nan=True)
        assert np.array_equal(arrays["start_time"], [1.7e9, np.nan], equal_nan=True)
        assert arrays["trigger_index"].tolist() == [-1, 1]
        assert np.array_equal(arrays["time_s"], [np.nan] * 3 + [0, 0.25, 0.375], equal_nan=True)
        assert arrays["flags"].tolist() == [0, 0, 0, 0, 1, 2]
        lines = arrays["meta"].tobytes().decode().split("\n")
        assert [json.loads(line) for line in lines] == [{"tool": {"d_mm": 17}}, {}]
        assert json.loads(arrays["history"].tobytes()) == []


def test_what_plain_numpy_saves_in_the_format_is_loaded(tmp_path):
    recordings = [np.ones((2, 6)), np.full((3, 6), -0.0)]
    np.savez_compressed(
        tmp_path / "set.npz",
        format="granular_id recordings 1",
        axes=["fx", "fy", "fz", "tx", "ty", "tz"],
        wrench=np.concatenate(recordings),
        n_samples=[2, 3],
        rate_hz=[500.0, 500.0],
        start_time=[np.nan, np.nan],
        trigger_index=[-1, 2],
        label=["rice", ""],
        session=["", ""],
        name=["a", "b"],
        meta=np.frombuffer(b"{}\n{}", np.uint8),
        history=np.frombuffer(b"[]", np.uint8),
    )
    expected = [
        Recording(recordings[0], rate_hz=500, label="rice", name="a"),
        Recording(recordings[1], rate_hz=500, name="b", trigger_index=2),
    ]
    assert_same_bits(load(tmp_path / "set.npz"), Dataset(expected))


def test_existing_files_stay_and_nothing_half_written_is_left(tmp_path):
    path = tmp_path / "set.npz"
    path.write_text("mine")
    with pytest.raises(FileExistsError, match="nothing is overwritten"):
        save_npz(_small(), path)
    assert path.read_text() == "mine"

    def stop(done, total, what):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        save_npz(_small(), tmp_path / "other.npz", progress=stop)
    assert [p.name for p in tmp_path.iterdir()] == ["set.npz"]


def test_the_same_data_gives_the_same_bytes(tmp_path):
    one, other = save(_small(), tmp_path / "a.npz"), save(_small(), tmp_path / "b.npz")
    assert one.read_bytes() == other.read_bytes()


def test_samples_are_held_once(tmp_path):
    import tracemalloc

    block = np.zeros((50, 1600, 6))
    path = save(Dataset([Recording(wrench, rate_hz=500) for wrench in block]), tmp_path / "set.npz")
    load(path)
    tracemalloc.start()
    load(path).X  # noqa: B018  (X is made when it is asked for)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1.5 * block.nbytes


@pytest.mark.data
def test_a_thousand_real_recordings_keep_every_bit(tmp_path, data_dir):
    dataset = load(data_dir / "sliding_wrench")
    assert_same_bits(load(save(dataset, tmp_path / "sliding.npz")), dataset)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": np.array("granular_id recordings 2")}, "is of the format 'granular_id recordings 2'"),
        ({"n_samples": None}, "the array 'n_samples' is missing"),
        ({"n_samples": np.array([3, 2])}, "n_samples adds up to 5, but wrench has 6"),
        ({"label": np.array([b"rice", b""])}, "array label: has shape .*wanted a list of texts"),
        ({"label": np.array([0x7FFFFFFF, 0], "<u4").view("<U1")}, "array label: .*wanted a list of texts"),
        ({"meta": np.array([255], np.uint8)}, "array meta as UTF-8"),
        ({"meta": np.frombuffer(b"{}", np.uint8)}, "meta has 1 values for 2 recordings"),
        ({"wrench": np.full((6, 6), np.nan)}, r"wrench\[0, 0\]"),
    ],
)
def test_files_in_the_format_that_contradict_themselves(tmp_path, change, message):
    with np.load(save(_small(), tmp_path / "set.npz")) as file:
        arrays = {**file, **change}
    np.savez(tmp_path / "bad.npz", **{name: array for name, array in arrays.items() if array is not None})
    with pytest.raises(RecordingFileError, match=message):
        load(tmp_path / "bad.npz")


@pytest.mark.parametrize("write", [np.savez, np.savez_compressed])
def test_archives_cut_or_changed_anywhere_are_refused(tmp_path, write):
    path = tmp_path / "x.npz"
    write(path, X=WRENCH, fs=500)
    data = path.read_bytes()
    for tenth in range(10):
        path.write_bytes(data[: tenth * len(data) // 10])
        with pytest.raises(RecordingFileError):
            load(path)
    start = data.index(b"NUMPY") + 128 if write is np.savez else 100
    path.write_bytes(data[:start] + bytes([data[start] ^ 1]) + data[start + 1 :])  # the checksum tells
    with pytest.raises(RecordingFileError, match="array X"):
        load(path)


def test_bombs_text_and_objects_are_refused(tmp_path):
    path = tmp_path / "x.npz"
    np.savez_compressed(path, X=np.zeros((100, 20_000, 6)))
    with pytest.raises(RecordingFileError, match="array X: would expand from"):
        load(path, rate_hz=500)
    np.savez(path, X=np.array([{"a": 1}], dtype=object))
    with pytest.raises(RecordingFileError, match="array X: holds Python objects"):
        load(path, rate_hz=500)
    path.write_bytes(b"time,fx\n1,2\n")
    with pytest.raises(RecordingFileError, match="is no NPZ archive"):
        load(path)


# -- .npy


def _npy(tmp_path, array, **settings):
    np.save(tmp_path / "push.npy", array)
    return load(tmp_path / "push.npy", **settings)


def test_one_recording(tmp_path):
    data = _npy(tmp_path, ONE, rate_hz=500)
    assert np.array_equal(data[0].wrench, ONE)
    assert (data.names, data.rate_hz) == (("push.npy",), 500)


def test_one_recording_with_its_axes_first_is_turned_and_said(tmp_path):
    data = _npy(tmp_path, ONE.T, rate_hz=500)
    assert np.array_equal(data[0].wrench, ONE)
    assert "values (6, 50) taken as axes, samples" in data.history[-1].notes


@pytest.mark.parametrize("dtype", ["f4", ">f8", "<i2", "u1", "f2"])
@pytest.mark.parametrize("order", ["C", "F"])
def test_other_types_and_orders_hold_what_numpy_reads(tmp_path, dtype, order):
    array = np.asarray(RNG.integers(0, 99, (4, 50, 6)), dtype, order=order)
    data = _npy(tmp_path, array, rate_hz=500)
    assert np.array_equal(data.X, np.load(tmp_path / "push.npy"))


def test_fields_of_a_table_are_axes_and_time(tmp_path):
    table = np.zeros(
        50, [(name, "f8") for name in ("t", "Fx", "Fy", "Fz", "Mx", "My", "Mz")] + [("temp", "f4")]
    )
    table["t"] = np.arange(50) / 62.5
    for i, name in enumerate(table.dtype.names[1:7]):
        table[name] = ONE[:, i]
    data = _npy(tmp_path, table)
    assert np.array_equal(data[0].wrench, ONE)
    assert data.rate_hz == 62.5
    assert "not used: temp (50,) float32" in data.history[-1].notes


def test_labels_come_from_the_names_of_files(tmp_path):
    for name in ("rice_1", "rice_2", "peas_1"):
        np.save(tmp_path / f"{name}.npy", ONE)
    assert load(tmp_path, rate_hz=500).y.tolist() == ["peas", "rice", "rice"]


def test_a_clock_is_no_array_of_samples(tmp_path):
    with pytest.raises(RecordingFileError, match=r"no recordings are recognised.*values \(50,\) float64"):
        _npy(tmp_path, np.arange(50.0), rate_hz=500)


def test_what_an_npy_file_cannot_hold_is_not_advised(tmp_path):
    with pytest.raises(RecordingFileError, match=r"has neither a rate nor stamps; pass rate_hz=$"):
        _npy(tmp_path, ONE)
    with pytest.raises(RecordingFileError, match=r"this holds one array: save an \.npz file with X of shape"):
        _npy(tmp_path, ONE[:, :5], rate_hz=500)
    with pytest.raises(RecordingFileError, match=r"save values\[\.\.\., 1:\] as X"):
        _npy(tmp_path, np.zeros((50, 7)), rate_hz=500)


def test_objects_are_refused_with_a_way_round(tmp_path):
    ragged = np.empty(2, object)
    ragged[:] = [ONE, ONE[:9]]
    with pytest.raises(RecordingFileError, match=r"could run code; save texts as .*rice_01=first"):
        _npy(tmp_path, ragged, rate_hz=500)
    np.savez(tmp_path / "two.npz", rice_01=ONE, rice_02=ONE[:9])
    data = load(tmp_path / "two.npz", rate_hz=500)
    assert ([r.n_samples for r in data], data.labels) == ([50, 9], ("rice",))
