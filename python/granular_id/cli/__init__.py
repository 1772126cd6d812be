"""The command ``granular-id``.

The command line needs typer and rich (extra ``app``); the library does not. Nothing in the package imports
this module.
"""

from __future__ import annotations

import sys

__all__ = ["main"]

_PARTS = ("typer", "rich")


def main() -> None:
    """Run ``granular-id`` with the arguments of the process and exit with its code: see docs/reference/versions.md."""
    try:
        try:
            from granular_id.cli.app import app
        except ModuleNotFoundError as error:
            missing = (error.name or "").partition(".")[0]
            if missing not in _PARTS:
                raise
            from granular_id._text import install

            sys.exit(f"granular-id: the command line needs {missing}: {install('app')}")
        app()
    except KeyboardInterrupt:
        # Ctrl-C before a command has begun; inside one, `Commands` answers it with the same line.
        sys.stderr.write("Interrupted.\n")
        sys.exit(130)
