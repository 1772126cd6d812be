"""``granular-id data head``: the first samples of a recording, as numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from rich.console import Console

from granular_id.cli.errors import guarded
from granular_id.cli.groups import option, taking
from granular_id.cli.reading import Reading
from granular_id.cli.settings import at_least

if TYPE_CHECKING:
    from granular_id.recording import Dataset, Recording

__all__ = ["head"]

TEXT = """
Print what is known of one recording and its first samples: forces in N, torques in N m.

Examples:

`granular-id data head recordings`

`granular-id data head recordings --name rice/rice_07.csv -n 20`
"""

SHOWN = "Shown"


@guarded
@taking(Reading)
def head(
    reading: Reading,
    *,
    n: Annotated[int, option("-n", SHOWN, "Samples to print.")] = 10,
    name: Annotated[
        str | None, option("--name", SHOWN, "Name of the recording. Default: the first one.")
    ] = None,
) -> None:
    """Print the first samples of a recording; see `TEXT`."""
    at_least("-n", n, 1)
    data = reading.load(quiet=False)
    Console(highlight=False).print("\n".join(_lines(_chosen(data, name), n)), soft_wrap=True, markup=False)


def _chosen(data: Dataset, name: str | None) -> Recording:
    if name is None:
        return data[0]
    found = [recording for recording in data if recording.name == name]
    if not found:
        from difflib import get_close_matches  # noqa: PLC0415 (an error is no reason to start slowly)

        near = get_close_matches(name, data.names, 3, 0.4) or data.names[:3]
        raise ValueError(f"--name: no recording is called {name!r}; there are {', '.join(near)} ...")
    return found[0]


def _lines(recording: Recording, n: int) -> list[str]:
    from textwrap import shorten  # noqa: PLC0415

    from granular_id.recording._values import thaw  # noqa: PLC0415
    from granular_id.recording.axes import unit_of  # noqa: PLC0415 (--help must not wait for numpy)
    from granular_id.recording.report import text_table  # noqa: PLC0415

    known = ("label", "session", "start_time", "trigger_index")
    facts = [f"{field}: {value}" for field in known if (value := getattr(recording, field)) is not None]
    facts += [f"meta.{key}: {shorten(str(thaw(value)), 100)}" for key, value in recording.meta.items()]
    header = ["time s", *(f"{axis} {unit_of(axis, recording.meta)}" for axis in recording.axes)]
    rows = []
    for i in range(min(n, recording.n_samples)):
        cells = [f"{recording.times()[i]:.6g}", *(f"{value:.6g}" for value in recording.wrench[i])]
        row = dict(zip(header, cells, strict=True))
        if recording.flags is not None:
            row["flags"] = str(recording.flags[i])
        rows.append(row)
    return ["", repr(recording), *facts, "", *text_table(rows)]


head.__doc__ = TEXT
