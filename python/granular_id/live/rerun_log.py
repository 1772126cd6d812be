"""A session as a log for the Rerun viewer: every row, every histogram, every answer, over the device's time."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from granular_id._files import cannot_write, check_target
from granular_id.io.extras import need
from granular_id.live.view import BackgroundView
from granular_id.live.wording import GIVEN, SYNTHETIC, answer_of, state_of, warnings_of
from granular_id.recording import AXIS_COLOURS

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from granular_id.live.snapshot import Snapshot
    from granular_id.live.wording import Answer

__all__ = ["TIMELINE", "RerunLog"]

TIMELINE = "device_time"
"""Name of the timeline: seconds of the device."""

_CHUNK_S = 0.25  # a message per row would cost more than the rows
_PATIENCE_S = 15.0  # for what waits at the end: a log is there to be complete
_WAITING = 300  # snapshots: ten seconds in which the disk may be busy


class RerunLog(BackgroundView):
    """Logs snapshots for the Rerun viewer, into a file or into a viewer that is started.

    Entities: ``wrench/fx`` ..., ``residual/fx`` ... (every row, in chunks of a quarter of a second; instants that
    never arrived are NaN), ``histogram/fx`` ..., ``loss/MATERIAL``, ``stream/lag_ms``, ``stream/lost``, and the text
    log ``session`` with states, answers and warnings. Unlike other views this one wants every snapshot: ten seconds
    of them may wait, and what is dropped beyond is counted and written into the log.

    Parameters
    ----------
    path : path-like, optional
        File to be written, usually ``.rrd``; it can be read while it grows and after a crash. None: start the
        viewer and log into it.

    Raises
    ------
    ImportError
        Without rerun-sdk, saying what to install.
    OSError
        The file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from granular_id.live.rerun_log import RerunLog
    >>> from granular_id.live.snapshot import Snapshot
    >>> path = Path(tempfile.mkdtemp()) / "session.rrd"
    >>> with RerunLog(path) as log:
    ...     log.publish(Snapshot("armed"))
    >>> path.stat().st_size > 0
    True
    """

    def __init__(self, path: str | os.PathLike[str] | None = None) -> None:
        self._rerun: Any = need("rerun", extra="live", why="to log for the Rerun viewer")
        self._log: Any = self._rerun.RecordingStream("granular_id")
        if path is None:
            self._log.spawn()
        else:
            target = check_target(path)
            try:
                self._log.save(str(target))
            except OSError as error:
                raise cannot_write(target, error) from error
        self._begun = False
        self._said: dict[str, str] = {}
        self._not_logged = 0
        self._pieces: list[Snapshot] = []
        super().__init__("Rerun log", max_hz=10.0, waiting=_WAITING, patience_s=_PATIENCE_S)

    def show(self, snapshot: Snapshot) -> None:
        """Log what is new, once enough of it has gathered."""
        if not self._begun:
            self._begin(snapshot)
        self._pieces.append(snapshot)
        self._log.set_time(TIMELINE, duration=snapshot.time_s or 0.0)
        self._say(snapshot)
        over = snapshot.decision is not None and snapshot.decision.final
        if over or sum(len(piece.fresh_time_s) for piece in self._pieces) >= _CHUNK_S * snapshot.rate_hz:
            self._log_pieces()

    def finish(self) -> None:
        """Log the rest and close the file."""
        self._log_pieces()
        if self.dropped:
            self._log.log(
                "session", self._rerun.TextLog(f"{self.dropped} snapshots were dropped", level="WARN")
            )
        self._log.flush()
        self._log.disconnect()

    def _begin(self, snapshot: Snapshot) -> None:
        self._begun = True
        mark = "SYNTHETIC " if snapshot.synthetic else ""
        self._log.send_recording_name(f"{mark}{snapshot.source}")
        if snapshot.synthetic:
            self._log.log("session", self._rerun.TextLog(SYNTHETIC, level="WARN"))
        for i, axis in enumerate(snapshot.axes):
            colour = bytes.fromhex(AXIS_COLOURS[i % len(AXIS_COLOURS)][1:])
            lines = self._rerun.SeriesLines(names=f"{axis}, {snapshot.units[i]}", colors=[list(colour)])
            for kind in ("wrench", "residual"):
                self._log.log(f"{kind}/{axis}", lines, static=True)

    def _say(self, snapshot: Snapshot) -> None:
        self._not_logged += snapshot.fresh_lost
        answer = answer_of(snapshot)
        state = f"{state_of(snapshot)}: {snapshot.hint}" if snapshot.hint else state_of(snapshot)
        told = {
            "state": (state, "ERROR" if snapshot.state == "failed" else "INFO"),
            "answer": (_named(answer) if answer.kind in GIVEN else "", "INFO"),
            "warnings": ("; ".join(warnings_of(snapshot)), "WARN"),
            "not logged": (f"{self._not_logged:,} rows not logged so far" * bool(self._not_logged), "WARN"),
        }
        for kind, (text, level) in told.items():
            if text and text != self._said.get(kind):
                self._log.log("session", self._rerun.TextLog(text, level=level))
            self._said[kind] = text

    def _log_pieces(self) -> None:
        """Log what has gathered: rows, losses and lag each in one message, and the latest histogram."""
        pieces, self._pieces = self._pieces, []
        timed = [piece for piece in pieces if piece.time_s is not None]
        times = [float(piece.time_s or 0.0) for piece in timed]
        if not timed:
            return
        rows_s = np.concatenate([piece.fresh_time_s for piece in timed])
        for kind in ("wrench", "residual"):
            rows = np.concatenate([getattr(piece, f"fresh_{kind}") for piece in timed])
            for i, axis in enumerate(timed[0].axes):
                self._send(f"{kind}/{axis}", rows_s, rows[:, i])
        self._send("stream/lag_ms", times, [1e3 * piece.lag_s for piece in timed])
        self._send("stream/lost", times, [float(piece.lost) for piece in timed])
        answered = [
            (time_s, dict(piece.decision.ranking))
            for time_s, piece in zip(times, timed, strict=True)
            if piece.decision is not None
        ]
        for name in answered[-1][1] if answered else ():
            path = self._rerun.new_entity_path(["loss", name])
            self._send(path, [time_s for time_s, _ in answered], [losses[name] for _, losses in answered])
        for axis, counts in zip(timed[-1].axes, timed[-1].counts, strict=True):
            self._log.log(f"histogram/{axis}", self._rerun.BarChart(counts))

    def _send(self, path: str, times_s: ArrayLike, values: ArrayLike) -> None:
        if len(np.asarray(times_s)):
            self._rerun.send_columns(
                path,
                indexes=[self._rerun.TimeColumn(TIMELINE, duration=np.asarray(times_s, np.float64))],
                columns=self._rerun.Scalars.columns(scalars=np.asarray(values, np.float64)),
                recording=self._log,
            )


def _named(answer: Answer) -> str:
    """Return the answer; where it refuses to name a material, with the nearest one."""
    if answer.kind == "unknown":
        return f"final: {answer.title} ({answer.detail})"
    return f"{answer.kind}: {answer.title}"
