"""Folders that are no data sets: indexes, histories, archives and bags that lie, and names that are no names."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow
import pyarrow.parquet

from bad_contents import HISTORIES, MANY
from bad_files import MAGIC, ODD_PLACES, BadCase, outside
from good_files import PATHS, write_good
from test_csv_bad_index import BAD_INDEX, GOOD as GOOD_CSV
from test_parquet_bad_files import INDEX, PART, rewrite, with_column

SECRET = "0,1,2,3,4,5,6\n"

NAMES = {
    "with a line end": "bad\n_1",
    "with a code for terminals": "bad\x1b[2J_1",
    "with a bell": "bad\a_1",
    "that is not UTF-8": os.fsdecode(b"bad\xff_1"),
    "with a separator of lines": "bad\u2028_1",
    "with text from right to left": "bad\u202e_1",
    "of 255 bytes": "b" * 255,
    "with a backslash": "a\\..\\bad_1",
    "like an address": "http:bad_1",
    "like a query": "bad?mode=rw&x=%2e%2e_1",
    "with a hash": "bad#1_1",
    "with blanks": "  bad_1  ",
    "of points": "bad..._1",
}
"""Names that files may have, without their endings."""

NAMED_KINDS = ("csv", "npz", "mat v7.3", "hdf5", "db3")
"""Opened by Python, and by two libraries in C that want the name in their own way."""

INDEX_LINES = {
    "no such column": b"name\nrice\n",
    "up and out": b"file,label\n../outside/secret_1.csv,rice\n",
    "absolute": b"file,label\n/etc/passwd.csv,rice\n",
    "a link out": b"file,label\nlink_1.csv,rice\n",
    "a folder of links": b"file,label\nlinks/secret_1.csv,rice\n",
    "itself, by a link": b"file,label\nloop/good.csv,rice\n",
    "meta nested 100,000 deep": b'file,meta\ngood.csv,"' + b"[" * 100_000 + b'"\n',
    "meta with a number of 100,000 digits": b'file,meta\ngood.csv,"[' + b"1" * 100_000 + b']"\n',
    "meta of millions of objects": b'file,meta\ngood.csv,"{""a"":[' + MANY.encode() + b']}"\n',
    "a cell of megabytes": b"file,label\ngood.csv," + b"a" * (4 << 20) + b"\n",
    "a million lines": b"file,label\n" + b"good.csv,rice\n" * 1_000_000,
    "a million columns": b"file" + b",a" * 1_000_000 + b"\n",
    "a label with a line end": b'file,label\ngood.csv,"ri\nce"\n',
    "a name with a code for terminals": b'file,name\ngood.csv,"a\x1b[2J"\n',
    "a label of 100,000 characters and a space": b"file,label\ngood.csv," + b"r" * 100_000 + b" \n",
}
"""Indexes that cannot be used; test_csv_bad_index.py has more."""

COLUMNS = {
    "file": (
        "../../outside/x.parquet",
        "/etc/passwd",
        "samples/../../x",
        "samples/part-00000.parquet\0",
        "",
        "\x1b[2J",
    ),
    "n_samples": (0, -1, 2**62, 41),
    "row_group": (1, -1, 2**31),
    "id": (1, -1),
    "rate_hz": (0.0, -1.0, np.inf),
    "start_time": (np.inf,),
    "trigger_index": (-7, 40),
    "meta": ("[" * 100_000, "[]", '{"a": NaN}', "{", "\0"),
    "label": ("", " rice", "ri\nce", "a\x1b[2J"),
    "name": ("a\x1b[2J\nb",),
}
"""What cannot stand in the first row of an archive's index."""


