"""Mutated bags: whatever bytes change, a bag is read or refused by name; nothing else is ever raised."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

from effort import cases
from granular_id.io import RecordingFileError, save
from granular_id.io.ros.wrench import decode_wrenches, foreign_definition
from granular_id.recording import Dataset, Recording
from ros_cases import STAMPED, even_stamps, read, samples, write_kind

FILES = {
    "bag1 None": "x.bag",
    "bag1 LZ4": "x.bag",
    "bag2 sqlite None v9": "x/x.db3",
    "bag2 sqlite MESSAGE v9": "x/x.db3",
    "bag2 sqlite FILE v8": "x/metadata.yaml",
    "mcap NONE": "x.mcap",
    "mcap ZSTD": "x.mcap",
    "mcap unchunked": "x.mcap",
}

mutations = st.lists(
    st.tuples(
        st.sampled_from(["set", "flip", "cut", "drop", "double", "insert"]),
        st.floats(0, 1, exclude_max=True),
        st.binary(min_size=1, max_size=9) | st.sampled_from([b"\xff" * 8, bytes(8), b"\x7f" + b"\xff" * 7]),
    ),
    min_size=1,
    max_size=4,
)


def mutated(data, changes):
    for how, where, what in changes:
        at = int(where * len(data))
        if how == "set":
            data = data[:at] + what + data[at + len(what) :]
        elif how == "flip" and data:
            data = data[:at] + bytes([data[at] ^ (what[0] or 1)]) + data[at + 1 :]
        elif how == "cut":
            data = data[:at]
        elif how == "drop":
            data = data[:at] + data[at + what[0] :]
        elif how == "double":
            data = data[:at] + data[at : at + what[0]] + data[at:]
        elif how == "insert":
            data = data[:at] + what + data[at:]
    return data


def attempt(path):
    refused = ""
    try:
        (recording,) = read(path, on_time_error="repair").recordings
    except RecordingFileError as error:
        refused = error.path
    assert refused.startswith(str(path)) or np.isfinite(recording.wrench).all()


@pytest.fixture(scope="module", params=FILES)
def bag(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("fuzz")
    path = write_kind(request.param, folder, samples(4), even_stamps(4))
    file = folder / FILES[request.param]
    return path, file, file.read_bytes()


@settings(max_examples=cases(15))
@given(changes=mutations)
def test_mutated_bags(bag, changes):
    path, file, data = bag
    file.write_bytes(mutated(data, changes))
    attempt(path)


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    path = tmp_path_factory.mktemp("own") / "x.mcap"
    recording = Recording(
        samples(4),
        time_s=[0, 0.1, 0.25, 0.3],
        flags=[0, 1, 2, 0],
        label="rice",
        trigger_index=2,
        meta={"a": [1, "b"]},
    )
    save(Dataset([recording]), path)
    return path, path.read_bytes()


@settings(max_examples=cases(50))
@given(changes=mutations)
def test_mutated_files_of_our_own(own, changes):
    path, data = own
    path.write_bytes(mutated(data, changes))
    attempt(path)


@settings(max_examples=cases(50))
@given(
    data=st.binary(max_size=200),
    cuts=st.lists(st.integers(0, 200), max_size=3),
    encoding=st.sampled_from(["cdr", "ros1"]),
    stamped=st.booleans(),
    head=st.sampled_from([b"", b"\0\1\0\0", b"\0\0\0\0"]),
)
def test_messages_of_any_bytes(data, cuts, encoding, stamped, head):
    def refuse(index, problem):
        raise RecordingFileError("x", problem, place=f"message {index + 1}")

    data = head + data
    edges = sorted({0, len(data), *(cut for cut in cuts if cut < len(data))})
    lengths = np.diff(edges) if len(edges) > 1 else np.array([0])
    name = "geometry_msgs/WrenchStamped" if stamped else "geometry_msgs/Wrench"
    try:
        found = decode_wrenches(data, lengths, encoding, name, refuse)
    except RecordingFileError:
        return
    assert found.wrench.shape == (len(lengths), 6)


@settings(max_examples=cases(60))
@given(st.text(st.sampled_from("= \n#/MSG:Wrenchfloat64xyHdrstmp"), max_size=200))
def test_definitions_of_any_text(text):
    assert foreign_definition(text, STAMPED) is None or isinstance(foreign_definition(text, STAMPED), str)
