"""No two files of the Rust core import each other, not even by way of others: read from their ``use`` lines.

A folder's own file may use what lies in it, and what lies in it may use that file; a name that a file passes on
(``pub use``) counts for the file it comes from.
"""

from __future__ import annotations

import re
from graphlib import TopologicalSorter
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    Module = tuple[str, ...]

RUST = Path(__file__).parents[2] / "rust"

USE = re.compile(r"^\s*(pub(?:\([a-z ]+\))? )?use ([^;]+);", re.MULTILINE)
TESTS = re.compile(r"\n#\[cfg\(.*\btest\b.*\)\]\nmod ")


def paths(tree: str, before: Module = ()) -> Iterator[Module]:
    """Yield each name of a use tree: ``a::{b, c::d}`` has a::b and a::c::d."""
    tree = tree.strip()
    group = re.fullmatch(r"((?:\w+::)*)\{(.*)\}", tree, re.DOTALL)
    if not group:
        yield (*before, *re.sub(r"\s+as\s+\w+$", "", tree).split("::"))
        return
    before = (*before, *(name for name in group[1].split("::") if name))
    depth, start = 0, 0
    inner = group[2] + ","
    for place, character in enumerate(inner):
        depth += {"{": 1, "}": -1}.get(character, 0)
        if character == "," and depth == 0:
            if inner[start:place].strip():
                yield from paths(inner[start:place], before)
            start = place + 1


def imports(sources: Mapping[Module, str]) -> dict[Module, set[Module]]:
    """Which modules each one uses, beside those inside it."""
    used: dict[Module, set[Module]] = {module: set() for module in sources}
    passed_on: dict[Module, Module] = {}
    for module, text in sources.items():
        code = TESTS.split(re.sub(r"//.*", "", text))[0]
        for is_public, tree in USE.findall(code):
            for path in paths(tree):
                if path[0] == "crate":
                    full = path[1:]
                elif path[0] == "super":
                    n_up = len(path) - len([name for name in path if name != "super"])
                    full = module[: len(module) - n_up] + path[n_up:]
                elif (*module, path[0]) in sources:
                    full = module + path
                else:
                    continue
                used[module].add(full)
                if is_public:
                    passed_on[(*module, full[-1])] = full

    def defined_in(path: Module) -> Module:
        while path not in sources:
            parent = max((path[:n] for n in range(len(path)) if path[:n] in sources), key=len)
            name = path[: len(parent) + 1]
            if passed_on.get(name, path) == path:
                return parent
            path = passed_on[name] + path[len(name) :]
        return path

    targets = {module: {defined_in(path) for path in found} for module, found in used.items()}
    return {module: {to for to in found if to[: len(module)] != module} for module, found in targets.items()}


def sources(folder: Path) -> dict[Module, str]:
    files = {path.relative_to(folder).with_suffix("").parts: path for path in folder.rglob("*.rs")}
    return {
        parts[:-1] if parts[-1] in {"lib", "mod"} else parts: path.read_text(encoding="utf-8")
        for parts, path in files.items()
        if folder != RUST or parts[0] not in {"c", "python"}
    }


@pytest.mark.parametrize("folder", [RUST, RUST / "python", RUST / "c"], ids=["core", "python", "c"])
def test_no_files_of_rust_import_each_other(folder):
    TopologicalSorter(imports(sources(folder))).prepare()  # or CycleError, which names the circle
