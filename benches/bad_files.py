"""What reading each hostile file takes: seconds and memory, the worst first.

Run: python benches/bad_files.py [rows]. Each file is loaded in a fork of a process that has imported all libraries; MB
is what the fork grew by.
"""

from __future__ import annotations

import contextlib
import sys
from collections import Counter
from importlib import import_module
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "python" / "io"))

from corpus import HostileFile, answers, outcome

LIBRARIES = ("granular_id.io", "h5py", "mcap", "pyarrow.parquet", "rosbags.typesys", "scipy.io", "sqlite3")


def main() -> None:
    n_rows = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    for name in LIBRARIES:
        with contextlib.suppress(ImportError):
            import_module(name)
    found = list(answers(HostileFile.load))
    print(dict(Counter(outcome(answer.verdict) for _, answer in found)))
    for what in ("seconds", "megabytes"):
        worst = sorted(found, key=lambda pair: -getattr(pair[1], what))[:n_rows]
        print(f"\n{'s':>7} {'MB':>6}  most {what}")
        for file, answer in worst:
            print(f"{answer.seconds:7.2f} {answer.megabytes:6.0f}  {file.name}")


if __name__ == "__main__":
    main()
