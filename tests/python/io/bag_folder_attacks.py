"""ROS 2 bag folders made to do harm: each function writes one and returns the path to read."""

from __future__ import annotations

import os

import zstandard

from mcap_attacks import LARGE
from ros_cases import MCAP, ROS2, STAMPED, even_stamps, one_topic, samples, write_bag2, write_mcap


def folder_of(folder, metadata, *, files=("x.mcap",)):
    path = folder / "x"
    path.mkdir()
    for name in files:
        write_mcap(path / name, one_topic(ROS2, samples(), even_stamps()))
    (path / "metadata.yaml").write_bytes(metadata if isinstance(metadata, bytes) else metadata.encode())
    return path


def metadata(*paths, **more):
    listed = "".join(f"\n    - {path}" for path in paths)
    other = "".join(f"\n  {key}: {value}" for key, value in more.items())
    return f"rosbag2_bagfile_information:\n  version: 5\n  relative_file_paths:{listed}{other}\n"


def _outside(folder, how):
    secret = folder / "secret.mcap"
    write_mcap(secret, one_topic(ROS2, samples(), even_stamps()))
    inner = folder / "in"
    inner.mkdir()
    if how in ("link", "beside"):
        path = folder_of(inner, metadata("y.mcap"))
        (path / "y.mcap").symlink_to(secret if how == "link" else secret.rename(inner / "secret.mcap"))
        return path
    return folder_of(inner, metadata({"up": "../../secret.mcap", "absolute": secret}[how]))


def _packed(folder, data, name="x.db3.zstd"):
    path = folder_of(folder, metadata(name, compression_format="zstd", compression_mode="FILE"), files=())
    (path / name).write_bytes(data)
    return path


def _pipe(folder):
    path = folder_of(folder, metadata("y.mcap"))
    os.mkfifo(path / "y.mcap")
    return path


def _packed_messages(folder, data):
    topics = {"/ft": (STAMPED, [data], [5])}
    path = write_bag2(folder / "x", topics, MCAP)
    (path / "metadata.yaml").write_text(
        metadata("x.mcap", compression_format="zstd", compression_mode="MESSAGE")
    )
    return path


ALIASES = "\n".join(f"  a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9) if i else 'x'}]" for i in range(30))

FOLDER_ATTACKS = {
    "empty metadata": (lambda f: folder_of(f, ""), "no entry rosbag2_bagfile_information"),
    "binary metadata": (lambda f: folder_of(f, b"\xff\xfe\0\1" * 99), "is not UTF-8"),
    "no YAML": (lambda f: folder_of(f, "a: [b\nc: }"), "is not proper YAML"),
    "deep brackets": (lambda f: folder_of(f, "[" * 9_000), "too deeply nested"),
    "deep dashes": (lambda f: folder_of(f, "- " * 9_000), "not proper YAML|no entry"),
    "long list": (lambda f: folder_of(f, metadata(*(f"{i}.mcap" for i in range(9000)))), "too long"),
    "aliases upon aliases": (
        lambda f: folder_of(f, f"rosbag2_bagfile_information:\n{ALIASES}\n  relative_file_paths: *a29\n"),
        "not proper YAML|no list relative_file_paths",
    ),
    "aliases as names": (
        lambda f: folder_of(
            f, f"x:\n{ALIASES}\nrosbag2_bagfile_information: {{relative_file_paths: *a29}}\n"
        ),
        "no list relative_file_paths|not proper YAML",
    ),
    "a Python object": (
        lambda f: folder_of(f, metadata("!!python/object/apply:os.getcwd []")),
        "not proper YAML|no list relative_file_paths",
    ),
    "a list for a block": (lambda f: folder_of(f, "rosbag2_bagfile_information: [1]"), "no entry"),
    "names that are numbers": (lambda f: folder_of(f, metadata(1, 2)), "no list relative_file_paths"),
    "no names": (lambda f: folder_of(f, metadata()), "no list relative_file_paths"),
    "a name above": (lambda f: _outside(f, "up"), "wanted a name within the folder"),
    "an absolute name": (lambda f: _outside(f, "absolute"), "wanted a name within the folder"),
    "a link out": (lambda f: _outside(f, "link"), "links out are not followed"),
    "a link to what lies beside the bag": (lambda f: _outside(f, "beside"), "links out are not followed"),
    "lines without end": (lambda f: folder_of(f, metadata("x.mcap") + "\n" * 300_000), "lines, more than"),
    "a file twice": (lambda f: folder_of(f, metadata(*["x.mcap"] * 9)), "names a file twice"),
    "a missing file": (lambda f: folder_of(f, metadata("y.mcap")), "cannot be read: No such file"),
    "a folder for a file": (lambda f: folder_of(f, metadata(".")), "wanted a name within the folder"),
    "another kind of file": (lambda f: folder_of(f, metadata("metadata.yaml")), "wanted .mcap or .db3"),
    "a pipe": (_pipe, "is not a regular file"),
    "a compression nobody has": (
        lambda f: folder_of(f, metadata("x.mcap", compression_format="fake", compression_mode="file")),
        "compression 'fake' of each 'file'",
    ),
    "a mode that is a list": (
        lambda f: folder_of(f, metadata("x.mcap", compression_mode="[file]")),
        "compression_mode is a list",
    ),
    "a packed bomb": (lambda f: _packed(f, zstandard.compress(bytes(LARGE))), "would expand"),
    "damaged packing": (lambda f: _packed(f, b"no zstd at all"), "cannot be decompressed"),
    "packing cut off": (lambda f: _packed(f, zstandard.compress(os.urandom(9999))[:5000]), "SQLite"),
    "a packed message bomb": (
        lambda f: _packed_messages(f, zstandard.compress(bytes(LARGE))),
        "a frame of 268435456",
    ),
    "damaged packed messages": (lambda f: _packed_messages(f, b"no zstd"), "cannot be decompressed"),
}
