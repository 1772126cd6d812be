"""Digests of what must not change: results to the bit, and the public names.

Before a change: ``python tests/python/golden/oracle.py write FILE``; after it: ``... compare FILE``; ``--only`` takes
some sections. Both on one machine, with the same libraries: linear algebra may round otherwise elsewhere. The real
recordings count where they are (see conftest.py). What bad files end in stands in ``corpus/table.jsonl``.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib
import inspect
import json
import os
import re
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

import granular_id as gid

Figures = dict[str, Any]

VOLATILE = {"versions", "command", "wall_s", "seconds", "machine"}
"""What differs from run to run, or names the run."""
PACKAGES = [
    "", ".archive", ".confidence", ".evaluation", ".explanation", ".identifier", ".io", ".live", ".plotting",
    ".recording", ".report", ".signal", ".spaces", ".synthetic", ".testing",
]  # fmt: skip
"""Whose names are public, the package itself first."""
MATERIALS = ("rice", "fine sugar", "oat flakes", "cat litter")


def digest(value: Any) -> str:
    """Return a short SHA-256 of an array, bytes, or what JSON can hold."""
    if isinstance(value, np.ndarray):
        value = str((value.dtype, value.shape)).encode() + np.ascontiguousarray(value).tobytes()
    if not isinstance(value, bytes):
        value = json.dumps(steady(value), sort_keys=True, default=str).encode()
    return hashlib.sha256(value).hexdigest()[:16]


def steady(value: Any) -> Any:
    """Leave out what differs from run to run."""
    if isinstance(value, dict):
        return {
            key: steady(one)
            for key, one in value.items()
            if key not in VOLATILE and not str(key).endswith("seconds")
        }
    return [steady(one) for one in value] if isinstance(value, list) else value


def parts(prefix: str, value: Any) -> Figures:
    """Digest the entries of a result one by one, so that a difference says where it is."""
    return {f"{prefix}.{key}": digest(one) for key, one in steady(value).items()}


def sets() -> Iterator[tuple[str, gid.Dataset]]:
    """Yield recordings in three sessions, and real ones of six materials at 100 Hz, where they are."""
    yield "synthetic", gid.synthesize(MATERIALS, n_per_class=12, sessions=3, seed=5)
    folder = Path(os.environ.get("GRANULAR_ID_DATA", "."), "sliding_wrench")
    if not folder.is_dir():
        print("no real recordings: those figures are left out", file=sys.stderr)
        return
    chosen = gid.load(folder).select(labels=["mat01", "mat03", "mat07", "mat10", "mat13", "mat20"])
    yield "sliding", chosen.resample(100, max_gap_s=float("inf")).align("shortest")


def api() -> Figures:
    """Signatures of all public names."""
    figures = {}
    for package in PACKAGES:
        module = importlib.import_module(f"granular_id{package}")
        names = getattr(module, "__all__", None) or [name for name in dir(module) if not name.startswith("_")]
        for name in names:
            value = getattr(module, name)
            if package and getattr(gid, name, None) is value:
                continue  # reported already
            place = f"gid{package}.{name}"
            figures[place] = signature(value)
            if inspect.isclass(value):
                figures |= {
                    f"{place}.{member}": signature(getattr(value, member))
                    for member in dir(value)
                    if not member.startswith("_") and own(value, member)
                }
    return figures


def own(kind: type, member: str) -> bool:
    """Tell whether a class of this library defines a member: those of others change with their versions."""
    return next(base for base in kind.__mro__ if member in vars(base)).__module__.startswith("granular_id")


def signature(value: Any) -> str:
    """Return what can be called with, or the kind of value."""
    try:
        return re.sub(" at 0x[0-9a-f]+", "", str(inspect.signature(value)))
    except (TypeError, ValueError):
        return type(value).__name__


def features() -> Figures:
    """Features of every space."""
    figures = {}
    for name, data in sets():
        figures[f"{name} X"] = digest(data.X)
        for space, made in gid.feature_spaces(rate_hz=data.rate_hz).items():
            estimator = made.transformer
            if space == "pca+rica":
                estimator.set_params(rica__random_state=0)
            with warnings.catch_warnings(), threadpool_limits(1):
                warnings.simplefilter("ignore")  # rica does not converge, as in the paper
                figures[f"{name} {space}"] = digest(np.asarray(estimator.fit_transform(data.X, data.y)))
    return figures


def evaluation() -> Figures:
    """Folds, predictions and statistics, for each way to hold out."""
    figures = {}
    spaces = ["raw", "hfmh", "raw+hfmh", "multiband", "best"]
    ways: tuple[dict[str, Any], ...] = (
        *({"by": by} for by in ("auto", "session", "time", "random")),
        {"paper": (3, 8, 3)},
    )
    for name, data in sets():
        for way in ways:
            try:
                found = gid.evaluate(data, spaces, random_state=3, progress=False, **way).to_dict()
            except ValueError as error:  # a set without sessions
                found = {"refused": str(error)}
            figures |= parts(f"{name} {way}", json.loads(json.dumps(found)))
    return figures


def confidence() -> Figures:
    """What the study of confidence finds."""
    figures = {}
    for name, data in sets():
        figures |= parts(name, gid.confidence_study(data).to_dict())
    return figures


def identifier() -> Figures:
    """Model files, scores and answers."""
    figures = {}
    for name, data in sets():
        for space in ("raw+hfmh", "multiband", "best"):
            model = gid.Identifier.fit(data, space, progress=False)
            with tempfile.TemporaryDirectory() as place:
                path = Path(place) / "model.safetensors"
                model.save(path)
                content = path.read_bytes()
            header = json.loads(content[8 : 8 + int.from_bytes(content[:8], "little")])
            about = header.pop("__metadata__")
            tensors = content[8 + int.from_bytes(content[:8], "little") :]
            figures[f"{name} {space} tensors"] = digest(tensors)
            figures[f"{name} {space} layout"] = digest(header)
            known = json.loads(about.pop("trained"))
            figures |= parts(f"{name} {space} trained", known)
            figures |= parts(f"{name} {space} metadata", about)
            figures[f"{name} {space} scores"] = digest(model.scores(data.X))
            answers = [(d.label, d.candidates, d.unknown, d.margin) for d in map(model.identify, data)]
            figures[f"{name} {space} answers"] = digest(answers)
    return figures


def commands() -> Figures:
    """What the commands write, and their exit codes."""
    figures = {}

    def run(what: str, *arguments: str) -> None:
        command = [sys.executable, "-m", "granular_id", *arguments]
        figures[f"{what} exit"] = str(subprocess.run(command, capture_output=True, check=False).returncode)

    with tempfile.TemporaryDirectory() as here:
        pushes, model = f"{here}/set.npz", f"{here}/m.safetensors"
        gid.save(next(sets())[1], pushes)
        run("check", "data", "check", pushes, "--json", f"{here}/check.json")
        few = ("--paper", "2,6,2", "--spaces", "raw,hfmh")
        run("evaluate", "evaluate", pushes, *few, "--json", f"{here}/evaluate.json")
        run("train", "train", pushes, "-o", model, "--space", "hfmh")
        run("identify", "identify", model, pushes, "--json", f"{here}/identify.json")
        run("refused", "evaluate", f"{here}/nothing")
        for file in sorted(Path(here).glob("*.json")):
            figures |= parts(file.stem, {"whole": json.loads(file.read_text().replace(here, "HERE"))})
    return figures


PARTS = (api, features, evaluation, confidence, identifier, commands)
SECTIONS: dict[str, Callable[[], Figures]] = {section.__name__: section for section in PARTS}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("work", choices=("write", "compare"))
    parser.add_argument("file", type=Path)
    parser.add_argument("--only", default=",".join(SECTIONS), help="sections: %(default)s")
    given = parser.parse_args()
    figures = {name: SECTIONS[name]() for name in given.only.split(",")}
    if given.work == "write":
        given.file.write_text(json.dumps(figures, indent=1, sort_keys=True) + "\n")
        return 0
    stored = json.loads(given.file.read_text())
    lines = [
        f"{section}: {name}: {before.get(name, 'was not there')} -> {now.get(name, 'is gone')}"
        for section, now in figures.items()
        for before in [stored.get(section, {})]
        for name in sorted(before.keys() | now.keys())
        if before.get(name) != now.get(name)
    ]
    print("\n".join(lines) or f"equal: {sum(map(len, figures.values()))} figures")
    return bool(lines)


if __name__ == "__main__":
    sys.exit(main())
