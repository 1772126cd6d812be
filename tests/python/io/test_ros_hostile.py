"""Bags cut off, damaged or made to do harm: each is refused with the file named, before it takes memory."""

from __future__ import annotations

import tracemalloc

import pytest

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

from bag_folder_attacks import FOLDER_ATTACKS, folder_of, metadata
from granular_id.io import RecordingFileError, load
from granular_id.io.ros import mcap_file
from mcap_attacks import MCAP_ATTACKS, channel, chunk, mcap, schema, whole_chunk
from ros_attacks import BAG_ATTACKS, DB3_ATTACKS, database, insert
from ros_cases import (
    KINDS,
    ROS1,
    ROS2,
    even_stamps,
    one_topic,
    payloads,
    read,
    samples,
    write_bag1,
    write_bag2,
    write_kind,
    write_mcap,
)


def good(folder, kind):
    """Return a bag without a fault, as one file."""
    if kind == "mcap":
        return write_mcap(folder / "x.mcap", one_topic(ROS2, samples(), even_stamps()))
    if kind == "bag":
        return write_bag1(folder / "x.bag", one_topic(ROS1, samples(), even_stamps()))
    path = write_bag2(folder / "x", one_topic(ROS2, samples(), even_stamps()))
    return (path / "x.db3").rename(folder / "x.db3")


ATTACKS = {
    f"{kind}: {name}": attack
    for kind, attacks in (
        ("mcap", MCAP_ATTACKS),
        ("bag", BAG_ATTACKS),
        ("db3", DB3_ATTACKS),
        ("folder", FOLDER_ATTACKS),
    )
    for name, attack in attacks.items()
}


HEAVY = [name for name in ATTACKS if any(word in name for word in ("bomb", "giant", "terabyte", "GiB"))]


@pytest.mark.parametrize("name", [name for name in ATTACKS if name not in HEAVY])
def test_attack_is_refused(tmp_path, name):
    make, problem = ATTACKS[name]
    path = make(tmp_path)
    with pytest.raises(RecordingFileError, match=problem) as caught:
        read(path)
    assert caught.value.path.startswith(str(path))


@pytest.mark.parametrize("name", HEAVY)
def test_heavy_attack_is_refused_within_bounds(tmp_path, name):
    make, problem = ATTACKS[name]
    path = make(tmp_path)
    tracemalloc.start()
    try:
        with pytest.raises(RecordingFileError, match=problem):
            read(path)
        assert tracemalloc.get_traced_memory()[1] < 200e6
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("kind", ["mcap", "bag", "db3"])
@pytest.mark.parametrize("tenth", range(10))
def test_cut_off_anywhere(tmp_path, kind, tenth):
    path = good(tmp_path, kind)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * tenth // 10])
    with pytest.raises(RecordingFileError) as caught:
        read(path)
    assert caught.value.path == str(path)


def test_a_crashed_recording_says_what_it_still_holds(tmp_path):
    path = write_kind("mcap ZSTD", tmp_path, samples(), even_stamps())
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(
        RecordingFileError, match=r"20 messages with wrenches come before.*`mcap recover x\.mcap"
    ):
        read(path)


@pytest.mark.parametrize(
    "content", [b"", b"\0" * 100, b"time,fx\n1,2\n", bytes(range(256)) * 9], ids=range(4)
)
@pytest.mark.parametrize("name", ["x.mcap", "x.bag", "x.db3"])
def test_something_else_altogether(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(RecordingFileError, match=r"begin|SQLite"):
        load(tmp_path / name)


def test_triggers_do_not_run_and_names_are_no_settings(tmp_path):
    raw = payloads(ROS2, samples(2), even_stamps(2))
    rows = [insert(f"1, {time}, x'{data.hex()}'") for time, data in zip(even_stamps(2), raw, strict=True)]
    trigger = "CREATE TRIGGER t AFTER INSERT ON messages BEGIN DELETE FROM topics; END"
    path = database(tmp_path, *rows, trigger, name="a?mode=rwc&b#c%20d.db3")
    before = path.read_bytes()
    assert read(path).recordings[0].n_samples == 2
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_too_large_for_the_limit(tmp_path):
    for kind in ("mcap ZSTD", "bag2 sqlite None v9"):
        path = write_kind(kind, tmp_path, samples(), even_stamps())
        with pytest.raises(RecordingFileError, match="more than max_file_bytes=500"):
            read(path, max_file_bytes=500)


def test_the_files_of_a_bag_count_together(tmp_path):
    path = folder_of(tmp_path, metadata("a.mcap", "b.mcap"), files=("a.mcap", "b.mcap"))
    n_bytes = (path / "a.mcap").stat().st_size
    with pytest.raises(RecordingFileError, match=f"the files have {2 * n_bytes} bytes together"):
        read(path, max_file_bytes=n_bytes + 9)


def test_definitions_may_be_repeated_but_not_be_endless(tmp_path, monkeypatch):
    path = mcap(tmp_path, chunk(whole_chunk()), schema(), channel(), chunk(schema() + channel()))
    assert read(path).recordings[0].n_samples == 3
    monkeypatch.setattr(mcap_file, "_LARGEST_RECORD", 20)
    with pytest.raises(RecordingFileError, match="bytes of names and text; at most 20 are read"):
        read(path)


@pytest.mark.parametrize("kind", KINDS)
def test_inputs_are_not_touched(tmp_path, kind):
    path = write_kind(kind, tmp_path, samples(), even_stamps())
    before = {file: file.read_bytes() for file in sorted(tmp_path.rglob("*")) if file.is_file()}
    read(path)
    assert {file: file.read_bytes() for file in sorted(tmp_path.rglob("*")) if file.is_file()} == before
