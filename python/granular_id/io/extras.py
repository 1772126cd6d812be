"""Libraries that only some formats need."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

__all__ = ["need"]


def need(module: str, *, extra: str, why: str) -> ModuleType:
    """Import a library, or say how to install it.

    Parameters
    ----------
    module : str
        Name of the module, like ``"h5py"`` or ``"pyarrow.parquet"``.
    extra : str
        Extra of granular-id that brings it.
    why : str
        What it is for, ending the sentence: ``"to read .h5 files"``.

    Raises
    ------
    ImportError
        The library is not there.
    """
    try:
        return import_module(module)
    except ImportError as error:
        library = module.partition(".")[0]
        raise ImportError(f"{library} is needed {why}: pip install 'granular-id[{extra}]'") from error
