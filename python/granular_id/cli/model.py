"""``granular-id model``: what is in a model file."""

from __future__ import annotations

import json as json_format
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.text import Text

from granular_id.cli.errors import guarded
from granular_id.cli.groups import option
from granular_id.cli.session import JSON_FILE, Force, check_outputs, say_written

if TYPE_CHECKING:
    from granular_id.identifier import Identifier

__all__ = ["model", "print_model"]

model = typer.Typer(no_args_is_help=True, help="Look into a model file, as `granular-id train` writes it.")

TEXT = """
Say what a model was trained on, which materials it knows, what it takes, how well it did on recordings held out, and
when it answers early.

The file is checked as strictly as for use: what this prints is a model that works.

Examples:

`granular-id model info kitchen.safetensors`

`granular-id model info kitchen.safetensors --json kitchen.json`
"""

OUTPUT = "Output"


@model.command("info")
@guarded
def info(
    file: Annotated[Path, typer.Argument(metavar="MODEL", help="Model file.")],
    *,
    json: Annotated[Path | None, option("--json", OUTPUT, "Write everything but the weights.")] = None,
    force: Force = False,
) -> None:
    """Print what is in a model file; see `TEXT`."""
    check_outputs(("--json", json, JSON_FILE), source=file, force=force)

    from granular_id.identifier import Identifier  # noqa: PLC0415 (slow to import: --help must not wait)

    identifier = Identifier.load(file)
    console = Console(highlight=False)
    print_model(console, identifier)
    if json is not None:
        from granular_id._files import write_json  # noqa: PLC0415

        write_json(json, _everything(identifier))
        say_written(console, [json], None)


info.__doc__ = TEXT


def print_model(console: Console, identifier: Identifier, *, brief: bool = False) -> None:
    """Print what a model is and what may be expected of it; when brief, only the latter."""
    from granular_id.identifier.words import description, promises  # noqa: PLC0415 (slow to import)

    lines = promises(identifier) if brief else [*description(identifier), *promises(identifier)]
    for line in lines:
        console.print(Text(line, style="bold yellow" if "SYNTHETIC" in line else ""), soft_wrap=True)


def _plain(spec: Any) -> dict[str, object]:
    """Say what is extracted, in types that JSON knows."""
    said = dict(spec.__getnewargs_ex__()[1])
    said = {name: value.tolist() if hasattr(value, "tolist") else value for name, value in said.items()}
    bands = getattr(spec, "bands", None)
    return said if bands is None else said | {"bands": bands, "block_sizes": spec.block_sizes}


def _everything(identifier: Identifier) -> dict[str, object]:
    core = identifier.core
    metadata = dict(core.metadata)
    return {
        **{
            name: metadata[name]
            for name in sorted(metadata)
            if name not in ("axes", "units", "trained", "lead_s")
        },
        "classes": list(identifier.classes),
        "space": identifier.space,
        "spec": _plain(core.spec),
        "n_samples": identifier.n_samples,
        "rate_hz": identifier.rate_hz,
        "lead_s": identifier.lead_s,
        "axes": list(identifier.axes),
        "units": json_format.loads(metadata["units"]),
        "n_features": core.n_features,
        "n_learners": core.n_learners,
        "loss": core.loss,
        "decoding": core.decoding,
        "early": None if core.early is None else core.early.tolist(),
        "trained": identifier.trained,
    }
