"""What a folder of partitions holds: its manifest, written last, and the reader that takes it at its word."""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ClassVar

from granular_id._files import durable_file
from granular_id._text import counted
from granular_id.archive.work import VERSION, Outcome
from granular_id.io.errors import naming, need
from granular_id.io.parquet.archive import Archive

MANIFEST = "_manifest.json"
"""Begins with a line, so that pandas and pyarrow read the folder as one table without it."""
PARTITION = re.compile(r"[0-9a-f]{32}\.parquet")

_FORMAT = "granular-id partitions"


def write_manifest(
    folder: Path, archive: Archive, spec: str, outcomes: Sequence[Outcome], synthetic: bool
) -> str:
    """Write down what is there, the last thing that is done; return the digest over all partitions."""
    made = [outcome for outcome in outcomes if not outcome.problem]
    lines = "".join(f"{outcome.sha256} {outcome.name}\n" for outcome in made)
    sha256 = hashlib.sha256(lines.encode()).hexdigest()
    manifest = {
        "format": _FORMAT,
        "version": VERSION,
        "spec": json.loads(spec),
        "archive": archive.fingerprint,
        "synthetic": synthetic,
        "n_recordings": sum(outcome.n_recordings for outcome in made),
        "sha256": sha256,
        "partitions": [
            {key: getattr(outcome, key) for key in ("name", "n_recordings", "n_bytes", "sha256")}
            for outcome in made
        ],
        "failures": [
            {key: getattr(outcome, key) for key in ("name", "n_recordings", "problem")}
            for outcome in outcomes
            if outcome.problem
        ],
    }
    text = json.dumps(manifest, ensure_ascii=False, allow_nan=False, indent=1) + "\n"
    with durable_file(folder / MANIFEST) as draft:
        draft.write_text(text, encoding="utf-8")
    return sha256


def read_manifest(folder: Path) -> dict[str, Any]:
    """Read what a folder says that it holds; FileNotFoundError or ValueError where it says nothing of the kind."""
    path = folder / MANIFEST
    try:
        said: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        _check_manifest(said)
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        problem = f"{error} is missing" if isinstance(error, KeyError) else error
        raise ValueError(f"{path} is no manifest of partitions: {problem}") from error
    return said


def _check_manifest(said: dict[str, Any]) -> None:
    if said["format"] != _FORMAT or said["version"] != VERSION:
        raise ValueError(f"wanted {_FORMAT!r}, version {VERSION}")
    for known in said["partitions"]:
        wanted = {"n_recordings": int, "n_bytes": int, "sha256": str}
        typed = all(isinstance(known[key], kind) for key, kind in wanted.items())
        if not typed or not PARTITION.fullmatch(known["name"]):
            raise ValueError(f"partition {known['name']!r:.80}")
    missing = {"spec", "n_recordings", "sha256", "failures"} - said.keys()
    if missing:
        raise ValueError(f"{min(missing)!r} is missing")


class Partitions:
    """Reads what is in a folder with a manifest, one partition after the other."""

    holds: ClassVar[str]
    """What the partitions hold, as the manifest names it."""
    again: ClassVar[str]
    """What makes the partitions that are missing."""

    spec: Mapping[str, Any]
    n_recordings: int
    sha256: str

    def __init__(self, folder: str | os.PathLike[str], *, partial: bool = False) -> None:
        self.folder = Path(folder)
        if not self.folder.is_dir():
            raise FileNotFoundError(f"{self.folder}: no such folder")
        try:
            manifest = read_manifest(self.folder)
        except FileNotFoundError:
            path = self.folder / MANIFEST
            raise FileNotFoundError(
                f"{path}: no such file, the {self.holds} are not finished: {self.again}"
            ) from None
        self.spec, self.sha256 = manifest["spec"], str(manifest["sha256"])
        work = self.spec["work"]
        if self.holds not in work:
            raise ValueError(f"{self.folder} holds no {self.holds}, but {', '.join(work)}")
        failures = manifest["failures"]
        if failures and not partial:
            raise ValueError(
                f"{self.folder}: {counted(len(failures), 'partition')} failed, the first is {failures[0]['name']} "
                f"({failures[0]['problem']:.200}): {self.again}, or take what there is by partial=True"
            )
        self.n_recordings, self._n_failed = int(manifest["n_recordings"]), len(failures)
        self._synthetic = bool(manifest.get("synthetic"))
        self._files = tuple(str(known["name"]) for known in manifest["partitions"])
        if not self._files:
            raise ValueError(f"{self.folder} holds no partition: all of them failed")
        for known in manifest["partitions"]:
            path = self.folder / known["name"]
            if not path.is_file() or path.stat().st_size != known["n_bytes"]:
                raise ValueError(f"{path} is gone or cut off: remove it, and {self.again}")

    def __len__(self) -> int:
        return self.n_recordings

    @contextmanager
    def _opened(self, file: str) -> Iterator[Any]:
        """Open a partition as a pyarrow.parquet.ParquetFile that verifies checksums."""
        library = need("pyarrow.parquet", extra="app", why="to work on archives")
        path = self.folder / file
        with (
            naming(path, f"reading {self.holds} (remove it, and {self.again})"),
            library.ParquetFile(path, page_checksum_verification=True) as opened,
        ):
            yield opened
