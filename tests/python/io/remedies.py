"""Ways out of refusals, followed as they are printed: options of `load`, and lines of Python."""

from __future__ import annotations

import ast
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
    """Run one way out in a fresh Python, and return the data set of its last expression."""
    *before, last = ast.parse(re.sub(r"\bRATE\b", repr(rate_hz), line)).body
    scope = {}
    exec(compile(ast.Module(before, []), "way out", "exec"), scope)
    return eval(compile(ast.Expression(last.value), "way out", "eval"), scope)


def options_of(problem):
    """Return the options of each way out; they are written as in Python."""
    clauses = re.split(r" or |; ", problem.partition("; in Python")[0])
    found = [dict(re.findall(r"(\w+)=(\{[^{}]*\}|'[^']*'|RATE)", clause)) for clause in clauses]
    values = [
        {name: 500 if value == "RATE" else ast.literal_eval(value) for name, value in one.items()}
        for one in found
    ]
    return [one for one in values if one]
