"""The Rerun log holds every row and every answer, read back from the file by Rerun's own reader."""

import re
import subprocess
import sys

import numpy as np
import pytest

from granular_id.live.snapshot import Snapshot
from granular_id.live.snapshot_builder import SnapshotBuilder
from live_view_cases import CLASSES, answer, block, push

pytest.importorskip("rerun", reason="rerun-sdk is not installed")

from granular_id.live.rerun_log import RerunLog

ROWS = push()[0][:700]


def printed(path, detail):
    run = subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", "print", detail, str(path)],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
        encoding="utf-8",
    )
    return run.stdout


def chunks(text):
    """Rows of each entity, static ones included."""
    rows = {}
    for n, path in re.findall(r"Chunk\(\S+\) with (\d+) rows .*? - /(.*?) - ", text):
        rows.setdefault(path.strip(), []).append(int(n))
    return rows


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("rerun") / "session.rrd"
    builder = SnapshotBuilder(500.0, classes=CLASSES, source="sim:rice", synthetic=True)
    with RerunLog(path) as log:
        for start in range(0, len(ROWS), 16):
            builder.rows(block(ROWS[start : start + 16], start))
            log.publish(builder.build("triggered", answer((start + 16) / 500), lag_s=0.001, warnings=["gap"]))
        log.publish(builder.build("failed", hint="saturated"))
    assert log.dropped == 0
    return path


def test_every_row_is_there_in_few_chunks(log):
    rows = chunks(printed(log, "-v"))
    for kind in ("wrench", "residual"):
        for axis in ("fx", "fy", "fz", "tx", "ty", "tz"):
            found = rows[f"{kind}/{axis}"]
            assert sum(found) == len(ROWS) + 1  # and the static name of the line
            assert len(found) <= 2 + len(ROWS) / 100
    assert sum(rows["loss/rice"]) == len(range(0, len(ROWS), 16))
    assert len([path for path in rows if path.startswith("loss/")]) == len(CLASSES)
    assert len([path for path in rows if path.startswith("histogram/")]) == 6


def test_values_and_times_are_those_published(log):
    text = printed(log, "-vvv")
    tables = [part for part in text.split("\nChunk(") if "- /wrench/fx -" in part.partition("\n")[0]]
    found = {}
    for table in tables:
        for time_s, value in re.findall(r"┆ (P\S+)\s+┆ \[([-\d.e]+)\]", table):
            seconds = 0.0 if time_s == "P0D" else float(time_s.removeprefix("PT").removesuffix("S"))
            found[round(500 * seconds)] = float(value)
    assert sorted(found) == list(range(len(ROWS)))
    assert np.array_equal([found[i] for i in range(len(ROWS))], ROWS[:, 0])


def test_words_are_logged_once(log):
    text = printed(log, "-vvv")
    sessions = "".join(part for part in text.split("\nChunk(") if "- /session -" in part.partition("\n")[0])
    assert sessions.count("SYNTHETIC source") == 1
    assert sessions.count("gap: missing rows") == 1
    assert sessions.count("Failed: saturated") == 1
    assert 1 <= sessions.count("provisional: fine sugar") <= 20
    assert "SYNTHETIC sim:rice" in text


def test_rows_that_are_not_logged_are_told_each_time(tmp_path):
    with RerunLog(tmp_path / "lost.rrd") as log:
        for _ in range(2):
            log.publish(Snapshot("armed", fresh_lost=5))
    text = printed(tmp_path / "lost.rrd", "-vvv")
    assert "5 rows not logged so far" in text
    assert "10 rows not logged so far" in text


def test_a_session_without_rows_is_a_readable_file(tmp_path):
    with RerunLog(tmp_path / "idle.rrd") as log:
        log.publish(Snapshot("idle"))
    assert "Waiting" in printed(tmp_path / "idle.rrd", "-vvv")


def test_a_path_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"cannot write .*no/log.rrd: the folder .* does not exist"):
        RerunLog(tmp_path / "no" / "log.rrd")


def test_without_rerun_it_says_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(ImportError, match=r"granular-id\[live\]"):
        RerunLog(tmp_path / "log.rrd")
