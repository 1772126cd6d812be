"""The corpus: 150 hostile files of all formats that differ most, and what comes of reading each.

``corpus/files.tar.xz`` holds a folder each; a line of ``corpus/table.jsonl`` is folder, name, how it was made, what is
loaded, options, outcome (read, refused). ``python corpus.py`` reads all and stores the outcomes that are others now;
``python corpus.py read`` is the process that `outcomes` starts.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tarfile
from collections.abc import Iterable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

CORPUS = Path(__file__).resolve().parents[1] / "corpus"
TABLE = CORPUS / "table.jsonl"
HANGS_AFTER_S = 120


def rows() -> list[list[Any]]:
    return [json.loads(line) for line in TABLE.read_text(encoding="ascii").splitlines()]


def outcomes(files: Iterable[tuple[Path, dict[str, Any]]]) -> list[str]:
    """Load files with their options, each in a process of its own, which a crash or a hang ends alone."""
    lines = "".join(json.dumps([str(path), options]) + "\n" for path, options in files)
    command = [sys.executable, __file__, "read"]
    ran = subprocess.run(command, input=lines, stdout=subprocess.PIPE, check=True, text=True)
    return ran.stdout.splitlines()


def outcomes_of_all() -> list[str]:
    trusted = {"filter": "fully_trusted"} if sys.version_info >= (3, 12) else {}
    with TemporaryDirectory() as place, tarfile.open(CORPUS / "files.tar.xz") as archive:
        archive.extractall(place, **trusted)  # links, pipes and holes as they were
        return outcomes((Path(place, row[0], row[3]), row[4]) for row in rows())


def _serve() -> None:
    """Answer each line of standard input by a fork, which has the libraries that this process loads once."""
    import h5py  # noqa: F401
    import mcap.reader  # noqa: F401
    import pyarrow.parquet  # noqa: F401
    import rosbags.highlevel  # noqa: F401
    import scipy.io  # noqa: F401

    from granular_id.io import RecordingFileError, load

    for line in sys.stdin:
        path, options = json.loads(line)
        child = os.fork()
        if not child:
            signal.alarm(HANGS_AFTER_S)
            try:
                load(path, **options)
                outcome = "read"
            except RecordingFileError as error:
                outcome = "refused" if str(error).isprintable() else f"refused by {error!r}"
            except BaseException as error:
                outcome = f"raised {error!r}"
            print(outcome, flush=True)
            os._exit(0)
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        if code:
            print(f"ended by {code}", flush=True)


def main() -> None:
    if sys.argv[1:] == ["read"]:
        _serve()
        return
    now = [[*row[:-1], outcome] for row, outcome in zip(rows(), outcomes_of_all(), strict=True)]
    for old, new in zip(rows(), now, strict=True):
        if old != new:
            print(f"{old[0]} {old[1]}: {old[-1]} -> {new[-1]}")
    TABLE.write_text("".join(json.dumps(row) + "\n" for row in now), encoding="ascii")


if __name__ == "__main__":
    main()