def folder_cases() -> Iterator[tuple[str, BadCase]]:
    """Yield what spoils a folder."""
    for what, (data, *_) in BAD_INDEX.items():
        yield f"index: {what}", BadCase("csv", partial(_indexed, data), whole=True)
    for what, data in INDEX_LINES.items():
        yield f"index: {what}", BadCase("csv", partial(_indexed, data), whole=True)
    for what, text in HISTORIES.items():
        yield f"history.json: {what}", BadCase("csv", partial(_with_history, text), whole=True)
        yield f"archive: history {what}", BadCase("archive", partial(_with_history_inside, text))
    for what, text in MARKS.items():
        yield f"archive: mark {what}", BadCase("archive", partial(_labelled, "granular_id", text))
    for name, values in COLUMNS.items():
        for value in values:
            yield f"archive: {name} is {value!r:.30}", BadCase("archive", partial(_column, name, value))
    for what, make in ODD_PLACES.items():
        for inner in (INDEX, PART, "history.json"):
            if inner == PART or what in STILL_A_FILE:
                yield f"archive: {inner} is a {what}", BadCase("archive", partial(_replaced, inner, make))
    for kind in NAMED_KINDS:
        for what, name in NAMES.items():
            yield f"{kind}: a bad file with a name {what}", BadCase(kind, partial(_named, kind, name, False))
            yield (
                f"{kind}: a good file with a name {what}",
                BadCase(kind, partial(_named, kind, name, True), refused=False),
            )


STILL_A_FILE = ("link to the passwords", "link out to a good file", "link up and out")
"""Odd places that look like a file until it is asked where they lead."""

MARK = {"format": "recordings", "version": 1}
MARKS = {
    "is empty": "",
    "is nested 100,000 deep": "[" * 100_000,
    "holds millions of objects": json.dumps({**MARK, "axes": []}).replace("[]", f"[{MANY}]"),
    "is of the future": json.dumps({"format": "recordings", "version": 9}),
    "names no axes": json.dumps({"format": "recordings", "version": 1, "axes": [], "columns": []}),
    "names axes twice": json.dumps(
        {"format": "recordings", "version": 1, "axes": ["fx"] * 6, "columns": ["fx"] * 6}
    ),
    "names columns that are not there": json.dumps(
        {"format": "recordings", "version": 1, "axes": ["a"], "columns": ["a"]}
    ),
    "names axes with control characters": json.dumps(
        {"format": "recordings", "version": 1, "axes": ["a\x1b[2J", "b\n"], "columns": ["fx", "fy"]}
    ),
}


def _indexed(data: bytes, folder: Path) -> Path:
    """Write an index that lists a good file among others."""
    secrets = outside(folder)
    (secrets / "secret_1.csv").write_bytes(GOOD_CSV)
    (folder / "good.csv").write_bytes(GOOD_CSV)
    (folder / "folder.csv").mkdir()
    (folder / "link_1.csv").symlink_to("../outside/secret_1.csv")
    (folder / "links").symlink_to(secrets)
    (folder / "loop").symlink_to("loop")
    (folder / "index.csv").write_bytes(data)
    return folder


def _with_history(text: str, folder: Path) -> Path:
    (folder / "good.csv").write_bytes(GOOD_CSV)
    (folder / "index.csv").write_bytes(b"file,label\ngood.csv,rice\n")
    (folder / "history.json").write_text(text, encoding="latin-1")
    return folder


def _with_history_inside(text: str, folder: Path) -> Path:
    path = write_good("archive", folder)
    (path / "history.json").write_text(text, encoding="latin-1")
    return path


def _labelled(name: str, text: str, folder: Path) -> Path:
    path = write_good("archive", folder)
    labels = pyarrow.parquet.read_metadata(path / INDEX).metadata
    rewrite(path / INDEX, labels={**labels, name.encode(): text.encode()})
    return path


def _column(name: str, value: object, folder: Path) -> Path:
    path = write_good("archive", folder)
    old = pyarrow.parquet.ParquetFile(path / INDEX).read().column(name)
    rewrite(path / INDEX, with_column(name, pyarrow.array([value, old[1].as_py()], old.type)))
    return path


def _replaced(inner: str, make: object, folder: Path) -> Path:
    """Put something odd in the place of a file of an archive."""
    path = write_good("archive", folder)
    (path / inner).unlink(missing_ok=True)
    made = make("parquet", (path / inner).parent)
    made.rename(path / inner)
    return path


def _named(kind: str, name: str, good: bool, folder: Path) -> Path:
    ending = Path(PATHS[kind]).suffix
    path = folder / (name[: 255 - len(ending)] + ending)
    write_good(kind, folder).rename(path)
    if not good:
        path.write_bytes(MAGIC[kind] + bytes(9))
    return path
