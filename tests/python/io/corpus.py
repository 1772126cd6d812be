"""The corpus: the 150 hostile files that differ most, of all formats, and what comes of reading each.

``corpus/files.tar.xz`` holds them as they were made once, so that no version of a library makes others: a folder each.
A line of ``corpus/table.jsonl`` is folder, name, how it was made, what is loaded, options, verdict (read, refused).
They were chosen from 1,413, format by format in turn: of one file for each message (without names and numbers) the one
whose words are least like those of any chosen before.

``python corpus.py`` reads them all, says which verdicts are others now, and stores these.
``python corpus.py add NAME HOW FOLDER LOADED VERDICT`` adds what lies in a folder; ``LOADED`` is a path in it.
``python corpus.py read`` is the process that `answers` starts.
"""

from __future__ import annotations

import hashlib
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tarfile
from collections.abc import Iterable, Iterator
from dataclasses import astuple, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir
from typing import Any

CORPUS = Path(__file__).resolve().parents[1] / "corpus"
TABLE, FILES = CORPUS / "table.jsonl", CORPUS / "files.tar.xz"
HANGS_AFTER_S = 120

ODD = (
    *("os.chmod", "os.exec", "os.fork", "os.link", "os.posix_spawn", "os.remove", "os.rename", "os.symlink"),
    *("os.system", "os.truncate", "pickle.", "shutil.", "socket.", "sqlite3.enable_load", "subprocess."),
    "urllib.",
)
"""Events of the interpreter that are more than reading."""
WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT


@dataclass(frozen=True)
class HostileFile:
    """A line of the table."""

    number: str
    name: str
    how: str
    loaded: str
    options: dict[str, Any]
    verdict: str

    def path(self, folder: Path) -> Path:
        return folder / self.number / self.loaded


@dataclass(frozen=True)
class Answer:
    """What came of reading a file: a digest of the recordings, refused, or how it ended."""

    verdict: str
    megabytes: float

    @property
    def outcome(self) -> str:
        """Read in place of a digest."""
        return self.verdict if self.verdict == "refused" or " " in self.verdict else "read"


def hostile_files() -> list[HostileFile]:
    return [HostileFile(*json.loads(line)) for line in TABLE.read_text(encoding="ascii").splitlines()]


def unpack(folder: Path) -> None:
    """Write the files: links, pipes and holes as they were."""
    trusted = {"filter": "fully_trusted"} if sys.version_info >= (3, 12) else {}
    with tarfile.open(FILES) as archive:
        archive.extractall(folder, **trusted)


def answers(files: Iterable[tuple[Path, dict[str, Any]]]) -> list[Answer]:
    """Load files with their options, each in a process of its own, which a crash or a hang ends alone."""
    lines = "".join(json.dumps([str(path), options]) + "\n" for path, options in files)
    command = [sys.executable, __file__, "read"]
    ran = subprocess.run(command, input=lines, stdout=subprocess.PIPE, check=True, text=True)
    return [Answer(*json.loads(line)) for line in ran.stdout.splitlines()]


def answers_of_all() -> Iterator[tuple[HostileFile, Answer]]:
    every = hostile_files()
    with TemporaryDirectory() as place:
        unpack(Path(place))
        yield from zip(every, answers((file.path(Path(place)), file.options) for file in every), strict=True)


def _serve() -> None:
    """Answer each line of standard input by a fork, which has the libraries that this process loads once."""
    import h5py  # noqa: F401
    import mcap.reader  # noqa: F401
    import pyarrow.parquet  # noqa: F401
    import rosbags.highlevel  # noqa: F401
    import scipy.io  # noqa: F401

    import granular_id.io  # noqa: F401

    for line in sys.stdin:
        path, options = json.loads(line)
        print(json.dumps(astuple(_in_a_fork(Path(path), options))), flush=True)


