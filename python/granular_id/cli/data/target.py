"""The argument OUTPUT and the option --to: where recordings are written, and in which format."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from granular_id.cli.groups import option

if TYPE_CHECKING:
    from granular_id.recording import Dataset

__all__ = ["PANEL", "Target"]

PANEL = "Output"


class Target:
    """A place for recordings, where there is nothing yet and which can be written."""

    def __init__(
        self,
        output: Annotated[Path, typer.Argument(metavar="OUTPUT", help="File or folder to write.")],
        *,
        to: Annotated[
            str | None,
            option("--to", PANEL, "csv, npz, hdf5, parquet or mcap. Default: told by the ending of OUTPUT."),
        ] = None,
    ) -> None:
        from granular_id.io.saving import check_save  # noqa: PLC0415 (--help must not wait for numpy)

        check_save(output, to)
        self.path = output
        self._format = to

    def save(self, data: Dataset) -> None:
        """Write recordings, with a bar where it takes long."""
        from granular_id.io import save  # noqa: PLC0415

        save(data, self.path, self._format, progress=True)
