"""Files that commands write, checked before any work: nothing of another kind is replaced, and nothing unasked."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

from granular_id._files import JSON, MODELS, PAGES, PICTURES, TABLES, check_target


class Kind(NamedTuple):
    """A kind of output: what it is called, the endings it may have, and how its files begin (a pattern of bytes)."""

    name: str
    endings: tuple[str, ...]
    begins: bytes


JSON_FILE = Kind("a JSON file", JSON, rb"\s*[{\[]")
PAGE = Kind("an HTML page", PAGES, rb"\s*<(!doctype\s+)?html")
MODEL = Kind("a model", MODELS, rb".{8}\{")
PREDICTIONS = Kind("a table of predictions", TABLES, rb"protocol,partition,")
ANSWERS = Kind("a table of answers", TABLES, rb"recording,label,margin,")
LIVE_ANSWERS = Kind("a file of live answers", (".jsonl", ".ndjson", *JSON), rb"\s*\{")
RERUN_LOG = Kind("a Rerun log", (".rrd",), rb"RRF")
PICTURE = Kind("a picture", (), rb"\x89PNG|%PDF|\s*<(\?xml|svg)")
"""Its ending chooses the format, and so is asked for; matplotlib knows more of them than begin like this."""

Output = tuple[str, Path | None, Kind]
"""An option, the file that it names, and what will be written there; None is no file."""


def check_outputs(*outputs: Output, source: Path | None = None, force: bool = False) -> None:
    """Refuse, before any work, outputs that would not be what their name says, or would replace what is there.

    These are: what cannot be written, belongs to `source`, which is read, or would be written twice; a name that ends
    like no file of its kind; a file of another kind, by how it begins; without `force` any file that is not empty.
    """
    named = [(name, check_target(path), kind) for name, path, kind in outputs if path is not None]
    _refuse_overlaps([path for _, path, _ in named], source)
    for name, path, kind in named:
        if kind is PICTURE:
            from granular_id.plotting import file_format

            file_format(path, name)
        elif path.suffix.lower() not in kind.endings and re.search("[a-z]", path.suffix.lower()):
            # rice_0.5 is no kind of file
            wanted = f"must end in {' or '.join(kind.endings)}, or have no ending"
            raise ValueError(f"{name} writes {kind.name}: it {wanted}, got {path.name!r}")
    for name, path, kind in named:
        if not path.exists() or not path.stat().st_size:
            continue
        known = kind is not PICTURE or path.suffix.lower() in PICTURES
        with path.open("rb") as stream:
            if known and not re.match(kind.begins, stream.read(4096), re.IGNORECASE | re.DOTALL):
                raise ValueError(f"{name} {path}: what is there is not {kind.name}; give another name")
        if not force:
            raise FileExistsError(f"{name} {path}: there is such a file already; add --force to replace it")


def _refuse_overlaps(targets: list[Path], source: Path | None) -> None:
    places = [target.resolve() for target in targets]
    for k, place in enumerate(places):
        if place in places[:k]:
            raise ValueError(f"{targets[k]} would be written twice: give each output a file of its own")
        if source is not None and place.exists() and source.resolve() in (place, *place.parents):
            raise ValueError(f"{targets[k]} belongs to {source}, which is read: give the output another name")
