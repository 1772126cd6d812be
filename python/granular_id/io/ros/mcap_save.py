"""Write recordings as MCAP: WrenchStamped on ``/wrench``, as ``ros2 bag record`` would have written them."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path

from granular_id import _core
from granular_id._files import new_file
from granular_id._progress import ProgressCallback
from granular_id.io.errors import need
from granular_id.io.folder_save import checked_dataset, history_json, indexed_folder, refuse_other_axes
from granular_id.io.ros.mcap_own import OWN_NAME, own_records, wire_stamps
from granular_id.io.ros.wrench import DEFINITION, LONGEST_FRAME, encode_wrenches
from granular_id.recording import Dataset, Recording

__all__ = ["TOPIC", "save_mcap"]

TOPIC = "/wrench"
"""Topic of the messages that are written."""

_TYPE = "geometry_msgs/msg/WrenchStamped"


def save_mcap(
    dataset: Dataset, path: str | os.PathLike[str], *, progress: ProgressCallback | None = None
) -> Path:
    """Write a data set as MCAP: one recording as a file, several as a folder with a file each.

    The files have the ROS 2 profile, zstd chunks, and a summary with statistics and indexes. Stamps count from
    1970 where `start_time` is known, and from the first sample otherwise. What messages cannot hold stands beside them
    in a metadata record and attachments called ``granular_id``, so that ``load(path) == dataset`` to the last bit.

    Parameters
    ----------
    dataset : Dataset
        Of 6-axis recordings.
    path : str or path
        A file ending in ``.mcap`` for one recording, a new or empty folder for several.
    progress : callable, optional
        Called as ``progress(files_done, files_in_all, file)``.

    Returns
    -------
    Path
        The file or folder.

    Raises
    ------
    FileExistsError
        There is something at `path` already.
    FileNotFoundError
        The folder to put it in does not exist.
    ValueError
        A recording has other axes or lasts longer than 68 years; a file name for several recordings, or another
        ending than ``.mcap`` for one.
    ImportError
        The extra ``ros`` is not installed.

    Examples
    --------
    >>> import numpy as np, tempfile
    >>> from granular_id.io import load
    >>> from granular_id.io.ros.mcap_save import save_mcap
    >>> from granular_id.recording import Dataset, Recording
    >>> data = Dataset([Recording(np.ones((3, 6)) / 3, rate_hz=500, label="oat flakes")])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     load(save_mcap(data, folder + "/oats.mcap")) == data
    True

    Notes
    -----
    The format is described at https://mcap.dev/spec, the ROS 2 profile in its registry.
    """
    refuse_other_axes(checked_dataset(dataset), "MCAP")
    target = Path(path)
    is_file = target.suffix.lower() == ".mcap"
    if is_file and len(dataset) > 1:
        raise ValueError(
            f"an .mcap file holds one recording, and there are {len(dataset)}; name a folder, format='mcap'"
        )
    if not is_file:
        return indexed_folder(dataset, target, ".mcap", partial(_write, history="[]"), progress)
    with new_file(target) as draft:
        _write(dataset[0], draft, history=history_json(dataset))
    if progress is not None:
        progress(1, 1, target.name)
    return target


def _write(recording: Recording, path: Path, *, history: str) -> None:
    mcap = need("mcap.writer", extra="ros", why="to write .mcap files")
    try:
        stamps_ns = wire_stamps(recording.times(), recording.start_time)
    except ValueError as error:
        raise ValueError(f"recording {recording.name!r}: {error}") from error
    messages = encode_wrenches(recording.wrench, stamps_ns, _frame(recording))
    own = own_records(recording, history)
    first_ns = int(stamps_ns[0])
    with path.open("wb") as file:
        writer = mcap.Writer(file, compression=mcap.CompressionType.ZSTD, enable_data_crcs=True)
        writer.start(profile="ros2", library=f"granular-id {_core.__version__}")
        schema = writer.register_schema(_TYPE, "ros2msg", DEFINITION.encode())
        channel = writer.register_channel(TOPIC, "cdr", schema)
        for number, (stamp_ns, message) in enumerate(zip(stamps_ns.tolist(), messages, strict=True)):
            writer.add_message(
                channel, log_time=stamp_ns, publish_time=stamp_ns, sequence=number, data=message
            )
        writer.add_metadata(OWN_NAME, own.metadata)
        for name, data in own.attachments.items():
            writer.add_attachment(first_ns, first_ns, name, "application/octet-stream", data)
        writer.finish()


def _frame(recording: Recording) -> str:
    """Return what the metadata call the frame, where that can be a ``frame_id``."""
    frame = recording.meta.get("frame")
    if isinstance(frame, str) and frame.isprintable() and len(frame.encode()) < LONGEST_FRAME:
        return frame
    return ""
