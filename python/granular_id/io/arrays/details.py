"""What stands beside recordings in a file, put onto each: labels, sessions, rates, stamps, flags, metadata."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import FloatArray
from granular_id.io.arrays.found import Found, Push, labels_of, whole_numbers
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
    units: Units,
    origin: Origin,
    options: LoadOptions,
) -> None:
    """Put onto recordings what their level of the file says, where no inner level said it already.

    `entries` are known by name; of `rest`, single values go into ``meta``, and what is not used is said.
    """
    if not len(found):
        return
    _refuse_codes(found, entries, origin)
    about_file = {  # by its name it is about recordings, but by its values it is not
        name: node
        for role, cut in _CUTS.items()
        for name, node in entries.get(role, {}).items()
        if not cut(found, name, node, origin)
    }
    _add_labels(found, entries, origin)
    n = len(found)
    for role, (attribute, read) in _READERS.items():
        for name, node in entries.get(role, {}).items():
            if n_values(node) == 1 and n > 1 and role in ("names", "start"):  # no two have it in common
                about_file[name] = node
            else:
                found.fill(attribute, _spread(read(node, name, origin), n, name, origin))
    found.fill("rate", stated_rates(entries, n, units, origin, options) or [None] * n)
    _add_stamps(found, entries.get("time", {}), units, origin)
    for name, node in entries.get("flags", {}).items():
        found.fill("flags", _rows(node, found, name, origin))
    _add_meta(found, {**rest, **about_file}, origin)


def _refuse_codes(found: Found, entries: Entries, origin: Origin) -> None:
    """Refuse samples that are stated to be counts, or to hold a value that stands for none."""
    for name, node in entries.get("scaling", {}).items():
        single = _single(node)
        if single not in ((0, "0") if plain_name(name).endswith("offset") else (1, "1")):
            problem = f"is {single}: samples are counts; save them in N and N m, and leave it out"
            raise origin.fault(name, problem)
    for name, node in entries.get("fill", {}).items():
        single = _single(node)
        if isinstance(single, (int, float)) and any((push.wrench == single).any() for push in found.pushes):
            raise origin.fault(name, f"is {single:g}, which stands among the samples: leave those out first")


# -- padding


def _cut_to_lengths(found: Found, name: str, node: Any, origin: Origin) -> bool:
    """Keep so many samples of each, or cut apart what lies in a row; False for the length of something else."""
    listed = numbers(node)
    if listed is None or (len(listed) == 1 and (listed != np.floor(listed)).any()):
        return False  # in mm
    lengths, n = whole_numbers(node, name, origin), len(found)
    padded = [push.n_padded for push in found.pushes]
    if len(lengths) == 1:
        counts_recordings = n > 1 and lengths == [n] and n not in padded
        lengths *= n
        if counts_recordings or not all(map(_is_padded, found.pushes, lengths)):
            return False  # or a total
    elif [sum(lengths)] == padded and min(lengths) > 0:
        (whole,) = found.pushes
        ends = np.cumsum(lengths).tolist()
        found.pushes = [whole.cut(end - length, end) for end, length in zip(ends, lengths, strict=True)]
        found.sizes = [len(lengths)]
        each = f"{len(lengths)} recordings one behind the other, of the lengths in {name}"
        origin.note(f"{whole.place}: {each}")
        return True
    _cut(found, lengths, name, origin)
    return True


def _cut_to_mask(found: Found, name: str, node: Any, origin: Origin) -> bool:
    """Keep the samples that a mask marks; False for a single value."""
    if n_values(node) == 1:
        return False
    rows = _rows(values(node).astype(np.uint8) if is_leaf(node) else node, found, name, origin)
    kept = [(row == 0) if "pad" in name.lower() else (row != 0) for row in rows]
    if any((np.diff(row.astype(np.int8)) > 0).any() for row in kept):
        problem = "marks samples behind others that are none"
        raise origin.fault(name, f"{problem}; wanted those of a recording, and then its padding")
    _cut(found, [int(row.sum()) for row in kept], name, origin)
    return True


def _cut(found: Found, lengths: list[int], name: str, origin: Origin) -> None:
    if len(lengths) != len(found):
        problem = f"has {len(lengths)} values for {len(found)} recordings; wanted one for each"
        raise origin.fault(name, problem)
    for i, (push, length) in enumerate(zip(found.pushes, lengths, strict=True)):
        if not _is_padded(push, length):
            wanted = "wanted at least one, and behind them padding: zeros, NaN, or one value again and again"
            raise origin.fault(name, f"gives recording {i} {length} samples of {len(push.wrench)}; {wanted}")
    if lengths != [len(push.wrench) for push in found.pushes]:
        origin.note(f"recordings cut to the samples that {name} states")
        for push, length in zip(found.pushes, lengths, strict=True):
            cut = push.cut(0, length)
            push.wrench, push.about = cut.wrench, cut.about


def _is_padded(push: Push, length: int) -> bool:
    """Tell whether there are so many samples, and behind them one value again and again."""
    wrench = push.wrench
    return 0 < length <= len(wrench) and not (wrench[length:] != wrench[-1]).any()


_CUTS: dict[Role, Callable[[Found, str, Any, Origin], bool]] = {
    "lengths": _cut_to_lengths,
    "mask": _cut_to_mask,
}


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
    """Put down the stamps that a level has, with their unit where that is stated; two clocks must agree."""
    first: tuple[str, list[FloatArray]] | None = None
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


def _add_labels(found: Found, entries: Entries, origin: Origin) -> None:
    lists = {**entries.get("labels", {}), **entries.get("class_names", {})}
    n, sizes = len(found), found.sizes
    if not lists or None not in found.get("label"):
        return
    lengths = {n_values(node) for node in lists.values()}
    if len(sizes) > 1 and len(sizes) in lengths and n not in lengths:  # one for each array or cell
        each = zip(labels_of(lists, len(sizes), origin), sizes, strict=True)
        found.fill("label", [label for label, size in each for _ in range(size)])
        return
    if lengths == {1}:  # one label for all, as in a file per material
        lists = {name: node if n == 1 else [node] * n for name, node in lists.items()}
    found.fill("label", labels_of(lists, n, origin))


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


def _rows(node: Any, found: Found, name: str, origin: Origin) -> list[NDArray[Any]]:
    """Return a list of values per recording: one for all, the rows or columns of a matrix, or a cell for each."""
    n, padded = len(found), [push.n_padded for push in found.pushes]
    if isinstance(node, list):
        rows = [cell for item in node if (cell := numbers(item)) is not None]
        if not len(rows) == len(node) == n:
            raise origin.fault(name, f"holds {len(node)} lists for {n} recordings; wanted numbers for each")
    elif not is_numbers(node):
        raise origin.fault(name, "does not hold numbers")
    elif n_values(node) is not None:
        rows = [values(node).reshape(-1)] * n
        if n > 1 and found.sizes == [n] and len(rows[0]) == sum(padded):  # one behind the other
            rows = np.split(rows[0], np.cumsum(padded)[:-1])
    else:
        matrix = values(node)
        if matrix.ndim == 2 and matrix.shape[0] != n and matrix.shape[1] == n:
            matrix = matrix.T
        if matrix.ndim != 2 or len(matrix) != n:
            problem = f"has the shape {matrix.shape} for {n} recordings; wanted a row for each"
            raise origin.fault(name, problem)
        rows = list(matrix)
    for i, (row, push) in enumerate(zip(rows, found.pushes, strict=True)):
        if len(row) not in (len(push.wrench), push.n_padded):
            where = f"the {len(push.wrench)} samples of recording {i} in {push.place}"
            raise origin.fault(name, f"has {len(row)} values for {where}")
    return [row[: len(push.wrench)] for row, push in zip(rows, found.pushes, strict=True)]


# -- everything else


def _add_meta(found: Found, rest: Mapping[str, Any], origin: Origin) -> None:
    single = {name: _single(node) for name, node in rest.items()}
    kept = {name: value for name, value in single.items() if value is not None}
    unread = {name: node for name, node in rest.items() if single[name] is None}
    if kept:
        shared = {name.rpartition("/")[2]: value for name, value in kept.items()}
        for push in found.pushes:
            push.about["meta"] = {**shared, **push.about.get("meta", {})}
        origin.note(f"kept in meta: {', '.join(kept)}")
    if unread:
        origin.note(f"not used: {contents(unread)}")
    for name, node in unread.items():
        if len(found) == 1 and plain_name(name.rpartition("/")[2]) in _TELLS_APART:
            _refuse_several(name, node, len(found.pushes[0].wrench), origin)
        if len(texts(node) or ()) == len(found) > 1 and not any(found.get("label")):
            origin.note(f"{name} holds a text per recording: if it names the materials, save it as labels")


def _refuse_several(name: str, node: Any, n_samples: int, origin: Origin) -> None:
    """Refuse an array of several recordings in a row that another array tells apart, sample by sample."""
    if is_leaf(node) and n_values(node) == n_samples and len(set(values(node).reshape(-1).tolist())) > 1:
        problem = f"{name} tells recordings apart sample by sample"
        raise origin.unclear(f"{problem}; save an array for each, or their lengths beside the samples")


def _single(node: Any) -> str | float | int | None:
    """Return a single text or number; None for what is none, or too long, or not finite."""
    if is_leaf(node) and math.prod(node.shape) == 1 and np.dtype(node.dtype).kind in "iufU":
        node = values(node).reshape(-1)[0].item()
    if isinstance(node, str):
        return node if len(node) <= _LONGEST_TEXT else None
    return node if isinstance(node, (int, float)) and math.isfinite(node) else None
