"""The corpus of files that are no recordings, for every format: each is refused by name, and the rest still loads."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from effort import cases
from good_files import PATHS, write_good

Make = Callable[[Path], Path]

CUTS = 10
FLIPS = min(40, cases(2))
FOLDERS = {
    "archive": ("recordings.parquet", "samples/part-00000.parquet"),
    "ros2": ("x.db3",),
    "ros2 mcap": ("x.mcap",),
}
"""Formats that are folders, and the files in them that may be cut off."""

MAGIC = {
    "csv": b"time,fx,fy,fz,tx,ty,tz\n",
    "npy": b"\x93NUMPY\1\0",
    "npz": b"PK\3\4",
    "mat v4": bytes(20),
    "mat v5": b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM",
    "mat v7.3": b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM" + bytes(384) + b"\x89HDF\r\n\x1a\n",
    "hdf5": b"\x89HDF\r\n\x1a\n",
    "parquet": b"PAR1",
    "mcap": b"\x89MCAP0\r\n",
    "ros1": b"#ROSBAG V2.0\n",
    "db3": b"SQLite format 3\0",
}
"""How the files of each ending begin."""

OTHER = {
    "csv": "npz",
    "npy": "csv",
    "npz": "mat v7",
    "mat v5": "npz",
    "hdf5": "parquet",
    "parquet": "hdf5",
    "mcap": "ros1",
    "ros1": "mcap",
    "db3": "npy",
}
"""For each ending, a kind whose files do not belong under it."""

PNG = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\1\0\0\0\1\x08\2\0\0\0"
GIB = 1 << 30


@dataclass(frozen=True)
class BadCase:
    """A way to make a bad file.

    Parameters
    ----------
    kind : str
        Which good file lies beside it, see ``good_files.PATHS``.
    make : callable
        Writes into an empty folder and returns the bad file.
    direct : bool
        Whether the path itself is loaded; otherwise the folder it is in.
    listed : bool
        Whether a folder with it and a good file lists it as skipped; a folder called ``bad.npz`` is just empty.
    refused : bool
        Whether it must be refused; a flipped bit may leave numbers that are as good as others.
    whole : bool
        The fault spoils the folder as a whole: nothing can be skipped.
    options : mapping
        Further settings of ``load``.
    """

    kind: str
    make: Make
    direct: bool = True
    listed: bool = True
    refused: bool = True
    whole: bool = False
    options: Mapping[str, object] = field(default_factory=dict)


@dataclass(frozen=True)
class BadFile:
    """A bad file that was made: `path` is loaded, `bad` is what errors name, `folder` has a good one beside it."""

    name: str
    case: BadCase
    path: Path
    bad: Path
    folder: Path

    def job(self) -> dict[str, object]:
        """Return what `bad_files_work` is told."""
        options = {**({"rate_hz": 500.0} if self.case.kind == "npy" else {}), **self.case.options}
        place = self.folder.parent if self.case.whole else self.folder
        return {
            "path": os.fspath(self.path),
            "folder": os.fspath(self.folder),
            "inside": os.fspath(place),
            "options": options,
        }


def make_corpus(folder: Path, cases: Mapping[str, BadCase]) -> list[BadFile]:
    """Write the cases, each into a folder of its own with a good file of the same kind."""
    made = []
    for i, (name, case) in enumerate(cases.items()):
        inner = folder / f"{i:04}" / "set"
        rice, peas = _made(inner / "rice"), _made(inner / "peas")
        bad = case.make(inner if case.whole else rice)
        if not case.whole:
            write_good(case.kind, peas)
        made.append(BadFile(name, case, bad if case.direct else inner, bad, inner))
    return made


def common_cases() -> Iterator[tuple[str, BadCase]]:
    """Yield what can be wrong with files of any format."""
    for kind in PATHS:
        for i in range(CUTS):
            for inner in FOLDERS.get(kind, ("",)):
                yield f"{kind}: {inner} cut at {i}/{CUTS}", BadCase(kind, partial(cut, kind, inner, i))
        for i in range(FLIPS):
            yield f"{kind}: flipped {i}", BadCase(kind, partial(flipped, kind, i), refused=False)
    noise = np.random.default_rng(0).bytes(5000)
    for kind, magic in MAGIC.items():
        contents = {
            "empty": b"",
            "noise": noise,
            "magic only": magic,
            "noise behind the magic": magic + noise,
            "zeros": bytes(5000),
            "a picture": PNG,
            "a web page": b"<!DOCTYPE html>\n<html><body>404</body></html>\n" * 20,
            "text in another encoding": "Zeit;Kraft in Röhre\n".encode("utf-16") * 50,
        }
        for what, data in contents.items():
            yield f"{kind}: {what}", BadCase(kind, partial(written, kind, data))
        yield f"{kind}: a gigabyte behind the magic", BadCase(kind, partial(sparse, kind, magic, GIB))
        yield f"{kind}: too large", BadCase(kind, partial(sparse, kind, magic, 5 * GIB))
        for what, make in ODD_PLACES.items():
            direct = what in ("folder", "pipe")
            yield f"{kind}: {what}", BadCase(kind, partial(make, kind), direct, what != "folder")
    for kind, other in OTHER.items():
        yield f"{kind}: holds {other}", BadCase(kind, partial(disguised, kind, other))


def bad_path(kind: str, folder: Path) -> Path:
    """Return the name of a bad file with the ending of a kind."""
    return folder / f"bad{Path(PATHS[kind]).suffix}"


def written(kind: str, data: bytes, folder: Path) -> Path:
    path = bad_path(kind, folder)
    path.write_bytes(data)
    return path


def cut(kind: str, inner: str, tenth: int, folder: Path) -> Path:
    """Cut a good file off, somewhere; text after a comma, because a shorter number is as good as a longer one."""
    path = write_good(kind, folder)
    file = path / inner if inner else path
    data = file.read_bytes()
    end = len(data) - 1 if tenth == 0 else len(data) * tenth // CUTS
    file.write_bytes(data[: data.rindex(b",", 0, end) + 1 if path.suffix == ".csv" else end])
    return path


def flipped(kind: str, seed: int, folder: Path) -> Path:
    """Change some bytes of a good file, more of them with every seed."""
    path = write_good(kind, folder)
    rng = np.random.default_rng(seed)
    file = path / rng.choice(FOLDERS[kind]) if kind in FOLDERS else path
    data = bytearray(file.read_bytes())
    for place in rng.integers(0, len(data), 1 << seed):
        data[place] ^= 1 << int(rng.integers(8))
    file.write_bytes(data)
    return path


def sparse(kind: str, magic: bytes, n_bytes: int, folder: Path) -> Path:
    """Write a file of zeros behind its magic number that takes no room on the disk."""
    path = written(kind, magic, folder)
    os.truncate(path, n_bytes)
    return path


def disguised(kind: str, other: str, folder: Path) -> Path:
    return write_good(other, folder).rename(bad_path(kind, folder))


def _folder(kind: str, folder: Path) -> Path:
    return _made(bad_path(kind, folder))


def _pipe(kind: str, folder: Path) -> Path:
    os.mkfifo(bad_path(kind, folder))
    return bad_path(kind, folder)


def _link(target: Callable[[str, Path], object], kind: str, folder: Path) -> Path:
    path = bad_path(kind, folder)
    path.symlink_to(target(kind, folder))
    return path


def outside(folder: Path, name: str = "outside") -> Path:
    """Return a folder that nothing in the data set may lead to; `folder` is in the data set."""
    return _made(next(place for place in (folder, *folder.parents) if place.name == "set").parent / name)


ODD_PLACES: dict[str, Callable[[str, Path], Path]] = {
    "folder": _folder,
    "pipe": _pipe,
    "link to nothing": partial(_link, lambda kind, folder: "nothing"),
    "link to itself": partial(_link, lambda kind, folder: bad_path(kind, folder).name),
    "link to the passwords": partial(_link, lambda kind, folder: "/etc/passwd"),
    "link to a device": partial(_link, lambda kind, folder: "/dev/zero"),
    "link out to a good file": partial(_link, lambda kind, folder: write_good(kind, outside(folder))),
    "link out to a pipe": partial(_link, lambda kind, folder: _pipe(kind, outside(folder))),
    "link up and out": partial(
        _link, lambda kind, folder: os.path.relpath(write_good(kind, outside(folder)), folder)
    ),
}


def _made(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    return folder
