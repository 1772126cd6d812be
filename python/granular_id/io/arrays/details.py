"""What stands beside recordings in a file, put onto each: labels, sessions, rates, stamps, flags, metadata."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import FloatArray
from granular_id.io.arrays.found import Found, labels_of, whole_numbers
from granular_id.io.arrays.names import Role, plain_name
from granular_id.io.arrays.stated import Units, single_unit, time_unit_in_name
from granular_id.io.arrays.tree import Origin, contents, is_leaf, is_numbers, n_values, numbers, texts, values
from granular_id.io.columns import TIME, factor, split_unit
from granular_id.io.flat import NO_TRIGGER
from granular_id.io.options import LoadOptions
from granular_id.io.stamped import NOT_SECONDS, RATE_TOLERANCE, unlikely_step

Entries = dict[Role, dict[str, Any]]
"""What the entries of a level are for, by their names: role, then name to node."""

_LONGEST_TEXT = 1000
"""Characters of a text that is kept in ``meta``."""

_TELLS_APART = (
    *("trial", "trials", "trialid", "run", "runs", "runid", "recordingid", "push", "pushid", "segment"),
    *("episode", "episodes", "episodeid", "episodeindex"),
)
"""Names of what tells, sample by sample, which recording a sample belongs to."""


def add_details(
    found: Found,
    entries: Entries,
    rest: Mapping[str, Any],
    origin: Origin,
    notes: list[str],
    units: Units,
    options: LoadOptions,
) -> None:
    """Put onto recordings what their level of the file says, where no inner level said it already.

    `entries` are known by name; of `rest`, single values go into ``meta``, and what is not used is said.
    """
    n = len(found)
    if not n:
        return
    _refuse_codes(found, entries, origin)
    lists: tuple[Role, ...] = ("lengths", "mask")
    for role in lists:
        for name, node in entries.get(role, {}).items():
            if not _cut(found, role, name, node, origin, notes):
                rest = {**rest, name: node}
    n = len(found)
    _add_labels(found, entries, origin, notes)
    for role, (attribute, read) in _READERS.items():
        for name, node in entries.get(role, {}).items():
            if n_values(node) == 1 and n > 1 and role in _NEVER_SHARED:
                rest = {**rest, name: node}  # it is about the file
            else:
                found.fill(attribute, _spread(read(node, name, origin), n, name, origin))
    rates = stated_rates(entries, n, units, origin, options)
    if rates is not None:
        found.fill("rate", rates)
    _add_stamps(found, entries.get("time", {}), units, origin)
    for name, node in entries.get("flags", {}).items():
        found.fill("flags", _rows(node, found, name, origin))
    _add_meta(found, rest, origin, notes)


def _refuse_codes(found: Found, entries: Entries, origin: Origin) -> None:
    """Refuse samples that are stated to be counts, or to hold a value that stands for none."""
    for name, node in entries.get("scaling", {}).items():
        single = _single(node)
        if single not in ((0, "0") if plain_name(name).endswith("offset") else (1, "1")):
            raise origin.fault(
                name, f"is {single}: samples are counts; save them in N and N m, and leave it out"
            )
    for name, node in entries.get("fill", {}).items():
        single = _single(node)
        if isinstance(single, (int, float)) and any((wrench == single).any() for wrench in found.wrench):
            raise origin.fault(name, f"is {single:g}, which stands among the samples: leave those out first")


# -- padding


def _cut(found: Found, role: Role, name: str, node: Any, origin: Origin, notes: list[str]) -> bool:
    """Leave out what is stated to be no samples; False where an entry is not about that."""
    n, n_padded = len(found), found.n_padded
    if role == "mask":
        if n_values(node) == 1:
            return False
        lengths = _masked(found, name, node, origin)
    else:
        listed = numbers(node)
        if listed is None or (len(listed) == 1 and (listed != np.floor(listed)).any()):
            return False  # the length of something else, in mm
        lengths = whole_numbers(node, name, origin)
        if len(lengths) == 1:
            recordings = n > 1 and lengths == [n] and n not in n_padded
            lengths *= n
            if recordings or not all(map(_is_padded, found.wrench, lengths)):
                return False  # how many recordings, or a total
        if len(lengths) > 1 and n == 1 and sum(lengths) == n_padded[0] and min(lengths) > 0:
            found.split(lengths)
            each = f"{len(lengths)} recordings one behind the other, of the lengths in {name}"
            notes.append(f"{found.places[0]}: {each}")
            return True
    if len(lengths) != n:
        raise origin.fault(name, f"has {len(lengths)} values for {n} recordings; wanted one for each")
    for i, (wrench, length) in enumerate(zip(found.wrench, lengths, strict=True)):
        gives = f"gives recording {i} {length} samples"
        if not 0 < length <= len(wrench):
            raise origin.fault(name, f"{gives}; wanted 1 to {len(wrench)}, which are there")
        if not _is_padded(wrench, length):
            wanted = "wanted padding: zeros, NaN, or one value again and again"
            raise origin.fault(name, f"{gives} of {len(wrench)}, but the values behind change; {wanted}")
    if lengths != found.lengths:
        notes.append(f"recordings cut to the samples that {name} states")
        found.cut(lengths)
    return True


def _is_padded(wrench: FloatArray, length: int) -> bool:
    """Tell whether there are so many samples, and behind them one value again and again."""
    return 0 < length <= len(wrench) and not (wrench[length:] != wrench[-1]).any()


def _masked(found: Found, name: str, node: Any, origin: Origin) -> list[int]:
    """Return how many samples of each recording a mask marks."""
    rows = _rows(values(node).astype(np.uint8) if is_leaf(node) else node, found, name, origin)
    kept = [(row == 0) if "pad" in name.lower() else (row != 0) for row in rows]
    if any((np.diff(row.astype(np.int8)) > 0).any() for row in kept):
        problem = "marks samples behind others that are none"
        raise origin.fault(name, f"{problem}; wanted those of a recording, and then its padding")
    return [int(row.sum()) for row in kept]


# -- clocks


def stated_rates(
    entries: Entries, n: int, units: Units, origin: Origin, options: LoadOptions
) -> list[float] | None:
    """Return the rate of each recording as one level states it: in Hz, or as a step in seconds."""
    said = {
        name: _spread(_in_hz(node, name, "Hz", single_unit(units.get("rate")), origin), n, name, origin)
        for name, node in entries.get("rate", {}).items()
    }
    for name, node in entries.get("step", {}).items():
        stated = single_unit(units.get("step")) or time_unit_in_name(name) or options.time_unit
        said[name] = _spread(_in_hz(node, name, "s", stated, origin), n, name, origin)
    if not said:
        return None
    first = next(iter(said))
    for name, rates in said.items():
        for rate, other in zip(said[first], rates, strict=True):
            if abs(rate - other) > RATE_TOLERANCE * rate:
                problem = f"{first} states a rate of {rate:g} Hz, {name} one of {other:g} Hz"
                raise origin.unclear(f"{problem}; save the one that is true")
    return said[first]


def _in_hz(node: Any, name: str, quantity: str, stated: str | None, origin: Origin) -> list[float]:
    """Return rates, or what are steps in seconds, in Hz."""
    found = numbers(node)
    if found is None or not len(found) or not (found > 0).all():
        wanted = "sampling rate" if quantity == "Hz" else "time between samples"
        per = f"wanted a number above 0 ({quantity}), or one per recording"
        raise origin.fault(name, f"is no {wanted}; {per}")
    in_name = split_unit(name.rpartition("/")[2])[1] or ""
    unit = stated or (in_name if factor(in_name, quantity) else quantity)
    scale = factor(unit, quantity)
    if scale is None:
        raise origin.fault(name, f"is in {unit!r:.40}; wanted {quantity}")
    scaled = found.astype(np.float64) * scale
    if quantity == "Hz":
        return [float(rate) for rate in scaled]
    problem = unlikely_step(float(scaled.max())) if stated is None else None
    if problem:
        raise origin.fault(name, f"states a step of {scaled.max():g}: {problem}")
    with np.errstate(divide="ignore", over="ignore"):
        return [float(f"{rate:.12g}") for rate in 1 / scaled]  # 0.002 s are 500 Hz


def _add_stamps(found: Found, clocks: Mapping[str, Any], units: Units, origin: Origin) -> None:
    """Put down the stamps that a level has, with their unit where that is stated."""
    first: tuple[str, list[NDArray[Any]]] | None = None
    for name, node in clocks.items():
        rows = _rows(node, found, name, origin)
        unit = single_unit(units.get(TIME)) or time_unit_in_name(name)
        scale = factor(unit or "s", "s") or math.nan
        with np.errstate(over="ignore", invalid="ignore"):
            scaled = [(row.astype(np.float64) - float(row[0])) * scale for row in rows]
        if first is None:
            first = name, scaled
            found.fill("stamps", rows)
            found.fill("time_unit", [unit] * len(found))
        elif any(
            not np.allclose(one, other, rtol=RATE_TOLERANCE, atol=RATE_TOLERANCE * one[-1] / len(one))
            for one, other in zip(first[1], scaled, strict=True)
        ):
            problem = f"{first[0]} and {name} are two clocks that do not agree"
            raise origin.unclear(f"{problem}; save the one that is true")


# -- one value per recording


def _add_labels(found: Found, entries: Entries, origin: Origin, notes: list[str]) -> None:
    lists = {**entries.get("labels", {}), **entries.get("class_names", {})}
    n, sizes = len(found), found.sizes
    if not lists or None not in found.get("label"):
        return
    lengths = {n_values(node) for node in lists.values()}
    if len(sizes) > 1 and len(sizes) in lengths and n not in lengths:  # one for each array or cell
        each = zip(labels_of(lists, len(sizes), origin, notes), sizes, strict=True)
        found.fill("label", [label for label, size in each for _ in range(size)])
        return
    if lengths == {1}:  # one label for all, as in a file per material
        lists = {name: node if n == 1 else [node] * n for name, node in lists.items()}
    found.fill("label", labels_of(lists, n, origin, notes))


def _spread(column: list[Any], n: int, name: str, origin: Origin) -> list[Any]:
    if len(column) not in (1, n):
        problem = f"has {len(column)} values for {n} recordings; wanted one per recording, or one for all"
        raise origin.fault(name, problem)
    return column if len(column) == n else column * n


def _words(node: Any, name: str, origin: Origin) -> list[Any]:
    words = texts(node)
    if words is None:
        words = [str(number) for number in whole_numbers(node, name, origin)]
    return [word or None for word in words]


def _start_times(node: Any, name: str, origin: Origin) -> list[Any]:
    array = numbers(node)
    if array is None:
        raise origin.fault(name, "does not hold numbers; wanted seconds since 1970 per recording")
    late = next((value for value in array.tolist() if abs(value) > NOT_SECONDS), None)
    if late is not None:
        raise origin.fault(name, f"is {late:.6g}, in milliseconds or less; wanted seconds since 1970")
    return [None if math.isnan(value) else float(value) for value in array.tolist()]


def _triggers(node: Any, name: str, origin: Origin) -> list[Any]:
    return [None if index == NO_TRIGGER else index for index in whole_numbers(node, name, origin)]


_READERS: dict[Role, tuple[str, Callable[[Any, str, Origin], list[Any]]]] = {
    "sessions": ("session", _words),
    "names": ("name", _words),
    "start": ("start", _start_times),
    "trigger": ("trigger", _triggers),
}

_NEVER_SHARED: tuple[Role, ...] = ("names", "start")
"""What two recordings do not have in common."""


def _rows(node: Any, found: Found, name: str, origin: Origin) -> list[NDArray[Any]]:
    """Return a list of values per recording: one for all, the rows or columns of a matrix, or a cell for each."""
    n = len(found)
    if isinstance(node, list):
        rows = [cell for item in node if (cell := numbers(item)) is not None]
        if not len(rows) == len(node) == n:
            raise origin.fault(name, f"holds {len(node)} lists for {n} recordings; wanted numbers for each")
    elif not is_numbers(node):
        raise origin.fault(name, "does not hold numbers")
    elif n_values(node) is not None:
        rows = [values(node).reshape(-1)] * n
        if n > 1 and found.sizes == [n] and len(rows[0]) == sum(found.n_padded):  # one behind the other
            rows = np.split(rows[0], np.cumsum(found.n_padded)[:-1])
    else:
        matrix = values(node)
        if matrix.ndim == 2 and matrix.shape[0] != n and matrix.shape[1] == n:
            matrix = matrix.T
        if matrix.ndim != 2 or len(matrix) != n:
            problem = f"has the shape {matrix.shape} for {n} recordings; wanted a row for each"
            raise origin.fault(name, problem)
        rows = list(matrix)
    lengths = found.lengths
    for i, (row, n_samples) in enumerate(zip(rows, lengths, strict=True)):
        if len(row) not in (n_samples, found.n_padded[i]):
            where = f"the {n_samples} samples of recording {i} in {found.places[i]}"
            raise origin.fault(name, f"has {len(row)} values for {where}")
    return [row[:n_samples] for row, n_samples in zip(rows, lengths, strict=True)]


# -- everything else


def _add_meta(found: Found, rest: Mapping[str, Any], origin: Origin, notes: list[str]) -> None:
    single = {name: _single(node) for name, node in rest.items()}
    kept = {name: value for name, value in single.items() if value is not None}
    unread = {name: node for name, node in rest.items() if single[name] is None}
    if kept:
        shared = {name.rpartition("/")[2]: kept[name] for name in kept}
        found.about["meta"] = [{**shared, **inner} if inner else shared for inner in found.get("meta")]
        notes.append(f"kept in meta: {', '.join(kept)}")
    if unread:
        notes.append(f"not used: {contents(unread)}")
    for name, node in unread.items():
        if len(found) == 1 and plain_name(name.rpartition("/")[2]) in _TELLS_APART:
            _refuse_several(name, node, found.lengths[0], origin)
        if len(texts(node) or ()) == len(found) > 1 and not any(found.get("label")):
            notes.append(f"{name} holds a text per recording: if it names the materials, save it as labels")


def _refuse_several(name: str, node: Any, n_samples: int, origin: Origin) -> None:
    """Refuse an array of several recordings in a row that another array tells apart, sample by sample."""
    if is_leaf(node) and n_values(node) == n_samples and len(set(values(node).reshape(-1).tolist())) > 1:
        problem = f"{name} tells recordings apart sample by sample"
        raise origin.unclear(f"{problem}; save an array for each, or their lengths beside the samples")


def _single(node: Any) -> str | float | int | None:
    if isinstance(node, str):
        return node if len(node) <= _LONGEST_TEXT else None
    if not is_leaf(node) or math.prod(node.shape) != 1 or np.dtype(node.dtype).kind not in "iufU":
        return None
    value = values(node).reshape(-1)[0].item()
    if isinstance(value, str):
        return _single(value)
    return value if math.isfinite(value) else None
