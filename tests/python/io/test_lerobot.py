"""LeRobot data sets: written as LeRobot reads them, read as LeRobot and others write them, exact both ways."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from dataset_strategies import assert_same_bits, datasets
from effort import cases
from granular_id.io import RecordingFileError, load, save
from granular_id.io.lerobot import writing
from granular_id.io.lerobot.writing import save_lerobot
from granular_id.recording import AXES, Dataset, Recording

pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")


RNG = np.random.default_rng(8)
DATA_FILE, EPISODES_FILE = "data/chunk-000/file-000.parquet", "meta/episodes/chunk-000/file-000.parquet"
INDICES = ("frame_index", "episode_index", "index", "task_index")
SCALARS = {
    "timestamp": {"dtype": "float32", "shape": [1], "names": None},
    **{name: {"dtype": "int64", "shape": [1], "names": None} for name in INDICES},
}
WINDOW = {"dtype": "float64", "shape": [10, 6], "names": list(AXES)}
VECTOR = {"dtype": "float32", "shape": [6], "names": ["Fx", "Fy", "Fz", "Mx", "My", "Mz"]}


def push(n=1605, rate_hz=500.0, **about):
    return Recording(RNG.normal(size=(n, 6)), rate_hz=rate_hz, **{"label": "rice", **about})


def info_of(folder):
    return json.loads((folder / "meta/info.json").read_text())


# -- data sets of others: what LeRobot's own writer leaves


def others(folder, features=None, tasks=("rice", "peas", "rice"), n_frames=(20, 21, 22), fps=50):
    """Write a data set as LeRobot 0.4.4 does; return the values of its features, episode by episode."""
    features = {
        "observation.wrench": WINDOW,
        "action": {**VECTOR, "names": list("abcdef")},
        **(features or {}),
    }
    features = {name: feature for name, feature in features.items() if feature is not None}
    texts = list(dict.fromkeys(tasks))
    episode = np.repeat(np.arange(len(n_frames)), n_frames)
    frame = np.concatenate([np.arange(n) for n in n_frames])
    n = len(frame)
    values = {
        name: RNG.normal(size=(n, *one["shape"])).astype(one["dtype"]) for name, one in features.items()
    }
    columns = {name: nested(array) for name, array in values.items()}
    columns["timestamp"] = (frame / fps).astype(np.float32)
    indices = (frame, episode, np.arange(n), np.array([texts.index(task) for task in tasks])[episode])
    columns |= dict(zip(INDICES, indices, strict=True))
    ends = np.cumsum(n_frames)
    listed = {
        "episode_index": np.arange(len(n_frames)),
        "tasks": [[task] for task in tasks],
        "length": list(n_frames),
        "dataset_from_index": ends - n_frames,
        "dataset_to_index": ends,
        "stats/action/min": [[0.0] * 6] * len(n_frames),
    }
    write(folder / DATA_FILE, columns)
    write(folder / EPISODES_FILE, listed)
    write(folder / "meta/tasks.parquet", {"task_index": range(len(texts)), "__index_level_0__": texts})
    info = {"codebase_version": "v3.0", "robot_type": "x", "fps": fps, "features": {**features, **SCALARS}}
    (folder / "meta/info.json").write_text(json.dumps(info))
    return {name: np.split(array, ends[:-1]) for name, array in values.items()}


def nested(array):
    """Fixed-size lists for vectors, lists of lists for windows: so LeRobot writes them."""
    flat = pa.array(array.reshape(-1))
    if array.ndim == 2:
        return pa.FixedSizeListArray.from_arrays(flat, array.shape[1])
    for size in array.shape[:0:-1]:
        flat = pa.ListArray.from_arrays(pa.array(range(0, len(flat) + 1, size), pa.int32()), flat)
    return flat


def write(path, columns):
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(pa.table(columns), path)


def changed(path, **columns):
    """Write a file again, some columns replaced; None leaves one out."""
    table = pq.read_table(path)
    kept = {name: table[name] for name in table.column_names}
    write(path, {name: column for name, column in {**kept, **columns}.items() if column is not None})


# -- exact both ways


@given(data=datasets(), rate=st.sampled_from([500.0, 62.5, 1e-3, 1 / 3]), k=st.sampled_from([None, 1, 2, 7]))
@settings(max_examples=cases(15), suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_any_data_set_comes_back_to_the_last_bit(tmp_path_factory, data, rate, k):
    one_rate = [replace(r, rate_hz=rate) if r.is_uniform else r for r in data]
    data = Dataset(one_rate, data.history)
    folder = tmp_path_factory.mktemp("any") / "set"
    back = load(save_lerobot(data, folder, fps=None if k is None else rate / k))
    assert_same_bits(back, data)
    assert back.history[:-1] == data.history


def test_a_data_set_in_many_files_comes_back(tmp_path, monkeypatch):
    monkeypatch.setattr(writing, "_FILE_MB", 0)
    monkeypatch.setattr(writing, "_FILES_PER_CHUNK", 2)
    data = Dataset([push(name=f"push {i}") for i in range(5)])
    folder = save(data, tmp_path / "set", "lerobot")
    names = [path.relative_to(folder).as_posix() for path in sorted(folder.rglob("data/*/*"))]
    assert names[-1] == "data/chunk-002/file-000.parquet"
    listed = pq.read_table(folder / EPISODES_FILE)
    assert listed["data/chunk_index"].to_pylist() == [0, 0, 1, 1, 2]
    assert listed["data/file_index"].to_pylist() == [0, 1, 0, 1, 0]
    assert load(folder) == data


def test_what_lost_its_footer_lost_its_history_only(tmp_path):
    data = Dataset([push(session="s", start_time=1.7e9), push(300)]).resample(250)
    folder = save(data, tmp_path / "set", "lerobot")
    changed(folder / EPISODES_FILE)
    back = load(folder)
    assert back == data
    assert len(back.history) == 1


def test_without_the_columns_of_this_package_frames_are_read_as_they_stand(tmp_path):
    data = Dataset([push(n=1605, session="s")])
    folder = save(data, tmp_path / "set", "lerobot")
    table = pq.read_table(folder / EPISODES_FILE)
    own = [name for name in table.column_names if name.startswith("granular_id/")]
    changed(folder / EPISODES_FILE, **dict.fromkeys(own))
    (back,) = load(folder)
    assert (back.n_samples, back.rate_hz, back.label, back.session) == (1610, 500, "rice", None)
    assert np.array_equal(back.wrench[:1605], data[0].wrench)
    assert (back.wrench[1605:] == data[0].wrench[-1]).all()


def test_samples_written_as_windows_may_be_cut_by_options(tmp_path):
    folder = save(Dataset([push()]), tmp_path / "set", "lerobot")
    assert load(folder, axes="fz,tz").axes == ("fz", "tz")
    assert len(load(folder, window_s=1)) == 3
    assert load(folder, isolate=True) == load(folder)


# -- what LeRobot asks for


@pytest.mark.parametrize(
    ("rate", "fps", "k"),
    [
        *((500, 50, 10), (1000, 50, 20), (7000, 50, 140), (333, 37, 9), (60, 30, 2), (30, 30, 1)),
        *((125, 25, 5), (499, 49.9, 10), (62.5, 31.25, 2), (10, 10, 1), (0.5, 0.5, 1)),
    ],
)
def test_frames_by_default(tmp_path, rate, fps, k):
    info = info_of(save_lerobot(Dataset([push(20, rate)]), tmp_path / "set"))
    assert info["fps"] == fps
    assert isinstance(info["fps"], int) == (fps % 1 == 0)
    assert info["features"]["observation.wrench"]["shape"] == ([6] if k == 1 else [k, 6])


@pytest.mark.parametrize("fps", [30, 49.9, 600, 1000.5])
def test_frames_that_do_not_divide_the_rate_are_refused(tmp_path, fps):
    with pytest.raises(ValueError, match=rf"fps={fps:g} does not divide 500 Hz; .* like 50 or 500"):
        save_lerobot(Dataset([push(20)]), tmp_path / "set", fps=fps)
    with pytest.raises(ValueError, match="fps must be positive"):
        save_lerobot(Dataset([push(20)]), tmp_path / "set", fps=0)
    assert not (tmp_path / "set").exists()


def test_recordings_of_two_rates_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"at 250, 500 Hz, and .* has one rate: call \.resample"):
        save(Dataset([push(), push(rate_hz=250)]), tmp_path / "set", "lerobot")


def test_the_information_is_what_the_loader_asks_for(tmp_path):
    data = Dataset([push(name="a"), push(300, label=None), push(1, label="peas")])
    info = info_of(save(data, tmp_path / "set", "lerobot"))
    features = info.pop("features")
    assert features == {"observation.wrench": WINDOW, **SCALARS}
    assert info == {
        "codebase_version": "v3.0",
        "robot_type": None,
        "total_episodes": 3,
        "total_frames": 161 + 30 + 1,
        "total_tasks": 3,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": 50,
        "splits": {"train": "0:3"},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": None,
    }


def test_frames_are_where_the_indices_say(tmp_path):
    data = Dataset([push(name="a"), push(300, label=None), push(1, label="peas"), push(7)])
    folder = save(data, tmp_path / "set", "lerobot")
    file = pq.ParquetFile(folder / DATA_FILE)
    assert file.num_row_groups == len(data)
    frames, listed = file.read(), pq.read_table(folder / EPISODES_FILE)
    assert frames.column_names == ["observation.wrench", *SCALARS]
    assert [str(frames[name].type) for name in SCALARS] == ["float", *["int64"] * 4]
    assert frames["index"].to_pylist() == list(range(len(frames)))
    assert listed["tasks"].to_pylist() == [["rice"], ["unlabelled"], ["peas"], ["rice"]]
    starts, ends = listed["dataset_from_index"].to_pylist(), listed["dataset_to_index"].to_pylist()
    for i, (start, end) in enumerate(zip(starts, ends, strict=True)):
        rows = frames.slice(start, end - start)
        assert rows["episode_index"].unique().to_pylist() == [i]
        assert rows["task_index"].unique().to_pylist() == [[0, 1, 2, 0][i]]
        assert (
            rows["frame_index"].to_pylist()
            == list(range(end - start))
            == list(range(listed["length"][i].as_py()))
        )
        assert np.array_equal(rows["timestamp"], (np.arange(end - start) / 50).astype(np.float32))
        wrench = np.array(rows["observation.wrench"].to_pylist()).reshape(-1, 6)
        assert np.array_equal(wrench[: data[i].n_samples], data[i].wrench)
        assert (wrench[data[i].n_samples :] == data[i].wrench[-1]).all()


def test_tasks_are_found_by_their_place(tmp_path):
    pandas = pytest.importorskip("pandas")
    folder = save(Dataset([push(5), push(5, label="peas")]), tmp_path / "set", "lerobot")
    tasks = pandas.read_parquet(folder / "meta/tasks.parquet")
    assert [tasks.iloc[i].name for i in range(2)] == ["rice", "peas"]
    assert tasks.loc["peas"].task_index == 1


def test_statistics_are_those_of_the_samples(tmp_path):
    data = Dataset([push(), push(300)])
    folder = save(data, tmp_path / "set", "lerobot")
    stats = json.loads((folder / "meta/stats.json").read_text())
    assert list(stats) == ["observation.wrench", *SCALARS]
    found, X = stats["observation.wrench"], np.concatenate([r.wrench for r in data])
    frames = [161, 30]
    assert found["count"] == [191]
    assert found["min"] == X.min(axis=0).tolist()
    assert found["max"] == X.max(axis=0).tolist()
    mean = np.average([r.wrench.mean(axis=0) for r in data], axis=0, weights=frames)
    spread = [(r.wrench.std(axis=0) ** 2 + (r.wrench.mean(axis=0) - mean) ** 2) for r in data]
    assert np.allclose(found["mean"], mean)
    assert np.allclose(found["std"], np.sqrt(np.average(spread, axis=0, weights=frames)))
    halves = np.average([np.median(r.wrench, axis=0) for r in data], axis=0, weights=frames)
    assert np.allclose(found["q50"], halves)
    assert sorted(found) == ["count", "max", "mean", "min", "q01", "q10", "q50", "q90", "q99", "std"]
    assert stats["frame_index"]["max"] == [160]
    listed = pq.read_table(folder / EPISODES_FILE)
    assert listed["stats/observation.wrench/max"].to_pylist() == [r.wrench.max(axis=0).tolist() for r in data]
    assert listed["stats/index/count"].to_pylist() == [[161], [30]]


def test_frames_of_irregular_recordings_have_their_own_stamps(tmp_path):
    time_s = np.cumsum([0.0, *RNG.uniform(0.001, 0.003, 99)])
    data = Dataset([push(100), Recording(RNG.normal(size=(100, 6)), time_s=time_s)])
    folder = save(data, tmp_path / "set", "lerobot")
    stamps = pq.read_table(folder / DATA_FILE)["timestamp"].to_numpy()
    assert np.array_equal(stamps[10:], time_s[::10].astype(np.float32))
    alone = save(data[1:], tmp_path / "alone", "lerobot")
    assert 20 < info_of(alone)["fps"] <= 50


# -- what others wrote


def test_a_windowed_wrench_is_read_at_its_own_rate(tmp_path):
    values = others(tmp_path)
    data = load(tmp_path)
    assert data.y.tolist() == ["rice", "peas", "rice"]
    assert (data.rate_hz, data.axes) == (500, AXES)
    assert data.names == tuple(f"{tmp_path.name}[{i}]" for i in range(3))
    for recording, window in zip(data, values["observation.wrench"], strict=True):
        assert np.array_equal(recording.wrench, window.reshape(-1, 6))
    assert data.history[-1].notes == (
        "observation.wrench has 10 samples in each of 50 frames a second: 500 Hz",
        "features that are not read: action",
    )


def test_windows_of_the_newest_samples_are_refused(tmp_path):
    others(tmp_path)
    samples = RNG.normal(size=(6 * 63, 6))
    windows = np.stack([samples[5 * i : 5 * i + 10] for i in range(63)])  # half of each is the one before
    changed(tmp_path / DATA_FILE, **{"observation.wrench": nested(windows)})
    with pytest.raises(RecordingFileError, match="its windows overlap"):
        load(tmp_path)


def test_a_wrench_a_frame_is_read_at_the_rate_of_frames(tmp_path):
    values = others(tmp_path, {"observation.wrench": VECTOR}, fps=30)
    data = load(tmp_path)
    assert (data.rate_hz, data.axes) == (30, AXES)
    assert np.array_equal(data[1].wrench, values["observation.wrench"][1])


@pytest.mark.parametrize(
    "names",
    [
        None,
        [],
        ["wrench"],
        {"axes": list(AXES)},
        [list(AXES)],
        {axis: i for i, axis in enumerate(AXES)},
        ["force_x", "force_y", "force_z", "torque_x", "torque_y", "torque_z"],
    ],
)
def test_names_of_axes_in_every_way(tmp_path, names):
    values = others(tmp_path, {"observation.wrench": {**VECTOR, "names": names}})
    (recording, *_) = load(tmp_path)
    assert recording.axes == AXES
    assert np.array_equal(recording.wrench, values["observation.wrench"][0])


@pytest.mark.parametrize("names", [["samples", "axes"], [[*"0123456789"], list(AXES)]])
def test_names_of_both_dimensions(tmp_path, names):
    others(tmp_path, {"observation.wrench": {**WINDOW, "names": names}})
    assert load(tmp_path)[0].axes == AXES


def test_axes_in_another_order_and_other_units(tmp_path):
    names = ["tx [mNm]", "ty [mNm]", "tz [mNm]", "fx [N]", "fy [N]", "fz [N]"]
    values = others(tmp_path, {"observation.wrench": {**VECTOR, "names": names}})["observation.wrench"][0]
    (recording, *_) = data = load(tmp_path)
    assert recording.axes == AXES
    assert np.array_equal(recording.wrench[:, :3], values[:, 3:])
    assert np.allclose(recording.wrench[:, 3:], values[:, :3] / 1000, rtol=1e-15)
    assert "tx from column 0 (tx [mNm]) times 0.001" in data.history[-1].notes[0]


def test_the_feature_and_its_axes_may_be_named(tmp_path):
    names = ["x", "y", "force_x", "force_y", "force_z", "torque_x", "torque_y", "torque_z", "grip"]
    state = {"dtype": "float32", "shape": [9], "names": names}
    values = others(tmp_path, {"observation.wrench": None, "observation.state": state})["observation.state"]
    way_out = "pass array= with the one that holds the wrench: action, observation.state"
    with pytest.raises(RecordingFileError, match=f"no feature 'observation.wrench'; {way_out}"):
        load(tmp_path)
    data = load(tmp_path, array="observation.state")
    assert data.axes == AXES
    assert np.array_equal(data[2].wrench, values[2][:, 2:8])
    other = load(tmp_path, array="observation.state", axes="y,grip", units="mm,mm")
    assert other.axes == ("y", "grip")
    assert other[0].meta["units"]["grip"] == "mm"
    assert np.array_equal(other[2].wrench, values[2][:, [1, 8]])


def test_units_that_nobody_stated_can_be_stated(tmp_path):
    values = others(tmp_path)["observation.wrench"][0].reshape(-1, 6)
    recording = load(tmp_path, units="mN,mNm")[0]
    assert np.allclose(recording.wrench, values / 1000, rtol=1e-15)


def test_other_axes_without_names_are_named(tmp_path):
    others(tmp_path, {"observation.wrench": {**VECTOR, "shape": [3], "names": None}})
    with pytest.raises(RecordingFileError, match=r"feature observation\.wrench: has 3 columns without names"):
        load(tmp_path)
    assert load(tmp_path, axes="fx,fy,fz").axes == ("fx", "fy", "fz")


def test_a_column_of_a_type_that_another_library_registered(tmp_path):
    class Array2D(pa.ExtensionType):
        def __init__(self):
            super().__init__(pa.list_(pa.list_(pa.float64())), "test.Array2D")

        def __arrow_ext_serialize__(self):
            return b""

        @classmethod
        def __arrow_ext_deserialize__(cls, *_):
            return cls()

    values = others(tmp_path)
    windows = pq.read_table(tmp_path / DATA_FILE)["observation.wrench"].combine_chunks()
    pa.register_extension_type(Array2D())
    try:
        changed(
            tmp_path / DATA_FILE, **{"observation.wrench": pa.ExtensionArray.from_storage(Array2D(), windows)}
        )
        (recording, *_) = load(tmp_path)
    finally:
        pa.unregister_extension_type("test.Array2D")
    assert np.array_equal(recording.wrench, values["observation.wrench"][0].reshape(-1, 6))
    assert load(tmp_path)[0] == recording


def test_a_data_set_may_lie_among_other_files(tmp_path):
    others(tmp_path / "monday" / "lerobot")
    save(Dataset([push(rate_hz=500)]), tmp_path / "monday" / "more.npz")
    data = load(tmp_path)
    assert len(data) == 4
    assert sorted(data.y) == ["peas", "rice", "rice", "rice"]


# -- what cannot be meant


def with_info(**entries):
    def change(folder):
        info = {**info_of(folder), **entries}
        (folder / "meta/info.json").write_text(
            json.dumps({name: value for name, value in info.items() if value is not None})
        )

    return change


def with_wrench(**entries):
    def change(folder):
        info = info_of(folder)
        info["features"]["observation.wrench"] |= entries
        with_info(features=info["features"])(folder)

    return change


def with_data(**columns):
    return lambda folder: changed(folder / DATA_FILE, **columns)


def with_frame(name, row, value):
    def change(folder):
        values = pq.read_table(folder / DATA_FILE)[name].to_pylist()
        values[row] = value
        changed(folder / DATA_FILE, **{name: values})

    return change


def cut_off(name):
    def change(folder):
        data = (folder / name).read_bytes()
        (folder / name).write_bytes(data[: len(data) // 2])

    return change


BAD = {
    "version 2.1": (
        with_info(codebase_version="v2.1"),
        "wanted v3.0, and LeRobot's convert_dataset_v21_to_v30",
    ),
    "version 4": (with_info(codebase_version="v4.0"), "is of version 'v4.0'; wanted v3.0, and this version"),
    "no version": (with_info(codebase_version=None), "info.json: has no codebase_version"),
    "a list": (lambda folder: (folder / "meta/info.json").write_text("[]"), "has no codebase_version"),
    "no JSON": (cut_off("meta/info.json"), "info.json: is no JSON"),
    "fps": (with_info(fps=0), "fps is 0; wanted frames a second, more than 0"),
    "fps as text": (with_info(fps="50"), "fps is '50'; wanted"),
    "no features": (with_info(features=None), "names no features"),
    "pictures": (with_wrench(dtype="video"), "feature observation.wrench: holds 'video'; wanted numbers"),
    "three dimensions": (with_wrench(shape=[2, 5, 6]), r"has shape \[2, 5, 6\]; wanted \(axes,\), or"),
    "a shape of nothing": (with_wrench(shape=[0, 6]), r"has shape \[0, 6\]; wanted"),
    "another shape": (
        with_wrench(shape=[5, 6]),
        r"a frame has 10 values where 5 are wanted, of shape \(5, 6\)",
    ),
    "a flat shape": (with_wrench(shape=[60], names=None), "has 60 columns without names; pass axes="),
    "five names": (
        with_wrench(names=list(AXES[:5])),
        r"has the names .* for shape \(10, 6\); wanted 6 different",
    ),
    "a name twice": (with_wrench(names=["fx", *AXES[:5]]), "wanted 6 different ones, or null"),
    "joints": (
        with_wrench(names=[f"joint_{i}.pos" for i in range(6)]),
        "joint_5.pos; pass array= with the feature, or axes= with",
    ),
    "two of one": (with_wrench(names=["Fx", "force_x", *AXES[2:]]), "mean fx"),
    "no time": (with_data(timestamp=None), "has no column 'timestamp'; wanted observation.wrench, timestamp"),
    "no wrench": (with_data(**{"observation.wrench": None}), "no column 'observation.wrench'"),
    "texts": (with_data(timestamp=["x"] * 63), "column timestamp: holds string"),
    "an empty cell": (with_frame("timestamp", 3, None), "column timestamp: holds double, or empty cells"),
    "an empty frame": (with_frame("observation.wrench", 3, None), "a frame has 0 values where 10 are wanted"),
    "a short frame": (
        with_frame("observation.wrench", 3, [[0.0] * 6] * 9),
        "a frame has 9 values where 10 are wanted",
    ),
    "not finite": (
        with_frame("observation.wrench", 25, [[float("nan")] * 6] * 10),
        r"recording 1 \('.*\[1\]'\), sample 50\) is nan; wanted finite numbers",
    ),
    "a clock of its own": (
        with_data(timestamp=np.arange(63, dtype=np.float32)),
        "frame 1 of episode 0 is 0.98 s away from its place at 50 frames a second",
    ),
    "a late frame": (with_frame("timestamp", 30, 5.0), "frame 10 of episode 1 is 4.8 s away"),
    "a frame too few": (
        with_data(frame_index=np.arange(63)),
        "holds 63 frames of 3 episodes, not in their order",
    ),
    "another length": (
        lambda folder: changed(folder / EPISODES_FILE, length=[20, 21, 23]),
        "not in their order the 64 of 3 that meta/episodes lists",
    ),
    "no length": (lambda folder: changed(folder / EPISODES_FILE, length=None), "has no column 'length'"),
    "an empty length": (
        lambda folder: changed(folder / EPISODES_FILE, length=[20, None, 22]),
        "lists no episodes, or one without frames",
    ),
    "two tasks": (with_frame("task_index", 25, 0), "episode 1 has the tasks 'peas' and 'rice'; wanted one"),
    "an unknown task": (with_data(task_index=np.full(63, 7)), "tasks.parquet: has no task 7"),
    "no tasks": (
        lambda folder: (folder / "meta/tasks.parquet").unlink(),
        r"a part of .*without meta/tasks\.",
    ),
    "no information": (
        lambda folder: (folder / "meta/info.json").unlink(),
        "a part of .*without meta/info.json",
    ),
    "no data": (
        lambda folder: shutil.rmtree(folder / "data"),
        "a part of .*, without data; wanted the whole",
    ),
    "another number of episodes": (
        with_info(total_episodes=9),
        "states total_episodes 9, and meta/epi.*lists 3",
    ),
    "tasks of no texts": (
        lambda folder: changed(folder / "meta/tasks.parquet", __index_level_0__=None),
        "wanted task_index and one of texts",
    ),
    "frames cut off": (cut_off(DATA_FILE), r"file-000\.parquet: reading it as Parquet failed"),
    "episodes cut off": (cut_off(EPISODES_FILE), r"file-000\.parquet: reading it as Parquet failed"),
    "no frames": (lambda folder: (folder / DATA_FILE).unlink(), "data: holds no chunk-"),
}


@pytest.mark.parametrize("kind", BAD)
def test_what_cannot_be_meant_is_refused_in_one_line(tmp_path, kind):
    change, message = BAD[kind]
    others(tmp_path)
    change(tmp_path)
    with pytest.raises(RecordingFileError, match=message) as caught:
        load(tmp_path)
    assert str(caught.value).startswith(str(tmp_path))
    assert "\n" not in str(caught.value)


OWN_BAD = {
    "fewer samples": (
        {"granular_id/n_samples": [1500]},
        "161 frames of 10 samples, .*n_samples 1500 .* changed since",
    ),
    "another task": (
        {"tasks": [["sand"]]},
        r"has the tasks \['sand'\], but granular_id/label 'rice': changed",
    ),
    "another rate": ({"granular_id/rate_hz": [400.0]}, "rate_hz 400: changed since; without the columns"),
    "stamps of others": (
        {"granular_id/time_s": [[0.0, 1.0]]},
        "time_s has 2 values for 1605 samples in row 0",
    ),
    "a trigger behind": ({"granular_id/trigger_index": [1605]}, "trigger_index"),
    "no label": ({"granular_id/label": [" "]}, "label"),
    "no meta": ({"granular_id/meta": ["[1]"]}, "meta"),
}


def test_a_task_that_was_renamed_is_noticed(tmp_path):
    folder = save(Dataset([push()]), tmp_path / "set", "lerobot")
    changed(folder / "meta/tasks.parquet", task=["basmati"])
    with pytest.raises(
        RecordingFileError, match="names the task of episode 0 'basmati', but granular_id/label 'rice'"
    ):
        load(folder)


def test_a_stamp_that_was_moved_is_noticed(tmp_path):
    folder = save(Dataset([push(n=1605)]), tmp_path / "set", "lerobot")
    changed(folder / DATA_FILE, timestamp=np.arange(161, dtype=np.float32) / 50 + 0.5 * (np.arange(161) == 7))
    with pytest.raises(RecordingFileError, match=r"frame 7 of episode 0 is 0\.5 s away from its place"):
        load(folder)


@pytest.mark.parametrize("kind", OWN_BAD)
def test_what_this_package_wrote_is_checked_too(tmp_path, kind):
    columns, message = OWN_BAD[kind]
    folder = save(Dataset([push(n=1605)]), tmp_path / "set", "lerobot")
    changed(folder / EPISODES_FILE, **columns)
    with pytest.raises(RecordingFileError, match=message):
        load(folder)


@pytest.mark.parametrize(
    ("entry", "message"), [("[]", "holds no version"), ('{"version": 2, "history": []}', "wanted 1")]
)
def test_a_footer_of_another_version_is_refused(tmp_path, entry, message):
    folder = save(Dataset([push(n=1605)]), tmp_path / "set", "lerobot")
    table = pq.read_table(folder / EPISODES_FILE).replace_schema_metadata({"granular_id": entry})
    pq.write_table(table, folder / EPISODES_FILE)
    with pytest.raises(RecordingFileError, match=f"footer: .*{message}"):
        load(folder)


def test_a_changed_byte_is_noticed(tmp_path):
    folder = save(Dataset([push()]), tmp_path / "set", "lerobot")
    data = bytearray((folder / DATA_FILE).read_bytes())
    data[1000] ^= 1
    (folder / DATA_FILE).write_bytes(data)
    with pytest.raises(RecordingFileError, match=r"file-000\.parquet: cannot be decoded"):
        load(folder)
