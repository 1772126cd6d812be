"""What commands are made of: options, groups of options, checks of their values."""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Callable
from dataclasses import MISSING, fields
from inspect import Parameter
from typing import Annotated, Any, get_type_hints

import typer

from granular_id.cli.errors import guarded


def option(panel: str, text: str, *names: str) -> Any:
    """Return an option with its help in one of the panels of ``--help``; its name is the parameter's unless given."""
    return typer.Option(*names, help=text, rich_help_panel=panel)


Force = Annotated[
    bool, option("Output", "Replace files that are there, where they are of the same kind.", "--force")
]


def command(text: str, *groups: type) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Make a function a command with a text for its help and some groups of options.

    typer reads options off the signature of one function. A group is a dataclass whose fields are options and which
    checks them in `__post_init__`; the function gets an instance of each as its first arguments.
    """

    def decorate(function: Callable[..., None]) -> Callable[..., None]:
        own = list(inspect.signature(function, eval_str=True).parameters.values())[len(groups) :]
        of_groups = [_parameters(group) for group in groups]

        @guarded
        @functools.wraps(function)
        def run(**values: Any) -> None:
            made = [
                group(**{parameter.name: values.pop(parameter.name) for parameter in parameters})
                for group, parameters in zip(groups, of_groups, strict=True)
            ]
            function(*made, **values)

        every = [parameter for parameters in (*of_groups, own) for parameter in parameters]
        run.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
            [parameter.replace(kind=Parameter.KEYWORD_ONLY) for parameter in every]
        )
        run.__annotations__ = {parameter.name: parameter.annotation for parameter in every}
        run.__doc__ = text
        return run

    return decorate


@functools.cache  # commands share groups, and reading annotations takes time
def _parameters(group: type) -> list[Parameter]:
    hints = get_type_hints(group, include_extras=True)
    return [
        Parameter(
            field.name,
            Parameter.KEYWORD_ONLY,
            default=Parameter.empty if field.default is MISSING else field.default,
            annotation=hints[field.name],
        )
        for field in fields(group)
        if field.init
    ]


# Values of options, checked before any file is read.


def at_least(option: str, value: int | None, minimum: int) -> None:
    """Refuse a count below a minimum; None is no value at all."""
    if value is not None and value < minimum:
        wanted = "not be negative" if minimum == 0 else f"be at least {minimum}"
        raise ValueError(f"{option} must {wanted}, got {value}")


def positive(option: str, value: float | None, *, infinite: bool = False) -> None:
    """Refuse what is not positive, or not finite unless it may be infinite; None is no value at all."""
    if value is None or (value > 0 and (infinite or math.isfinite(value))):
        return
    raise ValueError(f"{option} must be positive{'' if infinite else ' and finite'}, got {value:g}")


def between(option: str, share: float) -> None:
    """Refuse what does not lie between 0 and 1."""
    if not 0 < share < 1:
        raise ValueError(f"{option} must lie between 0 and 1, got {share:g}")


def names_in(text: str) -> list[str]:
    """Split names at commas."""
    return [name.strip() for name in text.split(",") if name.strip()]
