"""``Finding``: one thing worth knowing about a data set before its results are believed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from granular_id.recording._values import freeze, thaw
from granular_id.recording.one import Recording

Severity = Literal["error", "warning", "info"]

SEVERITIES: tuple[Severity, ...] = ("error", "warning", "info")
"""From worst to mildest."""

_PRINTED_NAMES = 3


@dataclass(frozen=True)
class Finding:
    """One thing worth knowing before results are believed.

    Attributes
    ----------
    severity : {"error", "warning", "info"}
        "error": an evaluation cannot run or would be wrong; "warning": it may mislead; "info": good to know.
    code : str
        Short fixed name of the check, for programs.
    message : str
        What was found, in words.
    recordings : tuple of str
        Names of the recordings concerned; empty when it is the whole set.
    indices : tuple of int
        Their places in the data set: names need not be unique.
    values : mapping
        The figures behind the message, by name, units in the names.

    Examples
    --------
    >>> from granular_id.recording import Finding
    >>> print(Finding("warning", "gaps", "1 recording has a gap of 0.4 s", ("rice_07.csv",)))
    warning: 1 recording has a gap of 0.4 s [rice_07.csv]
    """

    severity: Severity
    code: str
    message: str
    recordings: tuple[str, ...] = ()
    indices: tuple[int, ...] = ()
    values: Mapping[str, Any] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", freeze(self.values, "values"))

    def __reduce__(self) -> tuple[Any, ...]:
        # read-only mappings cannot be pickled: rebuild from plain ones
        return (Finding, tuple(thaw(v) if n == "values" else v for n, v in vars(self).items()))

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, ready for ``json.dumps``."""
        plain = {name: getattr(self, name) for name in ("severity", "code", "message")}
        return {
            **plain,
            "recordings": list(self.recordings),
            "indices": list(self.indices),
            "values": thaw(self.values),
        }

    def __str__(self) -> str:
        names = first_names(self.recordings)
        return f"{self.severity}: {self.message}" + (f" [{names}]" if names else "")


def first_names(names: Sequence[str]) -> str:
    """Return the first few names in one text.

    Examples
    --------
    >>> first_names(["a", "b", "c", "d"])
    'a, b, c, ...'
    """
    return ", ".join(names[:_PRINTED_NAMES]) + (", ..." if len(names) > _PRINTED_NAMES else "")


def found(
    severity: Severity,
    code: str,
    message: str,
    recordings: Sequence[Recording] = (),
    indices: Iterable[int] = (),
    **values: Any,
) -> Finding:
    """Make a finding about ``recordings[i] for i in indices``; about the whole set when none is given."""
    places = tuple(int(i) for i in indices)
    return Finding(severity, code, message, tuple(recordings[i].name for i in places), places, values)
