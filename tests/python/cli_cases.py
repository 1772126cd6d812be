"""Small folders of recordings, and the command line run inside the test process."""

import functools
import json
import os
import re
import shlex
import subprocess
import sys

import numpy as np
import typer.main
import typer.testing

from granular_id.cli.app import app
from granular_id.io import save
from granular_id.recording import Dataset, Recording

LABELS = ("oat", "rice", "sugar")


def recording(rng, k, i, *, samples=60, jitter=0.0, label=None):
    level = np.array([1.0, -1.0, 0.5, 0.1, 0.2, -0.1]) * (k + 1)
    wrench = level * rng.normal(1, 0.4) + rng.normal(0, 0.2 * (k + 1), (samples, 6))
    steps = np.full(samples - 1, 0.008) * (1 + jitter * rng.uniform(-1, 1, samples - 1))
    time = {"time_s": np.concatenate([[0.0], np.cumsum(steps)])} if jitter else {"rate_hz": 125.0}
    label = label or LABELS[k]
    name = f"{label}/{label}_{i:02d}.csv"
    return Recording(wrench, label=label, start_time=1.6e9 + 60.0 * (10 * i + k), name=name, **time)


def make(n=10, **fields):
    rng = np.random.default_rng(1)
    return Dataset([recording(rng, k, i, **fields) for k in range(len(LABELS)) for i in range(n)])


def saved(data, folder):
    save(data, folder, "csv")
    return folder


SMALL = ("--spaces", "raw+hfmh,hfmh,raw")

SMALL_MODEL = ("--space", "raw+hfmh", "--target-error", 0.2)


# Typer makes the command anew for each call, which takes longer than most of them.
typer.testing._get_command = functools.cache(typer.main.get_command)


def run(*words, columns=200):
    return typer.testing.CliRunner().invoke(
        app, [str(word) for word in words], env={"COLUMNS": str(columns), "NO_COLOR": "1"}
    )


def started(*words, module="granular_id", code=None, **options):
    """The command line, or code in its place, as a process of its own."""
    program = ["-m", module] if code is None else ["-c", code]
    environment = {**os.environ, "PYTHONUNBUFFERED": "1", "NO_COLOR": "1", "COLUMNS": "120", "TERM": "xterm"}
    piped = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "env": environment}
    return subprocess.Popen([sys.executable, *program, *map(str, words)], **(piped | options))


def ended_well(*words, **more):
    result = run(*words, **more)
    assert result.exit_code == 0, result.output
    return result.stdout


def written(path):
    """What a command has written as JSON."""
    return json.loads(path.read_text(encoding="utf-8"))


def refused(*words):
    """The words of a refusal in one line: exit code 2, no traceback, no column beyond 80 but for a long word."""
    result = run(*words)
    assert result.exit_code == 2, result.output
    assert isinstance(result.exception, SystemExit), result.exception
    lines = result.stderr[result.stderr.index("error:") :].splitlines()
    typed = ("python -c ",)  # lines of Python are not broken
    assert all(
        len(line) <= 80 or len(line.removesuffix("\\").split()) == 1 or line.startswith(typed)
        for line in lines
    ), lines
    return " ".join(line.strip().removesuffix(" \\") for line in lines)


def way_out(line):
    """The words that a refusal ends with, as they would be typed."""
    return shlex.split(re.split(" or with | or: ", line[line.rindex("granular-id ") :])[0])[1:]
