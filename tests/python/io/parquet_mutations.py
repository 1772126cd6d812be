"""Damages a Parquet archive over and over and reads it: run as a process of its own, which a crash would end.

``python parquet_mutations.py SEED CASES`` prints a JSON object: how many cases were read as written, read with other
content, and refused; and the peak of memory and the slowest case. Any exception but RecordingFileError ends it.
"""

import json
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from granular_id.io import RecordingFileError, load
from granular_id.io.parquet.save import save_parquet
from granular_id.recording import Dataset, Recording, StepReport

INTERESTING = (b"\x00", b"\xff", b"\x7f", b"\x80", b"\xff\xff\xff\xff\x07", b"\x80\x80\x80\x80\x10", b"PAR1")


def archive_data():
    """A small data set that uses every column: rates and stamps, flags, both encodings, texts."""
    rng = np.random.default_rng(5)
    recordings = []
    for i in range(9):
        n = int(rng.integers(1, 60))
        wrench = rng.standard_normal((n, 6))
        wrench[:, :3] = np.round(wrench[:, :3] * 4) / 4
        clock = {"rate_hz": 500.0} if i % 3 else {"time_s": np.arange(n) * 0.01 + (np.arange(n) > 2) * 0.5}
        flags = rng.integers(0, 16, n) if i % 4 == 1 else None
        recordings.append(
            Recording(
                wrench,
                **clock,
                flags=flags,
                label=("rice", "oat flakes", None)[i % 3],
                session=f"s{i // 5}",
                start_time=1.7e9 + i if i % 2 else None,
                trigger_index=0 if i % 2 else None,
                meta={"tool": "cylinder", "depth_m": [0.076, i]},
                name=f"push {i}",
            )
        )
    return Dataset(recordings, [StepReport("load", {"format": "csv"}, notes=["written for mutations"])])


def mutated(rng, good):
    """Flip bits, overwrite, cut out, insert, double and cut off: a few of them at once, footers more often."""
    data = bytearray(good)
    for _ in range(int(rng.integers(1, 4))):
        footer = int.from_bytes(good[-8:-4], "little") + 8
        low = max(0, len(data) - footer) if rng.random() < 0.6 else 0
        at = int(rng.integers(low, max(low + 1, len(data))))
        size = int(rng.integers(1, 9))
        kind = rng.integers(7)
        if kind == 0 and data:
            data[at % len(data)] ^= 1 << int(rng.integers(8))
        elif kind == 1:
            data[at : at + size] = rng.bytes(size)
        elif kind == 2:
            del data[at : at + size]
        elif kind == 3:
            data[at:at] = INTERESTING[int(rng.integers(len(INTERESTING)))]
        elif kind == 4:
            patch = INTERESTING[int(rng.integers(len(INTERESTING)))]
            data[at : at + len(patch)] = patch
        elif kind == 5:
            other = int(rng.integers(0, len(data) + 1))
            data[at : at + size] = data[other : other + size]
        elif rng.random() < 0.2:
            del data[at:]
    return bytes(data)


def main(seed, n_cases):
    rng = np.random.default_rng(seed)
    data = archive_data()
    counts = {"as written": 0, "other content": 0, "refused": 0}
    slowest = 0.0
    with tempfile.TemporaryDirectory() as folder:
        archive = save_parquet(data, Path(folder) / "archive", recordings_per_group=4)
        files = [archive / "recordings.parquet", archive / "samples" / "part-00000.parquet"]
        good = {file: file.read_bytes() for file in files}
        assert load(archive) == data
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        for case in range(n_cases):
            file = files[case % 2]
            file.write_bytes(mutated(rng, good[file]))
            Path(folder, "case").write_text(str(case))
            start = time.process_time()
            try:
                read = load(archive)
                counts["as written" if read == data else "other content"] += 1
                assert all(np.isfinite(r.wrench).all() for r in read)
            except RecordingFileError:
                counts["refused"] += 1
            except BaseException:
                print(f"seed {seed}, case {case}", file=sys.stderr)
                raise
            slowest = max(slowest, time.process_time() - start)
            file.write_bytes(good[file])
        grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    print(json.dumps({**counts, "slowest_s": round(slowest, 3), "memory_mb": grown // 1024}))


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
