"""One red line instead of a traceback, in the words of the command line."""

from __future__ import annotations

import functools
import os
import re
import shlex
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, ParamSpec

import typer
from typer.core import TyperGroup

from granular_id.cli.interrupts import heeding_interrupts
from granular_id.cli.outputs import show

DEBUG = "GRANULAR_ID_DEBUG"
"""Environment variable: when set, an error ends in its traceback instead of one line."""

BAD_INPUT, MISSING_EXTRA, INTERRUPTED = 2, 1, 130

FOUND_ERRORS = 3
"""Exit code where recordings were read, and hold what would spoil, or spoils, an evaluation."""

P = ParamSpec("P")

_SAME = (
    "array axes begin_at id time bin_range block_weights C cutoff_hz direction dtype duration_s "
    "false_alarm_rate hop_s initial label lead_s max_force_n max_gap max_gap_s max_torque_n_m n_bins "
    "n_samples on_error on_gap on_short on_time_error order pre_s rate_hz rest_s robot "
    "scheduler session space spaces speed_m_s tare_s target_error threads threshold_n time_unit "
    "topic trigger units window_s"
)
OPTIONS = {name: f"--{name.replace('_', '-')}" for name in _SAME.split()} | {
    "format": "--to",
    "n_jobs": "--jobs",
    "overrule": "--onset-at",
    "n_partitions": "--partitions",
    "train_per_class": "--train",
    "test_per_class": "--test",
    "random_state": "--seed",
    "by": "--hold-out",
}
"""The option that sets an argument of the library."""


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
            show(str(stop) or "Interrupted: no file was left half-written.", "yellow", err=True)
            raise typer.Exit(INTERRUPTED) from None
        except (ValueError, TypeError, OSError, ImportError) as error:
            # An ImportError with a name is a broken installation, not one of ours that says what to install.
            if os.environ.get(DEBUG) or (isinstance(error, ImportError) and error.name is not None):
                raise
            show(f"error: {words_of(error)}", "bold red", err=True)
            raise typer.Exit(MISSING_EXTRA if isinstance(error, ImportError) else BAD_INPUT) from None

    return run


class OneLineUsage(TyperGroup):
    """Commands whose usage errors (an unknown option, a missing argument) are one line, too."""

    def main(self, *args: Any, **kwargs: Any) -> Any:
        """Run a command, and leave the process with its code."""
        try:
            code = super().main(*args, **kwargs | {"standalone_mode": False})
        except typer.Abort:
            show("Aborted.", "yellow", err=True)
            sys.exit(1)
        except Exception as error:
            # Those of click, which comes with typer, beside it or inside of it.
            format_message = getattr(error, "format_message", None)
            if format_message is None:
                raise
            if type(error).__name__ != "NoArgsIsHelpError":  # the help was printed
                context = getattr(error, "ctx", None)
                help_ = f"; see {context.command_path} --help" if context is not None else ""
                said = " ".join(str(format_message()).split()).removesuffix(".")
                show(f"error: {said[:1].lower()}{said[1:]}{help_}", "bold red", err=True)
            sys.exit(getattr(error, "exit_code", BAD_INPUT))
        sys.exit(code if isinstance(code, int) else 0)


@contextmanager
def _warnings_in_one_line() -> Iterator[None]:
    before = warnings.showwarning

    def show_warning(message: Warning | str, *_: object, **__: object) -> None:
        show(f"warning: {in_options(str(message))}", "bold yellow", err=True)

    warnings.showwarning = show_warning
    try:
        yield
    finally:
        warnings.showwarning = before


def words_of(error: Exception, rate_option: str = "--rate-hz", archive: str | os.PathLike[str] = "") -> str:
    """Say an error on one line, in options; without the number that the system gives it, the file first.

    `rate_option`: what `rate_hz` is called; when reading files it is ``--recorded-hz``. `archive`: the one that
    is worked on, whose recordings are taken as they are; the way out is another archive, made of it.
    """
    if isinstance(error, OSError) and error.filename is not None and error.strerror:
        said = f"{os.fsdecode(error.filename)}: {error.strerror[0].lower()}{error.strerror[1:]}"
        return " ".join(said.split())
    message = str(error)
    # The compiled core cannot set `argument`; its errors begin with the name, too: "order must be ...".
    argument = getattr(error, "argument", None) or re.split(" must |: ", message, maxsplit=1)[0]
    if (
        not isinstance(error, OSError) and argument in OPTIONS and re.match(f"{argument}(?!=)", message)
    ):  # with "=" it is said like any mention
        option = rate_option if argument == "rate_hz" else OPTIONS[argument]
        message = option + message.removeprefix(argument)
    if archive:
        add = f"granular-id data convert {shlex.quote(os.fspath(archive))} NEW --to parquet"
        for way_out, prepared in _ARCHIVE_WAYS_OUT.items():
            message = re.sub(way_out, functools.partial(_by_adding, add, prepared), message)
    return in_options(message, rate_option)


