"""The corpus of hostile files: 1,331 of all formats, and what comes of reading each.

``corpus/files.tar.xz`` holds them as they were made once, so that no version of a library makes others: a folder each.
A line of ``corpus/table.jsonl`` is folder, name, how it was made, what is loaded, options, verdict (read, refused).

``python corpus.py`` reads them all, each in a fork, says which verdicts are others now, and stores these.
``python corpus.py add NAME HOW FOLDER LOADED VERDICT`` adds what lies in a folder; ``LOADED`` is a path in it.
"""

from __future__ import annotations

import hashlib
import json
import os
import resource
import shutil
import subprocess
import sys
import tarfile
import time
from collections.abc import Callable, Iterator
from dataclasses import astuple, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

CORPUS = Path(__file__).resolve().parents[1] / "corpus"
TABLE, FILES = CORPUS / "table.jsonl", CORPUS / "files.tar.xz"
HANGS_AFTER_S = 120


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

    def load(self, folder: Path) -> Any:
        from granular_id.io import load

        return load(self.path(folder), **self.options)


def hostile_files() -> list[HostileFile]:
    return [HostileFile(*json.loads(line)) for line in TABLE.read_text(encoding="ascii").splitlines()]


def unpack(folder: Path, numbers: set[str]) -> None:
    """Write the files of some numbers: links, pipes and holes as they were."""
    with tarfile.open(FILES) as archive:
        for member in archive:
            if len(parts := Path(member.name).parts) and parts[0] in numbers:
                archive.extract(
                    member, folder, **({"filter": "fully_trusted"} if sys.version_info >= (3, 12) else {})
                )


def digest(data: Any) -> str:
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


def outcome(verdict: str) -> str:
    """Return read in place of a digest."""
    return verdict if verdict == "refused" or " " in verdict else "read"


@dataclass(frozen=True)
class Answer:
    """What came of reading a file in a process of its own: a digest of the recordings, refused, or how it ended."""

    verdict: str
    seconds: float
    megabytes: float


def answers(read: Callable[[HostileFile, Path], Any]) -> Iterator[tuple[HostileFile, Answer]]:
    """Read all files, each in a fork, which a crash or a hang ends alone."""
    with TemporaryDirectory() as place:
        every = hostile_files()
        unpack(Path(place), {file.number for file in every})
        for file in every:
            yield file, in_a_fork(lambda file=file: _verdict(lambda: read(file, Path(place))))


def _verdict(read: Callable[[], Any]) -> str:
    from granular_id.io import RecordingFileError

    try:
        return digest(read())
    except RecordingFileError:
        return "refused"
    except BaseException as error:
        return f"raised {type(error).__name__}"


def in_a_fork(work: Callable[[], str]) -> Answer:
    """Run something in a fork; return what it says, its time and how much its memory grew."""
    here, there = os.pipe()
    start = time.monotonic()
    child = os.fork()
    if not child:
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        resource.setrlimit(resource.RLIMIT_CPU, (HANGS_AFTER_S, HANGS_AFTER_S))
        said = work()
        grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
        os.write(there, json.dumps([said, grown * (1e-6 if sys.platform == "darwin" else 1e-3)]).encode())
        os._exit(0)
    os.close(there)
    with os.fdopen(here, "rb") as pipe:
        said = pipe.read()
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    verdict, megabytes = json.loads(said) if said else (f"ended by {code}", 0.0)
    return Answer(verdict, time.monotonic() - start, megabytes)


def _store(files: list[HostileFile]) -> None:
    TABLE.write_text("".join(json.dumps(astuple(file)) + "\n" for file in files), encoding="ascii")


def main() -> None:
    if sys.argv[1:2] == ["add"]:
        name, how, folder, loaded, verdict = sys.argv[2:]
        every = hostile_files()
        number = f"{int(every[-1].number) + 1:04}"
        with TemporaryDirectory() as place:
            unpack(Path(place), {file.number for file in every})
            shutil.copytree(folder, Path(place) / number, symlinks=True)
            added = HostileFile(number, name, how, loaded, {}, verdict)
            answer = in_a_fork(lambda: _verdict(lambda: added.load(Path(place))))
            if outcome(answer.verdict) != verdict:
                sys.exit(f"it is {outcome(answer.verdict)}, not {verdict}: nothing was added")
            command = "tar --sort=name --mtime=@0 --owner=0 --group=0 --numeric-owner -cSf - . | xz -9e"
            with FILES.open("wb") as file:
                subprocess.run(command, shell=True, cwd=place, stdout=file, check=True)
        _store([*every, added])
        return
    now = []
    for file, answer in answers(HostileFile.load):
        verdict = "read" if outcome(answer.verdict) == "read" else "refused"
        now.append(HostileFile(*astuple(file)[:-1], verdict))
        if verdict != file.verdict:
            print(f"{file.number} {file.name}: {file.verdict} -> {verdict}")
    _store(now)


if __name__ == "__main__":
    main()
