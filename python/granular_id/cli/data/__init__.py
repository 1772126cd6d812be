"""``granular-id data``: look at recordings, check them, convert them; one command a file."""

from __future__ import annotations

import typer

from granular_id.cli.data.check import check
from granular_id.cli.data.convert import convert
from granular_id.cli.data.head import head
from granular_id.cli.data.info import info
from granular_id.cli.data.plot import plot
from granular_id.cli.data.synthesize import synthesize

__all__ = ["data"]

data = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode="markdown",
    help="Look at recordings, check them, convert them.",
)
for command in (info, head, check, plot, convert, synthesize):
    data.command()(command)
