"""Recordings into files or an archive: one push after another, each whole or absent."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from granular_id._checks import argument_error, checked_flag, checked_text
from granular_id._core import MAX_NAME_BYTES, GranularIdError
from granular_id._files import check_target, made_folder
from granular_id.io.files import safe_name
from granular_id.io.npz import save_npz
from granular_id.io.parquet.layout import is_parquet_archive
from granular_id.io.parquet.writing import Appender
from granular_id.live.capture import Capture
from granular_id.live.limits import Limits
from granular_id.live.push import Pushes, Step
from granular_id.live.robot import Robot, checked_robot
from granular_id.live.setup import starts_exactly
from granular_id.live.stream import Stream, checked_stream
from granular_id.live.trigger import ForceTrigger, MotionTrigger, Trigger
from granular_id.recording import Dataset, Recording

__all__ = ["Recorded", "Recorder", "checked_label", "utc_stamp"]


@dataclass(frozen=True)
class Recorded:
    """A recording and the file, or the archive, it is in."""

    recording: Recording
    path: Path


class Recorder:
    """Records one push after another into ``folder/label/label_<time>_<k>.npz``, or into an archive.

    `granular_id.load` reads either. A push appears when it is written whole; what a killed process leaves is a hidden
    file that nothing reads. Nothing is ever overwritten.

    Parameters
    ----------
    stream : Stream
        From `opened`.
    robot : Robot or None
        None: somebody else moves, and the trigger notices (give one).
    folder : path-like
        Made when missing.
    archive : bool, default False
        `folder` is an archive (see :doc:`/guide/archives`), new or not, and each push is appended to it when it is
        over; several recorders may append to one. By default a file is written for each push, for which no library is
        needed.
    session : str, optional
        Stored with every recording: what is recorded in one go. Default: the time of day at which this recorder
        was made, so that an evaluation can keep what belongs together on one side.
    trigger : callable, optional
        Makes the trigger of each recording. Default: `MotionTrigger`; `ForceTrigger` for a `ManualRobot` and
        without a robot.
    direction, speed_m_s
        See `Robot.move_line`; the paper's 0.03 m/s.
    n_samples : int, default 1600
        Rows of a recording, those before the trigger included: the paper's 3.2 s at 500 Hz.
    pre_s : float, default 0.25
        Rest before the trigger that belongs to a recording.
    on_step : callable, optional
        Called as ``on_step(step, capture)`` many times a second, for views. The robot is watched however long it takes.
    **limits
        What a push must be like, see `Limits`.

    Raises
    ------
    OSError
        The folder cannot be written to, or is an archive without `archive=True` (FileExistsError): found out before
        anything moves.
    ImportError
        An archive needs pyarrow.
    TypeError, ValueError
        Naming the argument.

    Examples
    --------
    >>> import tempfile
    >>> import granular_id as gid
    >>> from granular_id.live import Recorder, opened
    >>> with tempfile.TemporaryDirectory() as folder, opened("sim:rice?seed=1&speed=20") as stream:
    ...     recorder = Recorder(stream, stream.source.robot(), folder, session="Monday")
    ...     recorded = recorder.record("rice")
    ...     gid.load(folder).y.tolist(), recorded.recording.trigger_index
    (['rice'], 125)
    """

    def __init__(
        self,
        stream: Stream,
        robot: Robot | None,
        folder: str | os.PathLike[str],
        *,
        archive: bool = False,
        session: str | None = None,
        trigger: Callable[[], Trigger] | None = None,
        n_samples: int = 1600,
        pre_s: float = 0.25,
        direction: Sequence[float] = (1.0, 0.0, 0.0),
        speed_m_s: float = 0.03,
        on_step: Callable[[Step, Capture], object] | None = None,
        **limits: Any,
    ) -> None:
        checked_stream(stream)
        robot = None if robot is None else checked_robot(robot)
        if trigger is not None and not callable(trigger):
            wanted = (
                "must make a new trigger for each recording, like ForceTrigger or lambda: ForceTrigger(1.0)"
            )
            raise argument_error(TypeError, "trigger", f"{wanted}; got a {type(trigger).__name__}")
        if trigger is None:
            trigger = MotionTrigger if starts_exactly(robot) else ForceTrigger
        self.session = checked_text(utc_stamp() if session is None else session, "session", spaced=False)
        self.folder = Path(folder)
        self.last: Recording | None = None
        self._on_step = on_step
        self._n_recorded = 0
        self._pushes = Pushes(
            stream,
            robot,
            trigger,
            Limits(**limits),
            n_samples=n_samples,
            pre_s=pre_s,
            direction=direction,
            speed_m_s=speed_m_s,
        )
        self._archive = None
        if checked_flag("archive", archive):
            with made_folder(self.folder):
                self._archive = Appender(self.folder, stream.info.axes, "the sensor")
        else:
            if is_parquet_archive(self.folder):
                problem = "pass archive=True to append to it, or name another folder"
                raise FileExistsError(f"{self.folder}: is an archive; {problem}")
            with made_folder(self.folder):
                check_target(self.folder / "recording.npz")

    def record(self, label: str) -> Recorded:
        """Wait for rest, push, and store what the sensor saw. A push that began before the call is none.

        Parameters
        ----------
        label : str
            Name of the material.

        Returns
        -------
        Recorded

        Raises
        ------
        CaptureError
            There is no recording; ``reason`` and the text say why. No file was written, the robot was stopped; or
            it could not be (`FailureReason.ROBOT`). After a limit, an error of the robot and three failures in a row
            nothing moves until `resume`.
        OSError
            It cannot be written (disk full ...); the recording is still in `last`.
        KeyboardInterrupt
            On Ctrl-C; the robot was stopped.
        """
        label = checked_label(label)
        push = next(self._pushes)
        with push:
            for step in push:
                if self._on_step is not None:
                    self._on_step(step, push.capture)
        stem = f"{safe_name(label)}_{utc_stamp()}_{self._n_recorded + 1}"
        self.last = push.capture.recording(
            label, session=self.session, name=stem, meta=push.facts(push.truth)
        )
        self._n_recorded += 1
        return Recorded(self.last, self._write(self.last, safe_name(label), stem))

    def resume(self) -> None:
        """Let the robot move again after a limit, an error or three failures, from where the tool stands now."""
        self._pushes.resume()

    def _write(self, recording: Recording, folder: str, stem: str) -> Path:
        if self._archive is not None:
            self._archive.append(Dataset([recording]))
            return self.folder
        with made_folder(self.folder / folder) as place:
            path = place / f"{stem}.npz"
            again = 1
            while os.path.lexists(path):
                again += 1
                path = place / f"{stem}-{again}.npz"
            return save_npz(Dataset([recording]), path)


def checked_label(label: str) -> str:
    """Return the label of a recording, or say what is wrong with it."""
    checked_text(label, "label", spaced=False)
    n_bytes = len(label.encode())
    if n_bytes > MAX_NAME_BYTES:
        problem = f"must have at most {MAX_NAME_BYTES} bytes, as in models, got {n_bytes}"
        raise argument_error(GranularIdError, "label", problem)
    return label


def utc_stamp() -> str:
    """Return the time of day as it stands in names and sessions."""
    return datetime.now(timezone.utc).strftime("%Y%m%dT%H%M%SZ")
