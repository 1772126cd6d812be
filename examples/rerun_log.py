"""A live session as a log for the Rerun viewer (https://rerun.io): every row, every histogram, every answer.

    pip install granular-id rerun-sdk
    python examples/rerun_log.py sim:rice kitchen.safetensors session.rrd --n 3
    rerun session.rrd

Entities, over the device's time: ``wrench/fx`` ... (every row), ``histogram/fx`` ..., ``loss/MATERIAL``,
``stream/lag_ms``, ``stream/lost``, and the text log ``session`` with answers and warnings. The file can be read
while it grows. Without a model, views of recorders and of your own programs take the same `RerunLog`.
"""

from __future__ import annotations

import argparse

import numpy as np
import rerun as rr

from granular_id import Identifier
from granular_id.live import LiveIdentifier, Views, opened, stop_on_signals
from granular_id.live.snapshot import Snapshot
from granular_id.live.stream import Stream
from granular_id.recording import AXES

TIMELINE = "device_time"


class RerunLog:
    """Logs what is new in each snapshot, and all rows of the stream, which it reads for itself."""

    def __init__(self, stream: Stream, path: str) -> None:
        self._rows = stream.buffer.reader(from_oldest=True)
        self._log = rr.RecordingStream("granular_id")
        self._log.save(path)
        mark = "SYNTHETIC " if stream.info.synthetic else ""
        self._log.send_recording_name(f"{mark}{stream.info.name}")
        self._logged: set[str] = set()
        if stream.info.synthetic:
            self._say("WARN", "SYNTHETIC: no sensor measures here")

    def show(self, snapshot: Snapshot) -> None:
        """Log one snapshot, and the rows that have come since the last one."""
        self._log_rows()
        self._log.set_time(TIMELINE, duration=snapshot.time_s or 0.0)
        words = snapshot.words
        self._say("WARN", *words.warnings)
        self._say("INFO", *(f"push {e.number}: {e.title}, {e.detail}" for e in words.history))
        self._log.log("stream/lag_ms", rr.Scalars(1e3 * snapshot.lag_s))
        self._log.log("stream/lost", rr.Scalars(snapshot.lost))
        if snapshot.decision is not None:
            for name, loss in snapshot.decision.ranking:
                self._log.log(rr.new_entity_path(["loss", name]), rr.Scalars(loss))
        for axis, counts in zip(AXES, snapshot.counts, strict=True):
            self._log.log(f"histogram/{axis}", rr.BarChart(counts))

    def close(self) -> None:
        """Log the rest and close the file."""
        self._log_rows()
        self._log.flush()
        self._log.disconnect()

    def _log_rows(self) -> None:
        while len(block := self._rows.read()):
            if block.missed:
                self._say("WARN", f"{block.missed} rows before {block.time_s[0]:.3f} s were not logged")
            times = rr.TimeColumn(TIMELINE, duration=np.asarray(block.time_s))
            for axis, values in zip(AXES, block.wrench.T, strict=True):
                columns = rr.Scalars.columns(scalars=np.ascontiguousarray(values))
                rr.send_columns(f"wrench/{axis}", indexes=[times], columns=columns, recording=self._log)

    def _say(self, level: str, *texts: str) -> None:
        for text in texts:
            if text not in self._logged:
                self._logged.add(text)
                self._log.log("session", rr.TextLog(text, level=level))


def main() -> None:
    """Name pushes and log them."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("source", help="URL of the source, as for granular-id live")
    parser.add_argument("model", help="file of a trained model")
    parser.add_argument("log", help="file to be written, .rrd")
    parser.add_argument("--n", type=int, help="end after so many answers")
    options = parser.parse_args()
    with stop_on_signals(), opened(options.source) as stream, Views([RerunLog(stream, options.log)]) as views:
        live = LiveIdentifier(stream, Identifier.load(options.model), views=views)
        for push in live.pushes(options.n):
            print(push)
        print(live.summary())


if __name__ == "__main__":
    main()
