"""One red line instead of a traceback, in the words of the command line."""

from __future__ import annotations

import functools
import os
import re
import shlex
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import ParamSpec

import typer

from granular_id.cli.interrupts import heeding_interrupts, say

__all__ = ["DEBUG", "guarded", "in_options", "words_of"]

DEBUG = "GRANULAR_ID_DEBUG"
"""Environment variable: when set, an error ends in its traceback instead of one line."""

BAD_INPUT, MISSING_EXTRA, INTERRUPTED = 2, 1, 130

OPTIONS = {
    "rate_hz": "--rate-hz",
    "format": "--to",
    "topic": "--topic",
    "time_unit": "--time-unit",
    "array": "--array",
    "lead_s": "--lead-s",
    "rest_s": "--rest-s",
    "begin_at": "--begin-at",
    "overrule": "--onset-at",
    "sensor_range": "--sensor-range",
    "false_alarm_rate": "--false-alarm-rate",
    "max_gap_s": "--max-gap-s",
    "on_gap": "--on-gap",
    "on_short": "--on-short",
    "on_missing": "--on-short",
    "on_error": "--on-error",
    "on_time_error": "--on-time-error",
    "n_samples": "--n-samples",
    "duration_s": "--duration-s",
    "n_partitions": "--partitions",
    "train_per_class": "--train",
    "test_per_class": "--test",
    "cutoff_hz": "--cutoff-hz",
    "n_bins": "--n-bins",
    "bin_range": "--bin-range",
    "random_state": "--seed",
    "order": "--order",
    "initial": "--initial",
    "threads": "--threads",
    "spaces": "--spaces",
    "protocol": "--protocol",
    "n_folds": "--folds",
    "tare_s": "--tare-s",
    "block_weights": "--block-weights",
    "n_outer": "--outer",
    "n_inner": "--inner",
    "target_error": "--target-error",
    "coding": "--coding",
    "C": "--C",
    "space": "--space",
    "posterior": "--posterior",
    "direction": "--direction",
    "label": "--label",
    "pre_s": "--pre-s",
    "robot": "--robot",
    "trigger": "--trigger",
    "speed_m_s": "--speed-m-s",
    "threshold_n": "--threshold-n",
}

FEW = re.compile(r"leave out ((?:'[^']*', )*'[^']*'), or record more")
TRAIN_AND_TEST = re.compile(r"pass train_per_class=(\d+), test_per_class=(\d+)")

P = ParamSpec("P")


def guarded(command: Callable[P, None]) -> Callable[P, None]:
    """Turn the exceptions of a command into one line on standard error and an exit code.

    Bad input (ValueError, TypeError, OSError) exits with 2, a missing extra (an ImportError that says what to install)
    with 1, Ctrl-C with 130; what moves a robot also on SIGTERM with 143 and on SIGHUP with 129 (`stopping_the_robot`).
    Anything else is a bug and keeps its traceback. A warning is one line, too.
    """

    @functools.wraps(command)
    def run(*args: P.args, **kwargs: P.kwargs) -> None:
        try:
            with heeding_interrupts(), _warnings_in_one_line():
                command(*args, **kwargs)
        except KeyboardInterrupt as stop:
            say(str(stop) or "Interrupted: no file was left half-written.", "yellow")
            raise typer.Exit(INTERRUPTED) from None
        except (ValueError, TypeError, OSError, ImportError) as error:
            # An ImportError with a name is a broken installation, not one of ours that says what to install.
            if os.environ.get(DEBUG) or (isinstance(error, ImportError) and error.name is not None):
                raise
            say(f"error: {in_options(words_of(error))}", "bold red")
            raise typer.Exit(MISSING_EXTRA if isinstance(error, ImportError) else BAD_INPUT) from None

    return run


def in_options(message: str, rate_option: str = "--rate-hz") -> str:
    """Say a message of the library in the options of the command line.

    Parameters
    ----------
    message : str
        For example ``"... pass on_short='skip'"``.
    rate_option : str
        What `rate_hz` is called: when reading files it is ``--recorded-hz``.

    Returns
    -------
    str
        For example ``"... pass --on-short skip"``, on one line.

    Examples
    --------
    >>> in_options("train_per_class must be at least 1, got 0")
    '--train must be at least 1, got 0'
    >>> in_options("raise max_gap_s (None: no limit), or pass on_gap='skip'")
    'raise --max-gap-s (inf: no limit), or pass --on-gap skip'
    """
    if message.startswith("url '"):  # it speaks of what stands behind the question mark there
        return " ".join(message.split())
    one_line = re.sub(r"\bNone(?=(:| for) no limit)", "inf", " ".join(message.split()))
    one_line = TRAIN_AND_TEST.sub(r"add --train \1 --test \2", one_line)
    one_line = FEW.sub(_excluded, one_line)
    one_line = one_line.replace(".find_onsets(overrule={name: seconds})", "--onset-at NAME=SECONDS")
    one_line = one_line.replace("call .find_onsets()", "add --begin-at onset")
    one_line = one_line.replace(".resample(rate_hz)", "add --rate-hz")
    one_line = re.sub(r"\.resample\(([\d.e+]+)\)", r"add --rate-hz \1", one_line).replace("call add", "add")
    one_line = re.sub(r"raise max_file_bytes\b", "raise --max-file-mb", one_line)
    one_line = re.sub(r"\bpass accept=\('(\w+)',\)", r"add --accept \1", one_line)
    for name, option in (OPTIONS | {"rate_hz": rate_option}).items():
        # Not where the name is part of a path, a quotation, a call or a longer name, nor a column of a file.
        word = rf"(?<![\w.\-/\\'\"])(?<!column ){name}"
        one_line = re.sub(rf"{word}='([^']*)'", rf"{option} \1", one_line)
        one_line = re.sub(rf"{word}=(?=[\w.\-])", f"{option} ", one_line)
        one_line = re.sub(rf"{word}=", option, one_line)
        if "_" in name:
            one_line = re.sub(rf"{word}(?![\w/\\'\"]|\.\w| column)", option, one_line)
        else:  # also an everyday word: an argument only where a message begins with it
            one_line = re.sub(rf"^{name}(?= must |: )", option, one_line)
    return one_line


def _excluded(few: re.Match[str]) -> str:
    names = ",".join(re.findall(r"'([^']*)'", few[1]))
    return f"leave out with --exclude {shlex.quote(names)}, or record more"


def words_of(error: Exception) -> str:
    """Leave out the number that the system gives an error, and put the file first."""
    if isinstance(error, OSError) and error.filename is not None and error.strerror:
        return f"{os.fsdecode(error.filename)}: {error.strerror[0].lower()}{error.strerror[1:]}"
    return str(error)


@contextmanager
def _warnings_in_one_line() -> Iterator[None]:
    before = warnings.showwarning

    def show(message: Warning | str, *_: object, **__: object) -> None:
        say(f"warning: {in_options(str(message))}", "bold yellow")

    warnings.showwarning = show
    try:
        yield
    finally:
        warnings.showwarning = before
