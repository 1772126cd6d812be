"""Reads many damaged copies of the golden files of version 7.3; started by test_mat_fuzz.py, in its own process.

``python mat_fuzz_work.py 100000 7`` runs a longer campaign from another seed, and leaves the file at fault behind.
"""

import random
import sys
import tempfile
from collections import Counter
from pathlib import Path

from granular_id.io import RecordingFileError, load

GOLDEN = Path(__file__).parents[2] / "data" / "mat"


def changed(data: bytes, rng: random.Random) -> bytes:
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 4))):
        at, width = rng.randrange(len(out)), rng.choice((1, 1, 2, 4, 8))
        top = 2 ** (8 * width)
        value = rng.choice((0, 1, 7, top // 2 - 1, top - 1, rng.randrange(top)))
        out[at : at + width] = value.to_bytes(width, "little")
    return bytes(out[: rng.randrange(len(out))] if rng.random() < 0.05 else out)


def main(n_files: int, seed: int) -> None:
    rng = random.Random(seed)
    sources = [path.read_bytes() for path in sorted(GOLDEN.glob("*_v73.mat"))]
    path = Path(tempfile.mkdtemp()) / "changed.mat"
    outcomes: Counter[str] = Counter()
    for _ in range(n_files):
        path.write_bytes(changed(rng.choice(sources), rng))
        try:
            load(path)
            outcomes["read"] += 1
        except RecordingFileError:
            outcomes["refused"] += 1
        except BaseException:
            print(f"at fault: {path}", file=sys.stderr)
            raise
    path.unlink()
    path.parent.rmdir()
    print(f"{n_files} files: {dict(outcomes)}")


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0)
