"""The typer application: one command per file."""

from __future__ import annotations

from typing import Annotated

import typer

from granular_id import _core
from granular_id.cli.demo import demo
from granular_id.cli.evaluate import evaluate

__all__ = ["app"]

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
    help="Names the granular material under a robot's tool from a 6-axis force-torque signal.",
)
app.command()(evaluate)
app.command()(demo)


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"granular-id {_core.__version__}")
        raise typer.Exit


@app.callback()
def root(
    *,
    version: Annotated[
        bool, typer.Option("--version", help="Print the version and exit.", callback=_version, is_eager=True)
    ] = False,
) -> None:
    """Names the granular material under a robot's tool from a 6-axis force-torque signal."""
