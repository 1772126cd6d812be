"""``CheckReport``: what the checks found, worst first."""

from __future__ import annotations

import textwrap
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from granular_id._checks import freeze, thaw
from granular_id._text import counted
from granular_id.recording.report import first_names

Severity = Literal["error", "warning", "info"]

SEVERITIES: tuple[Severity, ...] = ("error", "warning", "info")  # from worst to mildest

State = Literal["ok", "warning", "error"]

WIDTH = 100  # columns of the printed table


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
    >>> from granular_id import Finding
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
        return {name: thaw(value) for name, value in vars(self).items()}

    def __str__(self) -> str:
        names = first_names(self.recordings)
        return f"{self.severity}: {self.message}" + (f" [{names}]" if names else "")


@dataclass(frozen=True)
class CheckReport(Sequence[Finding]):
    """A sequence of findings, worst first, that prints as a table.

    Attributes
    ----------
    findings : tuple of Finding
        Errors, warnings, infos; within each the order of the checks.
    n_recordings : int
        Recordings that were checked.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id import Dataset, Recording
    >>> noise = np.random.default_rng(0).normal(size=(12, 100, 6))
    >>> noise[3, :, 2] = 0
    >>> data = Dataset([Recording(noise[i], rate_hz=100, label="ab"[i % 2], session=f"{i // 6}",
    ...                           name=f"push {i}") for i in range(12)])
    >>> report = data.check()
    >>> report.worst, [finding.code for finding in report], report.states[3]
    ('warning', ['stuck-axis'], 'warning')
    >>> print(report)
    12 recordings checked: 11 ok, 1 with warnings
    <BLANKLINE>
    warning  stuck-axis  1 recording with an axis that never changes (fz)
                         [push 3]
    """

    findings: tuple[Finding, ...]
    n_recordings: int

    @property
    def states(self) -> tuple[State, ...]:
        """The worst of the findings that name each recording, in the order of the data set.

        Findings about the whole set, such as a clock that tells the label, are nobody's in particular: `worst` counts
        them.
        """
        states: list[State] = ["ok"] * self.n_recordings
        for finding in reversed(self.findings):  # the worst last
            for i in finding.indices:
                states[i] = "ok" if finding.severity == "info" else finding.severity
        return tuple(states)

    @property
    def worst(self) -> State:
        """The worst finding, "ok" when there is none but infos."""
        severities = {finding.severity for finding in self.findings}
        return "error" if "error" in severities else "warning" if "warning" in severities else "ok"

    def __getitem__(self, index: Any) -> Any:
        return self.findings[index]

    def __len__(self) -> int:
        return len(self.findings)

    def text(self, width: int = WIDTH) -> str:
        """Return the table in lines of at most `width` columns, as far as names allow."""
        states = Counter(self.states)
        parts = [f"{states['ok']} ok"]
        parts += [f"{states[state]} with {state}s" for state in ("warning", "error") if states[state]]
        headline = f"{counted(self.n_recordings)} checked: {', '.join(parts)}"
        if not self.findings:
            return f"{headline}: nothing found that would spoil an evaluation"
        lines = [headline]
        longest = max(len(finding.code) for finding in self.findings)
        indent = " " * (len("warning") + longest + 4)
        previous = None
        for finding in self.findings:
            if finding.severity != previous:
                lines.append("")
            previous = finding.severity
            start = f"{finding.severity:<7}  {finding.code:<{longest}}  "
            lines += textwrap.wrap(
                finding.message, width, initial_indent=start, subsequent_indent=indent, break_long_words=False
            )
            if 0 < len(finding.indices) < self.n_recordings:
                names = f"[{first_names(finding.recordings)}]"
                lines += textwrap.wrap(names, width, initial_indent=indent, subsequent_indent=indent)
        return "\n".join(lines)

    def __str__(self) -> str:
        return self.text()

    def to_dict(self) -> dict[str, Any]:
        """Return plain dicts, lists, texts and numbers, ready for ``json.dumps``."""
        return {
            "worst": self.worst,
            "findings": [finding.to_dict() for finding in self.findings],
            "states": list(self.states),
        }
