"""The typer application: its commands in the order of ``--help``, and what becomes of an error in any of them."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from granular_id import _core
from granular_id._core import GranularIdError
from granular_id.cli import archive, convert, data, setup
from granular_id.cli.adapt import adapt
from granular_id.cli.confidence import confidence
from granular_id.cli.demo import demo
from granular_id.cli.evaluate import evaluate
from granular_id.cli.explain import explain
from granular_id.cli.identify import identify
from granular_id.cli.interrupts import NO_READER, is_lost, raise_again
from granular_id.cli.live import live
from granular_id.cli.outputs import show
from granular_id.cli.record import record
from granular_id.cli.recordings import with_way_out
from granular_id.cli.train import model, train

__all__ = ["app"]

PURPOSE = "Tells granular materials apart by force-torque recordings, and says how well that works."

BAD_INPUT, MISSING_EXTRA, INTERRUPTED = 2, 1, 130

_OTHER_NAMES = {"by": "--hold-out", "n_jobs": "--jobs", "random_state": "--seed"}
"""Options that are not called like the argument that they set."""


class Commands(TyperGroup):
    """All commands: wrong usage ends in one message, as their refusals do."""

    def main(self, *args: Any, **kwargs: Any) -> Any:
        """Run a command, and leave the process with its code."""
        try:
            code = super().main(*args, **kwargs | {"standalone_mode": False})
        except SystemExit as end:
            # typer and rich both make 1 of it, without a word
            if isinstance(end.__context__, BrokenPipeError):
                end.code = NO_READER
            raise
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
                message = (
                    " ".join(str(format_message()).split()).removesuffix(".").replace("Value error, ", "")
                )
                show(f"error: {message[:1].lower()}{message[1:]}{help_}", "bold red", err=True)
            sys.exit(getattr(error, "exit_code", BAD_INPUT))
        if code == INTERRUPTED:  # typer heard it, before the command or after it
            show("Interrupted.", "yellow", err=True)
        sys.exit(code if isinstance(code, int) else 0)

    def invoke(self, ctx: Any) -> Any:
        """Run a command; Ctrl-C ends it with 130."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as stop:
            show(str(stop) or "Interrupted: no file was left half-written.", "yellow", err=True)
            sys.exit(INTERRUPTED)


class Command(TyperCommand):
    """A command whose refusals are one message and an exit code; anything else is a bug and shows its traceback."""

    def parse_args(self, ctx: Any, args: list[str]) -> Any:
        """Refuse empty words, which unset variables of a shell leave: as a path one would be the folder at hand."""
        if "" in args:
            raise typer.BadParameter("an argument is an empty text", ctx=ctx)
        ctx.meta["words"] = tuple(args)
        return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        """Run it: bad input ends with 2, a missing extra with 1."""
        before = warnings.showwarning, sys.unraisablehook
        warnings.showwarning, sys.unraisablehook = _show_warning, raise_again
        try:
            return super().invoke(ctx)
        except (GranularIdError, OSError, ImportError) as error:
            # An ImportError with a name is a broken installation, not one of ours that says what to install.
            if isinstance(error, ImportError) and error.name is not None:
                raise
            if isinstance(error, BrokenPipeError) and is_lost(sys.stdout):
                raise
            message = _words_of(error, {name for one in self.params for name in one.opts})
            show(f"error: {with_way_out(error, message, ctx.meta['words'])}", "bold red", err=True)
            raise typer.Exit(MISSING_EXTRA if isinstance(error, ImportError) else BAD_INPUT) from None
        finally:
            warnings.showwarning, sys.unraisablehook = before


def _words_of(error: Exception, options: set[str]) -> str:
    """Say an error: of the system the file first, without a number; about an argument with its option first."""
    if isinstance(error, OSError) and error.filename is not None and error.strerror:
        return f"{os.fsdecode(error.filename)}: {error.strerror[0].lower()}{error.strerror[1:]}"
    message, argument = str(error), getattr(error, "argument", "")
    option = _OTHER_NAMES.get(argument, f"--{argument.replace('_', '-')}")
    return option + message.removeprefix(argument) if option in options else message


def _show_warning(message: Warning | str, *_: object, **__: object) -> None:
    show(f"warning: {message}", "bold yellow", err=True)


_GROUPS: dict[str, tuple[str, dict[str, Callable[..., None]]]] = {
    "data": (
        "Look at recordings, check and convert them.",
        {
            "info": data.info,
            "check": data.check,
            "plot": data.plot,
            "convert": convert.convert,
            "synthesize": convert.synthesize,
        },
    ),
    "archive": (
        "Recordings in Parquet by the million: add, look at, check.",
        {"add": archive.add, "info": archive.info, "check": archive.check},
    ),
    "setup": (
        "What recordings and models were made with; the tool's weight.",
        {"show": setup.show_setup, "payload": setup.payload},
    ),
}
_HELP: dict[str, Any] = {"no_args_is_help": True, "rich_markup_mode": "markdown"}

app = typer.Typer(cls=Commands, add_completion=False, pretty_exceptions_enable=False, help=PURPOSE, **_HELP)
for _command in (
    demo,
    evaluate,
    train,
    identify,
    live,
    record,
    explain,
    confidence,
    adapt,
    archive.extract,
    model,
):
    app.command(cls=Command)(_command)
for _name, (_purpose, _commands) in _GROUPS.items():
    _group = typer.Typer(help=_purpose, **_HELP)
    for _word, _called in _commands.items():
        _group.command(_word, cls=Command)(_called)
    app.add_typer(_group, name=_name)


@app.callback(help=PURPOSE, invoke_without_command=True)
def root(
    *, version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False
) -> None:
    """See `PURPOSE`."""
    if version:
        typer.echo(f"granular-id {_core.__version__}")
        raise typer.Exit
