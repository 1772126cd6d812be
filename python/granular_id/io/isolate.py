"""Reading in a child process: what a hostile file does to a library, it does there.

The parent asks for one file after the other, a line of JSON each. The child answers with a line of JSON, and then the
columns that the line announces; nothing is unpickled, and the parent checks them as it checks those of a file. They
come through a pipe: memory that both map, a child that was taken over could change or cut off while it is being read.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from threading import Timer
from types import TracebackType
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import freeze
from granular_id._schema import EACH, check_form
from granular_id.io.errors import RecordingFileError, printable
from granular_id.io.files import bytes_of, check_parts
from granular_id.io.flat import FlatRecordings, flatten, unflatten
from granular_id.io.formats import read_file
from granular_id.io.options import LoadOptions
from granular_id.io.source import FileContent, FileSource
from granular_id.recording import Dataset

try:
    import resource
except ImportError:  # Windows has no such limits
    resource = None  # type: ignore[assignment]

__all__ = ["IsolatedReader"]

_CHILD = ("-m", "granular_id.io.isolate")

_FREE_BYTES, _TIMES_SIZE = 1 << 30, 8
"""Memory of the child beyond that of the interpreter: so much, and so many times the size of the largest file."""

_FREE_S, _BYTES_PER_S = 20.0, 4e6
"""Seconds of processor time for a file, of any size and by its size; three times these by the clock on the wall."""

_LONGEST_LINE = 1 << 20
_MOST_DESCRIBED = 100_000
"""Recordings of a file of which as much may be said as of any; of more, less of each."""

_COLUMNS: dict[str, tuple[type, int]] = {
    "wrench": (np.float64, 2),
    "n_samples": (np.int64, 1),
    "rate_hz": (np.float64, 1),
    "start_time": (np.float64, 1),
    "trigger_index": (np.int64, 1),
    "time_s": (np.float64, 1),
    "flags": (np.uint8, 1),
    "about": (np.uint8, 1),
}
"""Type and number of axes of what the child sends; `about` is JSON in ASCII."""

_ANSWER: dict[str, Any] = {
    "columns?": {EACH: [int, ...]},
    "missing?": str,
    "error?": {"path": str, "problem": str, "line": (int, None), "column": (str, None), "place": (str, None)},
}
_ABOUT: dict[str, Any] = {
    **{name: [(str, None), ...] for name in ("label", "session", "name", "meta_json")},
    "axes": [str, ...],
    "history_json": str,
    "rows": [{"name": str, "moved?": int, "merged?": int, "first_stamp_s?": float, "remark?": str}, ...],
    "notes": [str, ...],
}
_QUIET = {
    "ARROW_DEFAULT_MEMORY_POOL": "system",  # others reserve a gigabyte that they may never use
    "MALLOC_ARENA_MAX": "2",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
}


class IsolatedReader:
    """Reads files in one child process, which is started again after a file that ended it."""

    def __init__(self, sources: Iterable[FileSource], options: LoadOptions) -> None:
        self._options = options
        largest = max(map(self._size, sources), default=0)
        self._most_bytes = _FREE_BYTES + _TIMES_SIZE * largest
        self._child: subprocess.Popen[bytes] | None = None

    def _size(self, source: FileSource) -> int:
        return min(bytes_of(source.path), self._options.max_binary_bytes)  # larger ones are refused

    def __enter__(self) -> IsolatedReader:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end()

    def read(self, source: FileSource) -> FileContent:
        """Read one file, as `read_file` does here."""
        child = self._child = self._child or self._started()
        assert child.stdin is not None
        assert child.stdout is not None
        cpu_s = _FREE_S + self._size(source) / _BYTES_PER_S
        asked = {**_sent(source), "cpu_s": cpu_s}
        ends = time.monotonic() + 3 * cpu_s
        clock = Timer(3 * cpu_s, child.kill)
        clock.daemon = True
        clock.start()
        try:
            child.stdin.write(_line(asked))
            child.stdin.flush()
            return self._content(child.stdout, source)
        except (EOFError, BrokenPipeError) as error:
            late = time.monotonic() >= ends
            raise RecordingFileError(source.path, self._death(late, cpu_s)) from error
        except (LookupError, TypeError, ValueError, RecursionError, MemoryError) as error:
            if isinstance(error, RecordingFileError):
                raise
            self._end()
            problem = f"the process that read it gave an answer that is none: {error!s:.200}"
            raise RecordingFileError(source.path, problem) from error
        finally:
            clock.cancel()

    def _started(self) -> subprocess.Popen[bytes]:
        child = subprocess.Popen(
            [sys.executable, *_CHILD],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            cwd=Path(__file__).parents[2],  # nothing is imported from the folder that is being read
            env={**os.environ, **_QUIET},
        )
        assert child.stdin is not None
        asked = {"folder": str(Path.cwd()), "options": asdict(self._options), "bytes": self._most_bytes}
        with contextlib.suppress(BrokenPipeError):  # the first file says so
            child.stdin.write(_line(asked))
        return child

    def _end(self, grace_s: float = 0) -> int:
        """End the child, whatever it does; return its exit code."""
        child, self._child = self._child, None
        if child is None:
            return 0
        with contextlib.suppress(subprocess.TimeoutExpired):
            child.wait(grace_s)
        child.kill()
        for pipe in (child.stdin, child.stdout):
            with contextlib.suppress(BrokenPipeError):  # what it no longer took
                if pipe is not None:
                    pipe.close()
        return child.wait()

    def _death(self, late: bool, cpu_s: float) -> str:
        code = self._end(grace_s=5)
        if late:
            return f"was not read within {3 * cpu_s:.0f} s"
        if code == -getattr(signal, "SIGXCPU", 0):
            return f"was not read within {cpu_s:.0f} s of processor time"
        how = signal.Signals(-code).name if code < 0 else f"exit code {code}"
        return f"what read it crashed ({how})"

    def _content(self, answers: IO[bytes], source: FileSource) -> FileContent:
        line = answers.readline(_LONGEST_LINE)
        if len(line) == _LONGEST_LINE:
            raise ValueError(f"a line of more than {_LONGEST_LINE} bytes")
        if not line.endswith(b"\n"):
            raise EOFError
        head = json.loads(line)
        check_form(head, _ANSWER, closed=True)
        if "error" in head:
            raise RecordingFileError(head["error"].pop("path"), head["error"].pop("problem"), **head["error"])
        if "missing" in head:
            raise ImportError(printable(head["missing"]))
        arrays = self._arrays(answers, head["columns"])
        text = arrays.pop("about").tobytes().decode("ascii")
        check_parts([text], "about", min(len(arrays["n_samples"]), _MOST_DESCRIBED))
        about = json.loads(text)
        check_form(about, _ABOUT, closed=True)
        rows, notes = freeze(about.pop("rows"), "rows"), about.pop("notes")
        content = unflatten(FlatRecordings(**arrays, **about), source.path, source)
        content.rows = [{name: _shown(value) for name, value in row.items()} for row in rows]
        content.notes = [printable(note) for note in notes]
        return content

    def _arrays(self, answers: IO[bytes], shapes: dict[str, list[int]]) -> dict[str, Any]:
        """Take the columns that were announced, of the types that they must have, within the memory of the child."""
        arrays: dict[str, Any] = {}
        left = self._most_bytes
        for name, shape in shapes.items():
            kind, n_axes = _COLUMNS.get(name, (np.uint8, 0))
            n_bytes = np.dtype(kind).itemsize
            for length in shape:
                n_bytes *= length
            left -= n_bytes
            if len(shape) != n_axes or min(shape, default=0) < 0 or left < 0:
                raise ValueError(f"column {name!r:.40} of shape {shape!r:.80}")
            array = arrays[name] = np.empty(shape, kind)
            room = array.reshape(-1).view(np.uint8).data
            while room:
                count = answers.readinto(room)  # type: ignore[attr-defined]
                if not count:
                    raise EOFError
                room = room[count:]
        return arrays


def _line(value: dict[str, Any]) -> bytes:
    return json.dumps(value).encode("ascii") + b"\n"


def _sent(source: FileSource) -> dict[str, Any]:
    """Return what a reader must know; label, session and meta are put on by the parent."""
    kept = ("name", "start_time", "trigger_index", "rate_hz", "irregular", "axes", "session_is_known")
    places = {name: os.fspath(getattr(source, name)) for name in ("path", "root")}
    return {"source": {**places, **{name: getattr(source, name) for name in kept}}}


def _shown(value: Any) -> Any:
    return printable(value) if isinstance(value, str) else value


# In the child.


def _serve() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends it
    warnings.simplefilter("ignore")
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what libraries print is no answer
    asked = json.loads(sys.stdin.readline())
    os.chdir(asked["folder"])
    options = LoadOptions(**asked["options"])
    _limit_memory(asked["bytes"])
    for line in sys.stdin:
        asked = json.loads(line)
        _limit("RLIMIT_CPU", int(time.process_time() + asked["cpu_s"]) + 1, for_good=False)
        known = asked["source"]
        known["axes"] = known["axes"] and tuple(known["axes"])
        source = FileSource(Path(known.pop("path")), Path(known.pop("root")), **known)
        head, columns = _answer(source, options)
        answers.write(_line(head))
        for column in columns:
            answers.write(np.ascontiguousarray(column).data)
        answers.flush()


def _answer(source: FileSource, options: LoadOptions) -> tuple[dict[str, Any], list[NDArray[Any]]]:
    try:
        content = read_file(source, options)
        flat = flatten(Dataset(content.recordings, content.history))
    except ImportError as error:
        return {"missing": str(error)}, []
    except (RecordingFileError, MemoryError) as error:
        if isinstance(error, MemoryError) or isinstance(error.__cause__, MemoryError):
            error = RecordingFileError(source.path, "needs more memory than a file of its size is given")
        return {"error": {name: getattr(error, name) for name in _ANSWER["error?"]}}, []
    texts = {name: list(getattr(flat, name)) for name in ("axes", "label", "session", "name", "meta_json")}
    about = {**texts, "history_json": flat.history_json, "rows": content.rows, "notes": content.notes}
    columns = {name: column for name in _COLUMNS if (column := getattr(flat, name, None)) is not None}
    columns["about"] = np.frombuffer(json.dumps(about).encode("ascii"), np.uint8)
    return {"columns": {name: list(column.shape) for name, column in columns.items()}}, [*columns.values()]


def _limit_memory(n_bytes: int) -> None:
    """Let the child map so much more than it has mapped; nothing of it is left to be dumped."""
    statm = Path("/proc/self/statm")
    # Linux; elsewhere the limit is not kept, or counts something else
    if resource is not None and statm.exists():
        _limit("RLIMIT_AS", n_bytes + int(statm.read_text().split()[0]) * resource.getpagesize())
        _limit("RLIMIT_CORE", 0)


def _limit(what: str, value: int, *, for_good: bool = True) -> None:
    """Lower a limit, which may be lower already and can then not be raised."""
    if resource is not None:
        kind = getattr(resource, what)
        hard = resource.getrlimit(kind)[1]
        value = value if hard == resource.RLIM_INFINITY else min(value, hard)
        resource.setrlimit(kind, (value, value if for_good else hard))


if __name__ == "__main__":
    _serve()
