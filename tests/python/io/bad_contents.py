"""Whole files with contents that are no recordings: values, clocks and labels that cannot be what they should."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

import good_files as good
from bad_files import BadCase, bad_path
from good_files import N_SAMPLES, TABLE, TIMES, TREE, WRENCH
from ros_cases import even_stamps, write_kind

START_S = 1.7e9


def _with(value: float, place: tuple[int, int] = (7, 2)) -> np.ndarray:
    changed = WRENCH.copy()
    changed[place] = value
    return changed


def _stamps(index: int, value: float) -> np.ndarray:
    changed = TIMES.copy()
    changed[index] = value
    return changed


BACKWARDS = np.concatenate([TIMES[:20], TIMES[10:30]])
REPEATED = np.repeat(TIMES[::2], 2)
CLOCKS = {
    "time runs backwards": BACKWARDS,
    "time runs backwards at the end": _stamps(-1, 0.0),
    "time stands still": np.zeros(N_SAMPLES),
    "stamps are repeated": REPEATED,
    "a stamp is NaN": _stamps(3, np.nan),
    "all stamps are NaN": np.full(N_SAMPLES, np.nan),
    "a stamp is infinite": _stamps(-1, np.inf),
    "time in milliseconds since 1970": (START_S + TIMES) * 1e3,
    "time in nanoseconds since 1970": (START_S + TIMES) * 1e9,
    "time without end": np.concatenate([[-1.7e308], TIMES[1:-1], [1.7e308]]),
}

TREES: dict[str, dict[str, object]] = {
    "NaN among the samples": {**TREE, "wrench": _with(np.nan)},
    "infinity among the samples": {**TREE, "wrench": _with(-np.inf)},
    "complex samples": {"wrench": WRENCH * 1j, "fs": 500.0},
    "samples too large for float64 sums": {"wrench": _with(np.inf, (0, 0)), "fs": 500.0},
    "five axes": {"wrench": WRENCH[:, :5], "fs": 500.0},
    "six by six": {"wrench": WRENCH[:6], "fs": 500.0},
    "no samples": {"wrench": WRENCH[:0], "fs": 500.0},
    "a number only": {"fs": 500.0},
    "two arrays of samples": {"left": WRENCH, "right": WRENCH * 2, "data": WRENCH * 3, "fs": 500.0},
    "no rate": {"wrench": WRENCH},
    "rate of zero": {"wrench": WRENCH, "fs": 0.0},
    "negative rate": {"wrench": WRENCH, "fs": -500.0},
    "rate that is NaN": {"wrench": WRENCH, "fs": np.nan},
    "rate that is infinite": {"wrench": WRENCH, "fs": np.inf},
    "three rates": {"wrench": WRENCH, "fs": np.array([1.0, 2.0, 3.0])},
    "rate that does not fit": {**TREE, "fs": 7.0},
    "time of another length": {"wrench": WRENCH, "time": TIMES[:-1]},
    "trigger beyond the end": {"wrench": WRENCH, "fs": 500.0, "trigger_index": 4000.0},
    "trigger before the start": {"wrench": WRENCH, "fs": 500.0, "trigger_index": -7.0},
    **{what: {"wrench": WRENCH, "time": stamps} for what, stamps in CLOCKS.items()},
}
"""Named arrays, for every format that holds such."""

CUBE = np.stack([WRENCH, WRENCH * 2, WRENCH * 3])
CUBES: dict[str, dict[str, object]] = {
    "too few labels": {"X": CUBE, "y": np.array([1.0, 2.0]), "fs": 500.0},
    "too many labels": {"X": CUBE, "y": np.array([1.0, 2.0, 3.0, 4.0]), "fs": 500.0},
    "labels that are NaN": {"X": CUBE, "y": np.array([1.0, np.nan, 3.0]), "fs": 500.0},
    "NaN in the second": {"X": np.stack([WRENCH, _with(np.nan)]), "fs": 500.0},
    "four axes of the array": {"X": CUBE[None], "fs": 500.0},
    "no axis of six": {"X": CUBE[..., :4], "fs": 500.0},
}
"""As above, with arrays of three dimensions, which version 4 of MATLAB's files has not."""

TREE_WRITERS = {
    "npz of others": good.write_npz,
    "mat v4": partial(good.write_mat, version="4"),
    "mat v5": partial(good.write_mat, packed=False),
    "mat v7": good.write_mat,
    "mat v7.3": good.write_mat73,
    "hdf5 of others": good.write_hdf5,
}

