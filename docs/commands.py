"""The command line on reference/cli: help, examples and options of every command, as ``--help`` has them."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from typing import Any

import typer.main

from granular_id.cli.app import app as cli

PAGE = "reference/cli"
Command = tuple[str, Any, dict[str, list[str]]]


def commands_of(group: Any, name: str) -> Iterator[Command]:
    """Every command with its options by heading, as items of a list."""
    for word, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands_of(command, f"{name} {word}")
            continue
        context = typer.Context(command)
        panels: dict[str, list[str]] = {}
        for parameter in command.params:
            record = parameter.get_help_record(context)
            if record is None:  # hidden
                continue
            usage, text = record
            text = quoted(text or "").replace("<", "&lt;")
            is_argument = parameter.param_type_name == "argument"
            panel = (
                "Arguments" if is_argument else parameter.rich_help_panel or "Options"
            )
            panels.setdefault(panel, []).append(f"- `{usage}`: {text}")
        yield f"{name} {word}", command, panels


def quoted(text: str) -> str:
    """Options as code, where they are not yet."""
    return re.sub(
        r"`[^`]*`|(?<![\w-])--?[a-zA-Z][\w-]*",
        lambda found: found[0] if found[0][0] == "`" else f"`{found[0]}`",
        text,
    )


def help_of(command: Any) -> str:
    """Examples as one block to copy from."""

    def block(found: re.Match[str]) -> str:
        return (
            "```console\n"
            + "\n".join(re.findall(r"^- `(.*)`$", found[0], flags=re.MULTILINE))
            + "\n```\n\n"
        )

    return re.sub(
        r"(?:^- `granular-id [^`\n]*`\n*)+",
        block,
        quoted(inspect.cleandoc(command.help)) + "\n",
        flags=re.MULTILINE,
    )


def text() -> str:
    commands = list(commands_of(typer.main.get_command(cli), "granular-id"))
    lines = [
        f"- [`{name}`](#{name.replace(' ', '-')}): {command.help.splitlines()[0]}"
        for name, command, _ in commands
    ]
    for name, command, panels in commands:
        lines += ["", f"## `{name}`", "", help_of(command)]
        for panel, items in panels.items():
            lines += ["", f"**{panel}**", "", *items, ""]
    return "\n".join(lines) + "\n"


def setup(app: Any) -> dict[str, bool]:
    def add(_app: Any, page: str, source: list[str]) -> None:
        if page == PAGE:
            source[0] += "\n" + text()

    app.connect("source-read", add)
    app.connect("env-get-outdated", lambda *_: [PAGE])
    return {"parallel_read_safe": True, "parallel_write_safe": True}
