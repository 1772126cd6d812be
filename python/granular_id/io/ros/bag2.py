"""ROS 2 bag folders: what metadata.yaml says about the files beside it."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from granular_id.io.errors import RecordingFileError
from granular_id.io.extras import need
from granular_id.io.files import check_file, read_text_bounded, refuse_outside
from granular_id.io.options import LoadOptions

__all__ = ["METADATA_NAME", "BagFolder", "is_bag_folder", "read_bag_folder"]

METADATA_NAME = "metadata.yaml"

_TOP = "rosbag2_bagfile_information"
_WANTED = ("relative_file_paths", "compression_format", "compression_mode", "ros_distro")
_LARGEST_YAML = 32 * 1024
"""Of the part that is parsed, bytes; the parser is slow, and nothing but the names of the files is needed."""

_DEEPEST = 16
_KEY = re.compile(r"( *)([A-Za-z0-9_]+):")


@dataclass(frozen=True)
class BagFolder:
    """The files of a ROS 2 bag.

    Attributes
    ----------
    files : list of Path
        In order of recording, all in the folder.
    n_bytes : int
        Of all of them, on disk.
    compression : {"", "file", "message"}
        What is compressed by zstd: nothing, whole files or each message.
    distro : str or None
        ROS distribution that recorded it.
    """

    files: list[Path]
    n_bytes: int
    compression: str
    distro: str | None


def is_bag_folder(folder: Path) -> bool:
    """Tell whether a folder is a ROS 2 bag."""
    return os.path.isfile(folder / METADATA_NAME)  # noqa: PTH113 (says False where is_file raises: no permission)


def read_bag_folder(folder: Path, root: Path, options: LoadOptions) -> BagFolder:
    """Read ``metadata.yaml`` and look at the files it names.

    Raises
    ------
    RecordingFileError
        No proper YAML, other compression than zstd, names that leave the folder, files missing or too large.
    """
    refuse_outside(folder, root)
    path = folder / METADATA_NAME
    try:
        text = read_text_bounded(path, folder, options.max_text_bytes).decode("utf-8")
    except UnicodeDecodeError as error:
        raise RecordingFileError(path, "is not UTF-8 text") from error
    about = _parsed(_essential(text), path)
    mode = _text(about, "compression_mode", path).lower().replace("none", "")
    format_name = _text(about, "compression_format", path)
    if mode not in ("", "file", "message") or (mode and format_name != "zstd"):
        problem = f"compression {format_name[:40]!r} of each {mode[:40]!r} is not known; wanted zstd of file or message"
        raise RecordingFileError(path, problem)
    names = about.get("relative_file_paths")
    if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
        raise RecordingFileError(path, "has no list relative_file_paths with the names of the bag's files")
    files = [folder / _plain_name(name, path) for name in names]
    if len(set(files)) < len(files):
        raise RecordingFileError(path, "names a file twice")
    max_bytes = options.max_binary_bytes
    n_bytes = sum(check_file(file, folder, max_bytes) for file in files)
    if n_bytes > max_bytes:
        problem = f"the files have {n_bytes} bytes together, more than max_file_bytes={max_bytes}"
        raise RecordingFileError(folder, f"{problem}; raise max_file_bytes to read them")
    return BagFolder(files, n_bytes, mode, _text(about, "ros_distro", path) or None)


def _essential(text: str) -> str:
    """Cut from the block of metadata what is not needed: lists of topics and files, which may be long."""
    kept: list[str] = []
    depth, keeping = 0, True
    for line in text.splitlines():
        key = _KEY.match(line)
        if key is not None:
            indent = len(key[1])
            depth = depth or indent  # how far the entries of the block are indented
            if indent <= depth:
                keeping = indent < depth or not indent or key[2] in _WANTED
        if keeping:
            kept.append(line)
    return "\n".join(kept)


def _parsed(text: str, path: Path) -> dict[str, Any]:
    yaml = need("ruamel.yaml", extra="ros", why="to read the metadata.yaml of ROS 2 bags")
    depth = deepest = 0
    for bracket in re.findall(r"[\[\]{}]", text):
        depth += 1 if bracket in "[{" else -1
        deepest = max(deepest, depth)
    if len(text) > _LARGEST_YAML or deepest > _DEEPEST:
        raise RecordingFileError(path, "is no metadata of a ROS 2 bag: too long or too deeply nested")
    try:
        tree = yaml.YAML(typ="safe", pure=True).load(text)
    except Exception as error:  # of many kinds: YAMLError, RecursionError, ValueError of a date ...
        reason = str(getattr(error, "problem", None) or error).partition("\n")[0][:200]
        raise RecordingFileError(path, f"is not proper YAML ({reason})") from error
    about = tree.get(_TOP) if isinstance(tree, dict) else None
    if not isinstance(about, dict):
        raise RecordingFileError(path, f"has no entry {_TOP}, as the metadata of a ROS 2 bag has")
    return about


def _text(about: dict[str, Any], key: str, path: Path) -> str:
    value = about.get(key) or ""
    if not isinstance(value, str):
        raise RecordingFileError(path, f"{key} is a {type(value).__name__}; wanted a text")
    return value


def _plain_name(name: str, path: Path) -> str:
    """Return the name of a file in the folder; before version 4 the folder's own name stood before it."""
    parts = PurePosixPath(name)
    if (
        parts.is_absolute()
        or ".." in parts.parts
        or "\\" in name
        or ":" in name
        or "\0" in name
        or not parts.name
    ):
        problem = f"names the file {name[:80]!r}; wanted a name within the folder"
        raise RecordingFileError(path, problem)
    return parts.name
