"""Groups of options that several commands share, each written once."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import typer

__all__ = ["option", "taking"]


def option(names: str, panel: str, text: str) -> Any:
    """Return an option, its names separated by blanks, with its help in one of the panels of ``--help``."""
    return typer.Option(*names.split(), help=text, rich_help_panel=panel)


def taking(*groups: type) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command the parameters of some classes; it gets an instance of each as its first arguments.

    typer reads options off the signature of a function. A class whose constructor is such a signature, and
    checks the values, is a group of options. The order on the command line: positional arguments of the
    groups, of the command, then all options.
    """

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        own = list(inspect.signature(command, eval_str=True).parameters.values())[len(groups) :]
        of_group = [list(inspect.signature(group, eval_str=True).parameters.values()) for group in groups]
        every = [parameter for parameters in (*of_group, own) for parameter in parameters]
        ordered = sorted(every, key=lambda parameter: parameter.kind)
        signature = inspect.Signature(ordered)

        def run(*args: Any, **kwargs: Any) -> None:
            bound = signature.bind(*args, **kwargs)
            bound.apply_defaults()
            values = bound.arguments
            made = [
                group(**{parameter.name: values.pop(parameter.name) for parameter in parameters})
                for group, parameters in zip(groups, of_group, strict=True)
            ]
            command(*made, **values)

        run.__name__, run.__doc__, run.__module__ = command.__name__, command.__doc__, command.__module__
        run.__signature__ = signature  # type: ignore[attr-defined]
        run.__annotations__ = {parameter.name: parameter.annotation for parameter in ordered}
        return run

    return decorate
