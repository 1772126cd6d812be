"""``granular-id data info``: what a folder or file of recordings holds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from rich.console import Console

from granular_id.cli.errors import guarded
from granular_id.cli.groups import option, taking
from granular_id.cli.reading import Reading
from granular_id.cli.session import JSON_FILE, Force, check_outputs, say_written

__all__ = ["info"]

TEXT = """
Say what a folder or file holds: recordings, materials, sessions, rates, lengths, gaps, flags, history.

Examples:

`granular-id data info recordings`

`granular-id data info pushes.mat`

`granular-id data info recordings --json info.json`
"""

OUTPUT = "Output"


@guarded
@taking(Reading)
def info(
    reading: Reading,
    *,
    json: Annotated[Path | None, option("--json", OUTPUT, "Write the summary and all steps.")] = None,
    force: Force = False,
) -> None:
    """Print a summary; see `TEXT`."""
    check_outputs(("--json", json, JSON_FILE), source=reading.path, force=force)
    data = reading.load(quiet=False)
    console = Console(highlight=False)
    summary = data.summary()
    axes = sorted({" ".join(recording.axes) for recording in data})
    keys = sorted({key for recording in data for key in recording.meta})
    synthetic = sum(recording.is_synthetic for recording in data)
    steps = [*(str(step).partition("\n")[0] for step in data.history)]
    lines = [
        f"format: {data.history[-1].parameters['format']}",
        f"axes: {' or '.join(axes)}",
        *([f"SYNTHETIC: {synthetic} of {len(data)} recordings"] if synthetic else []),
        f"meta: {', '.join(keys) or 'none'}",
        *(f"step {number}: {step}" for number, step in enumerate(steps, start=1)),
        "",
        str(summary),
    ]
    console.print("\n".join(lines), soft_wrap=True, markup=False)
    if json is not None:
        from granular_id._files import write_json  # noqa: PLC0415 (slow to import: --help must not wait)

        write_json(json, {"summary": summary.to_dict(), "history": [step.to_dict() for step in data.history]})
        say_written(console, [json], None)


info.__doc__ = TEXT
