"""NPZ files: whole data sets there and back, with plain numpy as the other side in both directions."""

import json

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

from dataset_strategies import assert_same_bits, datasets
from granular_id.io import load, save
from granular_id.io.npz.npz import save_npz
from granular_id.recording import Dataset, Recording

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


@pytest.mark.parametrize("write", [np.savez, np.savez_compressed])
@pytest.mark.parametrize("dtype", [np.float64, np.float32, ">f8", np.int16])
@pytest.mark.parametrize("order", ["C", "F"])
def test_archives_of_others_hold_what_numpy_reads(tmp_path, write, dtype, order):
    samples = np.asarray(np.random.default_rng(3).integers(-99, 99, (4, 50, 6)), dtype, order=order)
    write(tmp_path / "x.npz", X=samples, y=["rice", "peas"] * 2, rate_hz=500)
    data = load(tmp_path / "x.npz")
    with np.load(tmp_path / "x.npz") as arrays:
        assert np.array_equal(data.X, arrays["X"])
        assert data.X.dtype == np.float64
        assert data.y.tolist() == arrays["y"].tolist()
    assert data.rate_hz == 500
    assert "X (4, 50, 6) taken as recordings, samples, axes" in data.history[-1].notes


def test_names_with_slashes_are_groups(tmp_path):
    np.savez(tmp_path / "x.npz", **{"rice/1": WRENCH[0], "rice/2": WRENCH[1], "peas/1": WRENCH[0], "fs": 100})
    data = load(tmp_path / "x.npz")
    assert data.y.tolist() == ["rice", "rice", "peas"]
    assert data.names == ("rice/1", "rice/2", "peas/1")


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


def test_progress_counts_the_arrays(tmp_path):
    calls = []
    save_npz(_small(), tmp_path / "set.npz", progress=lambda *call: calls.append(call))
    assert [done for done, _, _ in calls] == list(range(1, calls[0][1] + 1))
    assert ("wrench") in [what for _, _, what in calls]


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
