"""``granular-id data plot``: recordings over time, as a picture."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated

from rich.console import Console

from granular_id.cli.errors import guarded
from granular_id.cli.groups import option, taking
from granular_id.cli.prepare import with_onsets
from granular_id.cli.reading import Reading
from granular_id.cli.recordings import Steps
from granular_id.cli.session import PICTURE, Force, check_outputs, say_written
from granular_id.cli.settings import at_least, names_in

__all__ = ["plot"]

TEXT = """
Draw recordings: some of each material as they are stored, their mean, or where the motion begins.

Examples:

`granular-id data plot recordings -o recordings.png`

`granular-id data plot recordings -o onset.png --what onset --rate-hz 100 --max-gap-s inf`

`granular-id data plot recordings -o mean.svg --what mean --n-samples shortest --axes tx,ty`
"""

PANEL = "Picture"


class What(str, Enum):
    """Choices of ``--what``."""

    recordings = "recordings"
    mean = "mean"
    onset = "onset"


@guarded
@taking(Reading, Steps)
def plot(
    reading: Reading,
    steps: Steps,
    *,
    output: Annotated[Path, option("--output -o", PANEL, "File to write: png, svg or pdf.")] = Path(
        "recordings.png"
    ),
    what: Annotated[
        What, option("--what", PANEL, "Single recordings, means of materials, or onsets of motion.")
    ] = What.recordings,
    axes: Annotated[
        str,
        option("--axes", PANEL, "Axes separated by commas, of one unit. Default: fx,fy,fz; fx,fz for mean."),
    ] = "",
    n: Annotated[
        int | None, option("-n", PANEL, "Recordings per material (recordings) or in all (onset).")
    ] = None,
    force: Force = False,
) -> None:
    """Draw a picture; see `TEXT`."""
    at_least("-n", n, 1)
    if axes and what is What.onset:
        raise ValueError("--axes does not go with --what onset, which draws all forces")
    if n is not None and what is What.mean:
        raise ValueError("-n does not go with --what mean, which is made of all recordings")
    check_outputs(("--output", output, PICTURE), source=reading.path, force=force)

    from granular_id import plotting  # noqa: PLC0415 (--help must not wait for numpy)

    data = steps.taken(reading.load(quiet=False), quiet=False, onsets=what is What.onset)
    chosen = names_in(axes)
    if what is What.mean:
        plotting.plot_mean_forces(data, axes=chosen or ("fx", "fz"), path=output)
    elif what is What.onset:
        data = with_onsets(data, steps.preparation)
        Console(highlight=False).print(str(data.history[-1]), soft_wrap=True, markup=False)
        plotting.plot_onsets(data, output, n=n or 10, rest_s=steps.preparation.rest_s)
    else:
        plotting.plot_recordings(data, output, axes=chosen or None, n=n or 5)
    say_written(Console(highlight=False), [output], None)


plot.__doc__ = TEXT