def in_options(message: str, rate_option: str = "--rate-hz") -> str:
    """Say in options, on one line, the ways out that a message offers in arguments: ``pass on_short='skip'``."""
    said, python, line = " ".join(message.split()).partition("in Python: ")
    if said.startswith("url '"):  # it speaks of what stands behind the question mark there
        return said
    for way_out, in_words in _WAYS_OUT.items():
        said = re.sub(way_out, in_words, said)

    def as_option(found: re.Match[str]) -> str:
        name, value = found.groups()
        if name is None:  # names in a file are listed
            return found[0]
        if value is None and "_" not in name:  # without a value it is also an everyday word
            return name
        option = rate_option if name == "rate_hz" else OPTIONS[name]
        return option + (" " + shlex.quote(value.strip("'")) if value else "")

    return _MENTION.sub(as_option, said) + python + line


def _excluded(few: re.Match[str]) -> str:
    names = ",".join(re.findall(r"'([^']*)'", few[1]))
    return f"leave out with --exclude {shlex.quote(names)}, or record more"


def _axes_listed(listed: re.Match[str]) -> str:
    names = ",".join(re.findall(r"'([^']*)'", listed[1]))
    return f"add --axes {shlex.quote(names)}"


def _csv_options(found: re.Match[str]) -> str:
    pairs = re.findall(r"'(\w+)': (?:'([^']*)'|(\[[^]]*\]|\w+))", found[1])
    return " ".join(f"--csv {shlex.quote(f'{key}={text or other}')}" for key, text, other in pairs)


def _accepts(found: re.Match[str]) -> str:
    return "add " + " ".join(f"--accept {name}" for name in re.findall(r"'([\w-]+)'", found[1]))


def _by_adding(add: str, prepared: str, found: re.Match[str]) -> str:
    values = [shlex.quote(text.replace("', '", ",").strip("'")) for text in found.groups()]
    return prepared.format(*values, add=add)


_ARCHIVE_WAYS_OUT = {
    r"call \.resample\(([\d.e+]+)\)(?: on the recordings)?": "{add} --rate-hz {0}",
    r"call \.select\(axes=\[([^\]]*)\]\)(?: on the recordings)?": "{add} --axes {0}",
    r"(\d+) of each: call \.align on the recordings": "{0} of each: {add} --n-samples {0}",
    r"call \.predict_over\(recording\)": "answer over all of it: {add} --window-s SECONDS",
}
"""Ways out of what is wrong with recordings of an archive; the values of `{0}` are those that the message names."""

_WAYS_OUT: dict[str, str | Callable[[re.Match[str]], str]] = {
    r"in Identifier\.fit\(data, '([\w-]+)'\), and give model=": r"in granular-id train --space \1, and add --model",
    r"\bNone(?=(:| for) no limit)": "inf",
    r"pass paper=\(\d+, (\d+), (\d+)\)": r"add --train \1 --test \2",
    r"leave out ((?:'[^']*', )*'[^']*'), or record more": _excluded,
    r"\.find_onsets\(overrule=\{name: seconds\}\)": "--onset-at NAME=SECONDS",
    r"call \.predict_over\(recording\)": "answer over all of it with --hop-s",
    r"call \.align\(\d+, on_short='skip'\)": "pass --on-short skip",
    r"call \.find_onsets\(\)": "add --begin-at onset",
    r"call \.split\(gap_s=([\d.e+-]+)\) before": r"convert them with granular-id data convert --split-gap-s \1",
    r"(?:call )?\.resample\(rate_hz\)": "add --rate-hz",
    r"call \.select\(axes=\[([^\]]*)\]\)": _axes_listed,
    r"call \.select\(axes=\.\.\.\) to keep those that all have": "add --axes with those that all have",
    r"(?:call )?\.resample\(([\d.e+]+)\)": r"add --rate-hz \1",
    r"csv=\{('[^{}]*)\}": _csv_options,
    r": rate_hz=RATE\b": ": --recorded-hz RATE",
    r"\bpass accept=\(([^)]*)\)": _accepts,
    r"\bpass allow_missing=True": "add --allow-missing",
    r"\ballow_missing=True": "--allow-missing",
    r"\ball_materials(=True)?": "--all-materials",
    r"\bgive labels$": "add --labelled in its place",
    r"^labels must hold labels of the training": (
        "every label must be one that the model knows (granular-id model info MODEL)"
    ),
}
"""Ways out that the command line offers under other words."""

_MENTION = re.compile(
    # Not where names are listed, nor where the name is part of a path, a quotation, a call or a longer name, nor a
    # column of a file, nor in a line of Python.
    r"\(meta: [^)]*\)|; (?:there are|those that can be:) [^;]*|numpy\.array\([^)]*\)|Dataset\.from_\w+\([^;]*|"
    rf"(?<![\w.\-/\\'\"])(?<!column )({'|'.join(sorted(OPTIONS, key=len, reverse=True))})"
    rf"(?:=('[^']*'|[\w.\-]*)|(?![\w/\\'\"=]|\.\w| column))"
)
"""An argument in a message: ``on_gap='skip'``, ``max_gap_s=0.25``, ``format=`` or ``max_gap_s`` alone."""
