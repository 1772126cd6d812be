"""What to do with arrays that do not keep the convention: the option, or the line of Python, that reads the file."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._text import in_both
from granular_id.io.source import LoadOptions
from granular_id.recording import AXES

MOST_LISTED = 12
MOST_DEEP = 12
"""Groups in groups that are looked into."""

_LABELS = ("y", "label", "material", "target", "clas", "classe")
_PARTS = (("force", "f"), ("torque", "moment", "tau", "t", "m"))
"""Names of labels, of forces and of torques, without an s at the end: a way out that uses them is only offered."""

SIGNAL = re.compile(
    r"wrench|force|torque|filtered|arr_\d|^x$|(^|[\W_])(raw|ft|data|signals?|samples?|sensor)[\W_\d]*$",
    re.IGNORECASE,
)
"""Names of arrays that are no materials."""

_COUNTED = re.compile(r"(.*?)[\s_.-]*\d+")

BESIDE = {
    "y": ("y",),
    "rate_hz": ("fs", "rate_hz"),
    "session": ("session",),
    "name": ("name",),
    "lengths": ("lengths",),
    "axes": ("axes",),
    "units": ("units",),
    "t": ("t", "time"),
}
"""What stands beside samples, and its names, in small or large letters."""

Chain = tuple[Mapping[str, Any], ...]
"""The groups around an array, the innermost first."""


@dataclass
class Leaf:
    """An array of a file: `values[()]` gives all of it; `about` is what its attributes say."""

    values: Any
    about: dict[str, Any] = field(default_factory=dict)

    @property
    def shape(self) -> tuple[int, ...]:
        """Lengths of its dimensions."""
        return tuple(self.values.shape)

    @property
    def is_numbers(self) -> bool:
        """Whether it holds real numbers."""
        return bool(self.values.dtype.kind in "iuf")

    def read(self) -> NDArray[Any]:
        """Return its values."""
        return np.asarray(self.values[()])


@dataclass
class Found:
    """An array of a file, its name, and the groups around it; `label` is what its name says."""

    path: str
    leaf: Leaf
    chain: Chain
    label: str | None = None


@dataclass(frozen=True)
class Opening:
    """How people open a kind of file: the line, and how an array in it is written.

    `kind` is what errors call an array, `line` is formatted with the path, `item` with the parts of its name.
    """

    kind: str
    line: str
    separator: str  # between the parts of a name: "/" in f['a/b'], or "']['" in f['a']['b']
    ending: str = ""  # behind it: [()] reads an HDF5 data set
    texts: str = "numpy.ravel({})"  # labels, of the expression without the ending

    def item(self, path: str) -> str:
        """Return the expression for an array."""
        inner = re.sub(r"/?\[(\d+)\]", r"/#\1", path)
        parts = [part for part in inner.split("/") if part]
        text = "f"
        names: list[str] = []
        for part in [*parts, "#"]:
            if part.startswith("#"):
                if names:
                    text += "['" + self.separator.join(names) + "']"
                text += f"[{part[1:]}]" if len(part) > 1 else ""
                names = []
            else:
                names.append(part)
        return text + self.ending


def remedy(
    leaves: Sequence[Found],
    path: Path,
    options: LoadOptions,
    how: Opening,
    axes: Sequence[str] | None,
) -> str:
    """Return the way out, with a semicolon before it; nothing where no array may hold samples."""
    return _Remedy(leaves, path, options, how, axes).text()


class _Remedy:
    """The line that reads a file which does not keep the convention."""

    def __init__(
        self,
        leaves: Sequence[Found],
        path: Path,
        options: LoadOptions,
        how: Opening,
        axes: Sequence[str] | None,
    ) -> None:
        self._leaves, self._path, self._how = [one for one in leaves if one.leaf.is_numbers], path, how
        self._texts = [one for one in leaves if not one.leaf.is_numbers]
        self._n_axes = len(options.axes or axes or AXES)
        rate = next(
            (one for one in self._leaves if one.path.lower().rpartition("/")[2] in BESIDE["rate_hz"]), None
        )
        rate_text = "RATE" if rate is None else f"float(numpy.ravel({how.item(rate.path)})[0])"
        self._rate = rate_text if options.rate_hz is None else f"{options.rate_hz:g}"
        self._axes = "" if options.axes is None else f", axes={','.join(options.axes)!r}"

    def text(self) -> str:
        """Return the way out, with a semicolon before it; nothing where no array may hold samples."""
        n = self._n_axes
        three = [one for one in self._leaves if len(one.leaf.shape) == 3 and n in one.leaf.shape]
        two = [one for one in self._leaves if len(one.leaf.shape) == 2 and n in one.leaf.shape]
        in_order = [one for one in three if one.leaf.shape[2] == n] + [
            one for one in two if one.leaf.shape[1] == n
        ]
        labels = self._labels()
        names = [one.path.rpartition("/")[2] for one in three or two]
        signals = any(map(SIGNAL.search, names))
        if three:
            n_first, n_second, _ = three[0].leaf.shape
            wrong = n_first != labels.leaf.shape[0] if labels else n_first > n_second
            if wrong or three[0] not in in_order:
                return self._turned(three[0], labels)
        if labels is None and not signals and 1 < len(three) <= MOST_LISTED:
            return self._listed(three)
        depths = {one.path.count("/") for one in two}
        by_name = depths == {1} or (len(depths) == 1 and not signals and (depths != {0} or not in_order))
        if by_name and labels is None and not three and 1 < len(two) <= MOST_LISTED:
            return self._listed(two)
        if in_order:
            chosen_from = list(dict.fromkeys(one.path.rpartition("/")[2] for one in in_order))
            beside = {} if labels is None else {"label": f"column:{labels.path.rpartition('/')[2]}"}
            chosen = (in_both(array=name, **beside) for name in chosen_from[:MOST_LISTED])
            return f"; pass {' or '.join(chosen)}"
        if two:
            return self._in_python(f"[{self._how.item(two[0].path)}.T]", None)
        return self._of_parts() or self._flat(labels) or self._by_hand()

    def _listed(self, arrays: Sequence[Found]) -> str:
        """List arrays with what their groups, or their names, may say of them."""
        items: list[str] = []
        labels: list[str] = []
        for one in arrays:
            *groups, name = re.sub(r"\[\d+\]", "", one.path).split("/")
            n = one.leaf.shape[0] if len(one.leaf.shape) == 3 else 1
            turned = ".T" if one.leaf.shape[-1] != self._n_axes else ""
            items.append("*" * (len(one.leaf.shape) == 3) + self._how.item(one.path) + turned)
            label = f"[{(groups[-1] if groups else without_number(name))!r}]"
            labels.append(label if n == 1 else f"{label} * {n}")
        y = " + ".join(labels)
        call = f"Dataset.from_arrays([{', '.join(items)}], {y}, rate_hz={self._rate}{self._axes})"
        return f"{self._open(call)}, if these are the labels"

    def _labels(self) -> Found | None:
        found = [
            one
            for one in self._texts
            if one.path.rpartition("/")[2].lower() not in ("axes", "units", "session", "name")
        ]
        numbers = [one for one in self._leaves if one.path.lower().rstrip("s") in _LABELS]
        return next(iter([*found, *numbers]), None)

    def _turned(self, one: Found, labels: Found | None) -> str:
        """Bring recordings first and axes last: recordings are as many as labels, else the shorter of the two."""
        shape, n = one.leaf.shape, self._n_axes
        last = max(i for i in range(3) if shape[i] == n)
        rest = [i for i in range(3) if i != last]
        n_labels = None if labels is None else max(labels.leaf.shape, default=1)
        first = next((i for i in rest if shape[i] == n_labels), min(rest, key=lambda i: shape[i]))
        (middle,) = (i for i in rest if i != first)
        y = labels if labels is not None and n_labels == shape[first] else None
        return self._in_python(f"{self._how.item(one.path)}.transpose({first}, {middle}, {last})", y)

    def _of_parts(self) -> str:
        """Join vectors, or forces and torques, that lie beside each other."""
        vectors = {
            one.path.rpartition("/")[2].lower(): one
            for one in self._leaves
            if max(one.leaf.shape, default=0) == np.prod(one.leaf.shape)
        }
        if set(AXES) <= set(vectors):
            columns = ", ".join(f"{axis!r}: {self._how.item(vectors[axis].path)}.ravel()" for axis in AXES)
            return self._open(f"Dataset.from_frames({{{columns}}}, rate_hz={self._rate})")
        thirds = [one for one in self._leaves if len(one.leaf.shape) in (2, 3) and one.leaf.shape[-1] == 3]
        force, torque = (
            next((one for one in thirds if one.path.lower().rpartition("/")[2].rstrip("s") in names), None)
            for names in _PARTS
        )
        if force is None or torque is None or force.leaf.shape != torque.leaf.shape:
            return ""
        both = f"numpy.concatenate([{self._how.item(force.path)}, {self._how.item(torque.path)}], axis=-1)"
        labels = self._labels()
        return self._in_python(
            both if len(force.leaf.shape) == 3 else f"[{both}]",
            labels if len(force.leaf.shape) == 3 else None,
        )

    def _flat(self, labels: Found | None) -> str:
        """Unfold recordings that lie flat in rows."""
        flat = [
            one
            for one in self._leaves
            if len(one.leaf.shape) == 2
            and one.leaf.shape[1] % self._n_axes == 0
            and one.leaf.shape[1] > self._n_axes
        ]
        if not flat:
            return ""
        (n, width), item = flat[0].leaf.shape, self._how.item(flat[0].path)
        samples = width // self._n_axes
        first = self._in_python(f"{item}.reshape({n}, {samples}, {self._n_axes})", labels)
        other = f"{item}.reshape({n}, {self._n_axes}, {samples}).transpose(0, 2, 1)"
        return f"{first} where the axes of each sample lie together, or {other} where the samples of each axis do"

    def _by_hand(self) -> str:
        if not any(len(one.leaf.shape) > 1 for one in self._leaves):
            return ""
        if any(one.leaf.shape[-1:] == (len(AXES) + 1,) for one in self._leaves):
            both = in_both(axes=f"time,{','.join(AXES)}")
            return f"; if the first column is the time, pass {both}, else a name for each column"
        convention = "samples of a wrench are X (recordings, samples, 6)"
        return f"; {convention}; of another sensor pass axes= with a name a column (--axes NAMES)"

    def _in_python(self, X: str, labels: Found | None) -> str:
        y = ""
        if labels is not None and labels.leaf.shape:
            item = self._how.item(labels.path)
            is_text = not labels.leaf.is_numbers
            y = ", " + (
                self._how.texts.format(item.removesuffix(self._how.ending))
                if is_text
                else f"numpy.ravel({item})"
            )
        return self._open(f"Dataset.from_arrays({X}{y}, rate_hz={self._rate}{self._axes})")

    def _open(self, call: str) -> str:
        return f"; in Python: f = {self._how.line.format(str(self._path))}; {call}"


def without_number(name: str) -> str:
    """Return a name without the number at its end."""
    found = _COUNTED.fullmatch(name)
    return name if found is None or not found[1] else found[1]
