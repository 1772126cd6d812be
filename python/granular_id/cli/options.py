"""What commands are made of: options, groups of options, checks of their values."""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Callable
from dataclasses import is_dataclass
from inspect import Parameter
from typing import Any, TypeVar, get_type_hints

import typer
from typer.models import OptionInfo

from granular_id._core import GranularIdError
from granular_id.cli.errors import guarded

Group = TypeVar("Group")


def option(panel: str, text: str, *names: str, default: Any = None, **bounds: Any) -> Any:
    """Return an option with its help in one of the panels of ``--help``; with the default ``...`` it must be given.

    Its name is the parameter's unless given. Bounds are a `callback`: `count`, `above_zero`, `a_share`.
    """
    return typer.Option(default, *names, help=text, rich_help_panel=panel, **bounds)


def count(least: int) -> Callable[[int | None], int | None]:
    """Return the callback of an option that refuses whole numbers below `least`."""

    def callback(value: int | None) -> int | None:
        if value is not None and value < least:
            raise typer.BadParameter(f"must be at least {least}, got {value}")
        return value

    return callback


def above_zero(value: float | None) -> float | None:
    """Refuse what is not positive and finite: the callback of an option."""
    if value is not None and not 0 < value < math.inf:
        raise typer.BadParameter(f"must be positive and finite, got {value:g}")
    return value


def a_share(value: float) -> float:
    """Refuse what does not lie between 0 and 1: the callback of an option."""
    if not 0 < value < 1:
        raise typer.BadParameter(f"must lie between 0 and 1, got {value:g}")
    return value


FORCE = option(
    "Output", "Replace files that are there, where they are of the same kind.", "--force", default=False
)


def command(function: Callable[..., None]) -> Callable[..., None]:
    """Make a function a command; its help is its docstring.

    typer reads options off the signature of one function. Here a parameter may also stand for a group of options: a
    dataclass whose fields are options and which checks them in `__post_init__`.
    """
    parameters = inspect.signature(function, eval_str=True).parameters.values()
    groups: dict[str, Any] = {
        each.name: each.annotation for each in parameters if is_dataclass(each.annotation)
    }

    @guarded
    @functools.wraps(function)
    def run(**values: Any) -> None:
        made = {
            name: group(**{each.name: values.pop(each.name) for each in _options_of(group)})
            for name, group in groups.items()
        }
        function(**made, **values)

    every = [
        option.replace(kind=Parameter.KEYWORD_ONLY)
        for each in parameters
        for option in (_options_of(each.annotation) if each.name in groups else [each])
    ]
    run.__signature__ = inspect.Signature(every)  # type: ignore[attr-defined]
    run.__annotations__ = {option.name: option.annotation for option in every}
    # Markdown would join examples that no blank line parts.
    run.__doc__ = inspect.cleandoc(function.__doc__ or "").replace("`\n`", "`\n\n`")
    return run


@functools.cache  # commands share groups, and reading annotations takes time
def _options_of(group: Callable[..., Any]) -> list[Parameter]:
    hints = get_type_hints(group)
    return [
        each.replace(annotation=hints[each.name]) for each in inspect.signature(group).parameters.values()
    ]


def with_defaults(group: Callable[..., Group]) -> Group:
    """Return a group of options at their defaults."""
    return group(**{each.name: each.default.default for each in _options_of(group)})


def given_flags(*groups: Any) -> list[str]:
    """Name the options of groups that were given other values than their defaults, as they are typed."""
    flags = []
    for group in groups:
        kind: Callable[..., Any] = type(group)
        for each in _options_of(kind):
            value, known = getattr(group, each.name), each.default
            if isinstance(known, OptionInfo) and value != known.default:
                named = [word for word in known.param_decls or () if word.startswith("--")]
                flag = named[0] if named else f"--{each.name.replace('_', '-')}"
                flags.append(flag if value is not False else flag.replace("--", "--no-", 1))
    return flags


# Values of options, checked before any file is read.


def at_least(option: str, value: int | None, minimum: int) -> None:
    """Refuse a count below a minimum; None is no value at all."""
    if value is not None and value < minimum:
        wanted = "not be negative" if minimum == 0 else f"be at least {minimum}"
        raise GranularIdError(f"{option} must {wanted}, got {value}")


def positive(option: str, value: float | None, *, infinite: bool = False) -> None:
    """Refuse what is not positive, or not finite unless it may be infinite; None is no value at all."""
    if value is None or (value > 0 and (infinite or math.isfinite(value))):
        return
    raise GranularIdError(f"{option} must be positive{'' if infinite else ' and finite'}, got {value:g}")


def between(option: str, share: float) -> None:
    """Refuse what does not lie between 0 and 1."""
    if not 0 < share < 1:
        raise GranularIdError(f"{option} must lie between 0 and 1, got {share:g}")


def numbers_in(option: str, text: str, wanted: str, count: int | None = None) -> list[float]:
    """Split numbers at commas."""
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if not numbers or count not in (None, len(numbers)):
        raise GranularIdError(f"{option} must be {wanted}, got {text!r}")
    return numbers


def names_in(text: str) -> list[str]:
    """Split names at commas."""
    return [name.strip() for name in text.split(",") if name.strip()]
