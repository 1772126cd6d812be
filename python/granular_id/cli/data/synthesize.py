"""``granular-id data synthesize``: simulated recordings in a file, to try things on."""

from __future__ import annotations

from typing import Annotated

from rich.console import Console

from granular_id._words import counted
from granular_id.cli.data.target import Target
from granular_id.cli.errors import guarded
from granular_id.cli.groups import option, taking
from granular_id.cli.settings import at_least, names_in, positive

__all__ = ["synthesize"]

TEXT = """
Write SYNTHETIC recordings: pushes through simulated materials, from a physical model and not from a sensor.

Examples:

`granular-id data synthesize pushes.npz`

`granular-id data synthesize few --to csv --materials rice,oat flakes --per-class 5`
"""

PUSHES = "Pushes"


@guarded
@taking(Target)
def synthesize(
    target: Target,
    *,
    materials: Annotated[
        str, option("--materials", PUSHES, "Names separated by commas. Default: the paper's eleven.")
    ] = "",
    per_class: Annotated[int, option("--per-class", PUSHES, "Pushes of each material.")] = 62,
    sessions: Annotated[
        int | None, option("--sessions", PUSHES, "Sessions they come from. Default: see synthesize().")
    ] = None,
    rate_hz: Annotated[float, option("--rate-hz", PUSHES, "Sampling rate.")] = 500.0,
    seed: Annotated[int, option("--seed", PUSHES, "Same seed, same recordings.")] = 0,
) -> None:
    """Write simulated recordings; see `TEXT`."""
    at_least("--per-class", per_class, 1)
    at_least("--sessions", sessions, 1)
    at_least("--seed", seed, 0)
    positive("--rate-hz", rate_hz)

    from granular_id.synthetic import synthesize as make  # noqa: PLC0415 (--help must not wait for numpy)

    data = make(
        names_in(materials) or None, n_per_class=per_class, sessions=sessions, rate_hz=rate_hz, seed=seed
    )
    target.save(data)
    what = f"{counted(len(data), 'SYNTHETIC recording')} of {counted(len(data.labels), 'material')}"
    Console(highlight=False).print(f"wrote {target.path}: {what}", soft_wrap=True, markup=False)


synthesize.__doc__ = TEXT