TEXT = np.full(N_SAMPLES, "1.0")
TABLES: dict[str, dict[str, object]] = {
    "NaN among the samples": {**TABLE, "fz": _with(np.nan)[:, 2]},
    "infinity among the samples": {**TABLE, "fz": _with(np.inf)[:, 2]},
    "a column is missing": {name: TABLE[name] for name in list(TABLE)[:-1]},
    "a column of text": {**TABLE, "fy": TEXT.tolist()},
    "two columns of an axis": {**TABLE, "Mz": WRENCH[:, 5], "mz": WRENCH[:, 5]},
    "an empty cell": {**TABLE, "fy": [None, *WRENCH[1:, 1].tolist()]},
    "lists in cells": {**TABLE, "fy": [[1.0, 2.0]] * N_SAMPLES},
    "no rows": {name: column[:0] for name, column in TABLE.items()},
    "no rate": {name: column for name, column in TABLE.items() if name != "time"},
    "two labels in a recording": {**TABLE, "label": ["rice", "peas"] * (N_SAMPLES // 2)},
    "flags that do not exist": {**TABLE, "flags": np.full(N_SAMPLES, 4096)},
    "volts": {("fx_V" if name == "fx" else name): column for name, column in TABLE.items()},
    **{what: {**TABLE, "time": stamps} for what, stamps in CLOCKS.items()},
}
"""Named columns, for foreign Parquet files; CSV has a corpus of its own."""

BAG_STAMPS = {
    "stamps are repeated": [even_stamps(N_SAMPLES)[i // 2] for i in range(N_SAMPLES)],
    "time runs backwards": [*even_stamps(N_SAMPLES)[:20], *even_stamps(N_SAMPLES)[10:30]],
}
BAG_KINDS = {
    "ros1": "bag1 LZ4",
    "ros2": "bag2 sqlite MESSAGE v9",
    "ros2 mcap": "bag2 mcap FILE v9",
    "mcap": "mcap ZSTD",
}


def content_cases() -> Iterator[tuple[str, BadCase]]:
    """Yield files that are whole, with contents that cannot be recordings."""
    for kind, write in TREE_WRITERS.items():
        for what, tree in {**TREES, **({} if kind == "mat v4" else CUBES)}.items():
            yield f"{kind}: {what}", BadCase(kind, partial(_written, kind, write, tree))
    for what, table in TABLES.items():
        yield f"parquet: {what}", BadCase("parquet", partial(_written, "parquet", good.write_parquet, table))
    for kind, bag in BAG_KINDS.items():
        for what, stamps in BAG_STAMPS.items():
            yield f"{kind}: {what}", BadCase(kind, partial(_bag, bag, WRENCH, stamps))
        for value in (np.nan, np.inf):
            yield (
                f"{kind}: {value} among the samples",
                BadCase(kind, partial(_bag, bag, _with(value), even_stamps(N_SAMPLES))),
            )
        yield (
            f"{kind}: no such topic",
            BadCase(
                kind,
                partial(_bag, bag, WRENCH, even_stamps(N_SAMPLES)),
                whole=True,
                options={"topic": "/other"},
            ),
        )
    for what, rows in GM10_ROWS.items():
        yield f"gm10: {what}", BadCase("gm10", partial(_text, rows))


def _written(kind: str, write: object, content: dict[str, object], folder: Path) -> Path:
    write(bad_path(kind, folder), content)
    return bad_path(kind, folder)


def _bag(bag: str, wrench: np.ndarray, stamps: list[int], folder: Path) -> Path:
    if folder.name == "set":
        (folder := folder / "rice").mkdir(exist_ok=True)
    return write_kind(bag, folder, wrench, stamps)


def _row(*cells: object) -> str:
    return ",".join(map(str, cells)) + "\n"


FIRST = [0, *TIMES, *WRENCH[:, 0]]
GM10_ROWS = {
    "a row too short": _row(*FIRST) + _row(1, 2, 3),
    "times that run back": _row(*FIRST) + _row(1, *TIMES[::-1], *WRENCH[:, 0]),
    "times that are repeated": _row(*FIRST) + _row(1, *REPEATED, *WRENCH[:, 0]),
    "an id with a fraction": _row(*FIRST) + _row(1.5, *TIMES, *WRENCH[:, 0]),
    "an id below zero": _row(*FIRST) + _row(-1, *TIMES, *WRENCH[:, 0]),
    "with and without settings": _row(*FIRST) + _row(0, 1, 2, 3, *TIMES, *WRENCH[:, 0]),
    "text among the numbers": _row(*FIRST) + _row(1, *TIMES, "force", *WRENCH[1:, 0]),
    "nan among the numbers": _row(*FIRST) + _row(1, *TIMES, "nan", *WRENCH[1:, 0]),
    "1e999": _row(*FIRST) + _row(1, *TIMES, "1e999", *WRENCH[1:, 0]),
    "an empty line between": _row(*FIRST) + "\n" + _row(*FIRST),
    "an empty cell": _row(*FIRST) + _row(1, *TIMES, "", *WRENCH[1:, 0]),
    "a row of megabytes": _row(*FIRST) + "1," * (3 << 20) + "1\n",
    "millions of empty lines": _row(*FIRST) + "\n" * (7 << 20),
    "binary behind the first row": _row(*FIRST) + "\0" * 5000,
}


def _text(text: str, folder: Path) -> Path:
    path = bad_path("csv", folder)
    path.write_text(text)
    return path


DEEP = "[" * 100_000
STEP = {"step": "load", "parameters": {}, "totals": {}, "rows": [], "notes": []}
MANY = "{}," * 2_600_000 + "{}"
HISTORIES = {
    "is empty": "",
    "is cut off": '[{"step": "load"',
    "is no list": '{"step": "load"}',
    "is a number": "5",
    "lists numbers": "[1, 2]",
    "lists what is no step": '[{"a": 1}]',
    "is nested 100,000 deep": DEEP,
    "is nested 100,000 deep in objects": '{"a":' * 100_000,
    "has NaN": json.dumps([{**STEP, "parameters": {"a": float("nan")}}]),
    "has a number of 100,000 digits": "[" + "1" * 100_000 + "]",
    "has millions of empty rows": json.dumps([{**STEP, "rows": []}]).replace("[]", f"[{MANY}]", 1),
    "has millions of numbers": json.dumps([{**STEP, "rows": [{"a": [1]}]}]).replace(
        "[1]", "[" + "1," * 3_900_000 + "1]"
    ),
    "is not UTF-8": '["\xff\xfe"]',
    "is binary": "\0" * 99,
}
"""What cannot be a history of a data set, in whatever format it stands."""
