"""MCAP files of ours that others have copied, cut, changed or damaged since."""

from __future__ import annotations

import numpy as np
import pytest

from granular_id.io import RecordingFileError, load
from granular_id.io.ros import mcap_own
from granular_id.io.ros.mcap_own import CHANGED_NOTE
from granular_id.io.ros.mcap_save import save_mcap
from granular_id.io.ros.wrench import DEFINITION, encode_wrenches
from granular_id.recording import Dataset

pytest.importorskip("mcap")
pytest.importorskip("rosbags")

from mcap.reader import make_reader
from mcap.writer import Writer

from ros_cases import STAMPED, irregular, push


def rewritten(path, target, keep=lambda i: True, metadata=lambda data: data, attachment=lambda data: data):
    """Copy an MCAP file with some of its messages, other metadata, and attachments first, as other tools may."""
    with path.open("rb") as file, target.open("wb") as out:
        reader, writer = make_reader(file), Writer(out)
        writer.start("ros2", "other")
        for record in reader.iter_attachments():
            writer.add_attachment(0, 0, record.name, record.media_type, attachment(record.data))
        for i, (schema, channel, message) in enumerate(reader.iter_messages()):
            if not i:
                schema_id = writer.register_schema(schema.name, schema.encoding, schema.data)
                channel_id = writer.register_channel(channel.topic, channel.message_encoding, schema_id)
            if keep(i):
                writer.add_message(channel_id, message.log_time, message.data, message.publish_time)
        for record in reader.iter_metadata():
            writer.add_metadata(record.name, metadata(dict(record.metadata)))
        writer.finish()
    return target


def test_a_copy_is_still_ours(tmp_path):
    for name, recording in (("a", push()), ("b", irregular())):
        path = save_mcap(Dataset([recording]), tmp_path / f"{name}.mcap")
        assert load(rewritten(path, tmp_path / f"{name}2.mcap"))[0] == recording


def test_a_cut_copy_is_read_by_its_stamps_and_says_so(tmp_path):
    path = save_mcap(Dataset([push(20, trigger_index=3, flags=np.arange(20) % 2)]), tmp_path / "a.mcap")
    data = load(rewritten(path, tmp_path / "b.mcap", keep=lambda i: i >= 10))
    (recording,) = data
    assert (recording.n_samples, recording.rate_hz) == (10, 500)
    assert (recording.label, recording.trigger_index, recording.flags) == (None, None, None)
    assert CHANGED_NOTE in data.history[-1].notes


def test_a_copy_with_other_stamps_is_read_by_them(tmp_path):
    path = save_mcap(Dataset([push(20)]), tmp_path / "a.mcap")
    moved = rewritten(path, tmp_path / "b.mcap", metadata=lambda data: {**data, "start_time": "1700000009.0"})
    data = load(moved)
    assert data[0].start_time == push().start_time
    assert CHANGED_NOTE in data.history[-1].notes


def test_texts_of_any_length_are_not_parsed(tmp_path, monkeypatch):
    path = save_mcap(Dataset([push(5, meta={"a": "b" * 100})]), tmp_path / "a.mcap")
    monkeypatch.setattr(mcap_own, "MAX_TEXT_BYTES", 99)
    with pytest.raises(RecordingFileError, match="'meta' has 109 characters; at most 99 are read"):
        load(path)


def test_attachments_may_be_longer_than_the_messages_that_are_left(tmp_path):
    path = save_mcap(Dataset([irregular(2000)]), tmp_path / "a.mcap")
    data = load(rewritten(path, tmp_path / "b.mcap", keep=lambda i: i < 3))
    assert data[0].n_samples == 3
    assert CHANGED_NOTE in data.history[-1].notes


def test_damaged_and_foreign_attachments(tmp_path):
    path = save_mcap(Dataset([irregular(40)]), tmp_path / "a.mcap")
    data = path.read_bytes()
    at = data.index(irregular(40).time_s.tobytes())
    path.write_bytes(data[: at + 20] + b"?" + data[at + 21 :])
    with pytest.raises(
        RecordingFileError, match="attachment 'granular_id/time_s' whose checksum does not fit"
    ):
        load(path)
    with (tmp_path / "b.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "other")
        schema = writer.register_schema(STAMPED, "ros2msg", DEFINITION.encode())
        channel = writer.register_channel("/ft", "cdr", schema)
        writer.add_attachment(0, 0, "calibration.json", "application/json", b"{}")
        writer.add_attachment(0, 0, "", "", b"")
        for stamp in (5, 7):
            writer.add_message(
                channel, stamp, encode_wrenches(np.ones((1, 6)), np.array([stamp]), "ft")[0], stamp
            )
        writer.finish()
    assert load(tmp_path / "b.mcap")[0].n_samples == 2


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"version": "2"}, r"version is '2'; wanted '1'"),
        ({"rate_hz": "0"}, "rate_hz must be positive"),
        ({"rate_hz": "fast"}, "could not convert"),
        ({"start_time": "nan"}, "start_time"),
        ({"trigger_index": "99"}, "trigger_index"),
        ({"trigger_index": "one"}, "invalid literal"),
        ({"meta": "[1]"}, "meta must be a mapping"),
        ({"meta": '{"a": NaN}'}, "finite"),
        ({"meta": "[" * 100_000}, "recursion"),
        ({"history": "{}]"}, "Extra data"),
        ({"history": "{}"}, "history is a JSON dict; wanted a list"),
        ({"history": '[{"step": 1}]'}, "step"),
        ({"label": " rice"}, "label"),
        ({"name": "a\x00b"}, "name"),
    ],
)
def test_own_metadata_that_we_did_not_write(tmp_path, change, problem):
    path = save_mcap(Dataset([push(5)]), tmp_path / "a.mcap")
    other = rewritten(path, tmp_path / "b.mcap", metadata=lambda data: {**data, **change})
    with pytest.raises(RecordingFileError, match=problem) as caught:
        load(other)
    assert caught.value.path == str(other)


def test_own_attachments_longer_than_the_messages_allow(tmp_path):
    path = save_mcap(Dataset([irregular(40)]), tmp_path / "a.mcap")
    with pytest.raises(RecordingFileError, match=r"has an attachment of [0-9]+ bytes for 40 messages"):
        load(rewritten(path, tmp_path / "b.mcap", attachment=lambda data: data + bytes(5000)))


@pytest.mark.parametrize("data", [b"", b"\0" * 39, b"\xff" * 40 * 8, b"\0" * 40 * 8])
def test_own_attachments_that_we_did_not_write(tmp_path, data):
    path = save_mcap(Dataset([irregular(40)]), tmp_path / "a.mcap")
    with pytest.raises(RecordingFileError, match=r"metadata granular_id|stamp|message"):
        load(rewritten(path, tmp_path / "b.mcap", attachment=lambda _: data))
