"""``granular-id data convert``: recordings of any known format into one that can be written."""

from __future__ import annotations

from typing import Annotated

from rich.console import Console

from granular_id.cli.data.target import PANEL, Target
from granular_id.cli.errors import guarded
from granular_id.cli.groups import option, taking
from granular_id.cli.reading import Reading
from granular_id.cli.recordings import Steps

__all__ = ["convert"]

TEXT = """
Convert recordings: CSV, NumPy, MATLAB, HDF5, Parquet, ROS bags, MCAP and GM10-ts in; CSV, NPZ, HDF5, Parquet and
MCAP out.

Samples, stamps, flags, labels, sessions and history are kept to the last bit, unless an option asks for a step; what
was written is read back and compared. Nothing is overwritten.

Examples:

`granular-id data convert pushes.mat pushes.npz --recorded-hz 500`

`granular-id data convert recordings archive --to parquet`

`granular-id data convert bags pushes.h5 --rate-hz 500 --begin-at onset --lead-s 0.1 --duration-s 3.2`
"""


@guarded
@taking(Reading, Steps, Target)
def convert(
    reading: Reading,
    steps: Steps,
    target: Target,
    *,
    verify: Annotated[
        bool, option("--verify/--no-verify", PANEL, "Read back what was written and compare.")
    ] = True,
) -> None:
    """Read, take the steps asked for, write, compare; see `TEXT`."""
    from granular_id.io import load  # noqa: PLC0415 (--help must not wait for numpy)

    data = steps.taken(reading.load(quiet=False), quiet=False)
    target.save(data)
    try:
        equal = not verify or load(target.path, max_file_bytes=2**40, progress=True) == data
    except KeyboardInterrupt:
        raise KeyboardInterrupt(
            f"Interrupted: {target.path} is written, but was not read back and compared."
        ) from None
    if not equal:
        raise ValueError(f"{target.path} was written, but does not read back equal: do not rely on it")
    said = ", read back and found equal" if verify else ""
    Console(highlight=False).print(f"wrote {target.path}{said}", soft_wrap=True, markup=False)


convert.__doc__ = TEXT
