"""Ways out of refusals, followed as they are printed: options of `load`, and lines of Python."""

from __future__ import annotations

import re

import pytest

from granular_id.io import RecordingFileError, load


def refusal(path, **options):
    """Return what `load` says against a file."""
    with pytest.raises(RecordingFileError) as caught:
        load(path, **options)
    return caught.value.problem


def lines_of(problem):
    """Return the ways out in Python, one for each reading that is offered."""
    first, *others = problem.partition("in Python: ")[2].split("; or ")
    begin = first.rpartition("; ")[0]
    return [
        re.sub(r", if [^()\[\]]*$", "", way) for way in (first, *(f"{begin}; {other}" for other in others))
    ]


def run(line, rate_hz=500):
    """Run one way out in a fresh Python, and return the data set that it makes."""
    scope = {}
    exec(re.sub(r"\bRATE\b", repr(rate_hz), line), scope)
    return scope["data"]


def options_of(path, rate_hz=500, **options):
    """Return the options of each way out that `load` names."""
    with pytest.raises(RecordingFileError) as caught:
        load(path, **options)
    return [
        {name: rate_hz if value == "RATE" else value for name, value in way.items()}
        for way in caught.value.ways
    ]
