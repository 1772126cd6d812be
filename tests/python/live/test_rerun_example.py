"""The example that logs a session for the Rerun viewer: every row is there, read back by Rerun's own reader."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

import granular_id as gid
from live_view_cases import pushes_and_model

pytest.importorskip("rerun", reason="rerun-sdk is not installed")

SCRIPT = Path(__file__).resolve().parents[3] / "examples" / "rerun_log.py"


def run(*words):
    command = [sys.executable, *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120, encoding="utf-8")
    return done.stdout


def test_every_row_and_answer_is_logged(tmp_path):
    data, model = pushes_and_model()
    pushes, file, log = (tmp_path / name for name in ("pushes.npz", "m.safetensors", "log.rrd"))
    gid.save(data[:4], pushes)
    model.save(file)
    assert "SYNTHETIC: 4 answers, " in run(SCRIPT, f"replay:{pushes}?speed=20&pause_s=0.5", file, log)
    printed = run("-m", "rerun", "rrd", "print", "-vvv", log)
    rows = {}
    for n, path in re.findall(r"Chunk\(\S+\) with (\d+) rows .*? - /(.*?) - ", printed):
        rows[path.strip()] = rows.get(path.strip(), 0) + int(n)
    assert {rows[f"wrench/{axis}"] for axis in ("fx", "fy", "fz", "tx", "ty", "tz")} == {4 * 500}
    assert {path for path in rows if path.startswith("loss/")} == {"loss/rice", r"loss/fine\ sugar"}
    assert sum(path.startswith("histogram/") for path in rows) == 6
    assert "SYNTHETIC: no sensor measures here" in printed
    assert "push 4: " in printed
