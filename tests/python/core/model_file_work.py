"""Reads the model files of a folder, in the order of their names, and prints for each what came and what it cost.

``python model_file_work.py FOLDER`` prints a JSON line per file: name, error (or null), ms, megabytes. Memory is what
the process took beyond what it had before the file: the kernel's high-water mark, started anew for every file.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

from granular_id._core import Model, ModelFileError

STATUS = Path("/proc/self/status")
START_ANEW = Path("/proc/self/clear_refs")


def kilobytes(field):
    for line in STATUS.read_text(encoding="ascii").splitlines():
        if line.startswith(field):
            return int(line.split()[1])
    raise LookupError(field)


def work(path):
    START_ANEW.write_text("5", encoding="ascii")
    before = kilobytes("VmRSS")
    began = time.perf_counter()
    try:
        Model.read(path)
    except ModelFileError as error:
        came = str(error)
    else:
        came = None
    ms = 1e3 * (time.perf_counter() - began)
    megabytes = (kilobytes("VmHWM") - before) / 1024
    return {"name": path.name, "error": came, "ms": ms, "megabytes": megabytes}


if __name__ == "__main__":
    for path in sorted(Path(sys.argv[1]).iterdir()):
        print(json.dumps(work(path)))
