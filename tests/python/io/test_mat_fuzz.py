"""MAT files with bytes changed: read, or refused by one clear error; never anything else.

Version 7.3 goes through the HDF5 library, which damage may end together with its process: those run in a process
of their own.
"""

from __future__ import annotations

import subprocess
import sys
import zlib
from pathlib import Path

import pytest
from hypothesis import HealthCheck, example, given, settings, strategies as st

from effort import cases
from granular_id.io import RecordingFileError, load
from mat_cases import GOLDEN

WORK = Path(__file__).with_name("mat_fuzz_work.py")
FILES = sorted(path.name for path in GOLDEN.glob("*_v[4567].mat"))
N_BYTES = {name: (GOLDEN / name).stat().st_size for name in FILES}

_changes = st.lists(st.tuples(st.integers(0, 1 << 20), st.integers(0, 255)), min_size=1, max_size=8)


def outcome(path: Path) -> str:
    """Read a file, or see it refused by name; anything else is raised."""
    try:
        return f"{len(load(path))} recordings"
    except RecordingFileError as error:
        if not str(error).startswith(str(path)):
            raise
        return "refused"


def opened(data: bytes) -> bytes:
    """The same file with its compressed variables unpacked, so that changes meet what is inside."""
    at, out = 128, data[:128]
    while at < len(data):
        kind, size = (int.from_bytes(data[at + i : at + i + 4], "little") for i in (0, 4))
        part = data[at : at + 8 + size]
        out += zlib.decompress(part[8:]) if kind == 15 else part
        at += 8 + size
    return out


@settings(max_examples=cases(60), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.sampled_from(FILES), st.booleans(), _changes, st.none() | st.integers(0, 1 << 20))
@example("x_y_v7.mat", False, [(0, 77)], None)
def test_changed_bytes_are_read_or_refused(
    tmp_path: Path, name: str, unpack: bool, changes: list[tuple[int, int]], cut: int | None
) -> None:
    data = (GOLDEN / name).read_bytes()
    if unpack and not name.endswith("v4.mat"):
        data = opened(data)
    changed = bytearray(data)
    for at, byte in changes:
        changed[at % len(data)] = byte
    path = tmp_path / "changed.mat"
    path.write_bytes(changed if cut is None else changed[: cut % len(data)])
    outcome(path)


@settings(max_examples=cases(60), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.binary(max_size=400), st.booleans())
def test_any_bytes_behind_a_header_are_read_or_refused(tmp_path: Path, data: bytes, header: bool) -> None:
    path = tmp_path / "any.mat"
    path.write_bytes((b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM" if header else b"") + data)
    with pytest.raises(RecordingFileError):
        load(path)


def test_changed_hdf5_does_not_end_the_process() -> None:
    pytest.importorskip("h5py")
    n_files = str(cases(60))
    run = subprocess.run(
        [sys.executable, "-W", "error", str(WORK), n_files], capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr[-2000:]
    assert run.stdout.startswith(f"{n_files} files: ")