def _in_a_fork(path: Path, options: dict[str, Any]) -> Answer:
    here, there = os.pipe()
    child = os.fork()
    if not child:
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        signal.alarm(HANGS_AFTER_S)
        verdict = _verdict(path, options)
        grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
        os.write(there, json.dumps([verdict, grown / (1e6 if sys.platform == "darwin" else 1e3)]).encode())
        os._exit(0)
    os.close(there)
    with os.fdopen(here, "rb") as pipe:
        sent = pipe.read()
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    return Answer(*json.loads(sent)) if sent else Answer(f"ended by {code}", 0.0)


def _verdict(path: Path, options: dict[str, Any]) -> str:
    from granular_id.io import RecordingFileError, load

    odd = _odd_events(path)
    try:
        verdict = _digest(load(path, **options))
    except RecordingFileError as error:
        verdict = "refused" if str(error).isprintable() else f"refused by {error!r}"
    except BaseException as error:
        verdict = f"raised {error!r}"
    return f"did more than read: {', '.join(odd)}" if odd else verdict


def _odd_events(path: Path) -> list[str]:
    """Return a list that grows by what is opened outside of the data set or done besides reading."""
    found: list[str] = []
    temporary = gettempdir()
    own = next(folder for folder in (path, *path.parents) if folder.name == "set").resolve()
    outside = ("/etc/", "/dev/zero", f"{own.parents[1]}/")
    sys.dont_write_bytecode = True

    def watch(event: str, arguments: Any) -> None:
        if event == "open" and isinstance(arguments[0], (str, bytes)):
            opened = os.path.realpath(os.fsdecode(arguments[0]))
            writes = (
                (arguments[2] or 0) & WRITES and opened != os.devnull and not opened.startswith(temporary)
            )
            if (opened.startswith(outside) and not opened.startswith(str(own))) or writes:
                found.append(f"{event} {opened!a}")
        elif (
            event.startswith(ODD)
            and temporary not in str(arguments[0])
            and not _is_of_a_library(event, arguments)
        ):
            found.append(f"{event} {arguments!a}")

    sys.addaudithook(watch)
    return found


def _is_of_a_library(event: str, arguments: Any) -> bool:
    """True if a library asks what system this is, or empties a temporary folder of its own."""
    return arguments[0] == "uname" or (event == "os.remove" and arguments[1] >= 0)


def _digest(data: Any) -> str:
    """Digest the recordings of a data set."""
    parts = hashlib.sha256()
    for r in data:
        parts.update(
            repr((r.name, r.label, r.session, r.rate_hz, r.start_time, r.trigger_index, r.meta)).encode()
        )
        parts.update(
            r.wrench.tobytes() + r.times().tobytes() + (b"" if r.flags is None else r.flags.tobytes())
        )
    return parts.hexdigest()[:16]


def _store(files: list[HostileFile]) -> None:
    TABLE.write_text("".join(json.dumps(astuple(file)) + "\n" for file in files), encoding="ascii")


def _add(name: str, how: str, folder: str, loaded: str, verdict: str) -> None:
    every = hostile_files()
    number = f"{len(every):04}"
    added = HostileFile(number, name, how, loaded, {}, verdict)
    with TemporaryDirectory() as place:
        unpack(Path(place))
        shutil.copytree(folder, Path(place) / number, symlinks=True)
        (answer,) = answers([(added.path(Path(place)), {})])
        if answer.outcome != verdict:
            sys.exit(f"it is {answer.outcome}, not {verdict}: nothing was added")
        command = "tar --sort=name --mtime=@0 --owner=0 --group=0 --numeric-owner -cSf - . | xz -9e"
        with FILES.open("wb") as file:
            subprocess.run(command, shell=True, cwd=place, stdout=file, check=True)
    _store([*every, added])


def main() -> None:
    if sys.argv[1:2] == ["read"]:
        _serve()
    elif sys.argv[1:2] == ["add"]:
        _add(*sys.argv[2:])
    else:
        now = []
        for file, answer in answers_of_all():
            now.append(HostileFile(*astuple(file)[:-1], answer.outcome))
            if answer.outcome != file.verdict:
                print(f"{file.number} {file.name}: {file.verdict} -> {answer.outcome}")
        _store(now)


if __name__ == "__main__":
    main()
