"""The typer application: its commands in the order of ``--help``."""

from __future__ import annotations

from typing import Annotated

import typer

from granular_id import _core
from granular_id.cli.adapt import adapt
from granular_id.cli.archive import archive, extract
from granular_id.cli.confidence import confidence
from granular_id.cli.data import data
from granular_id.cli.demo import demo
from granular_id.cli.errors import OneLineUsage
from granular_id.cli.evaluate import evaluate
from granular_id.cli.explain import explain
from granular_id.cli.identify import identify
from granular_id.cli.live import live, record
from granular_id.cli.setup import setup
from granular_id.cli.train import model, train

__all__ = ["app"]

PURPOSE = "Tells granular materials apart by force-torque recordings, and says how well that works."

app = typer.Typer(
    cls=OneLineUsage,
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
    help=PURPOSE,
)
for command in (
    *(evaluate, explain, confidence, record, live, train, identify, adapt),
    *(extract, demo),
):
    app.command()(command)
app.add_typer(model, name="model")
app.add_typer(data, name="data")
app.add_typer(archive, name="archive")
app.add_typer(setup, name="setup")


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"granular-id {_core.__version__}")
        raise typer.Exit


@app.callback(help=PURPOSE)
def root(
    *,
    version: Annotated[
        bool, typer.Option("--version", help="Print the version and exit.", callback=_version, is_eager=True)
    ] = False,
) -> None:
    """See `PURPOSE`."""
