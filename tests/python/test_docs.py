"""Pages run as they are printed, docstrings and the first lines of a new wheel, too; `make docs` runs the gallery."""

from __future__ import annotations

import contextlib
import doctest
import importlib
import io
import pkgutil
import re
import runpy
import shlex
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

import granular_id
from cli_cases import ended_well

NOT_RUN = ("", "bibtex", "cmake", "cpp", "matlab", "rust")
"""Kinds of blocks that no test runs here: files, entries, other languages."""
BLOCK = re.compile(
    r"^(?:<!-- not run: (?P<reason>[^>]+) -->\n+)?```(?P<kind>[^\n`]*)\n(?P<text>.*?)^```$", re.M | re.S
)


@dataclass(frozen=True)
class Block:
    """What stands between two fences: ``python`` and ``sh`` run, ``text`` right behind them is what they print."""

    kind: str
    text: str
    line: int
    reason: str | None  # why it does not run
    behind: bool  # nothing stands between it and the block before


def blocks_of(page: Path) -> list[Block]:
    text = page.read_text(encoding="utf-8")
    blocks, end = [], 0
    for found in BLOCK.finditer(text):
        line = text.count("\n", 0, found.start("text"))
        behind = not text[end : found.start()].strip()
        blocks.append(Block(found["kind"], found["text"], line, found["reason"], behind))
        end = found.end()
    return blocks


def words_of(block: Block) -> list[list[str]]:
    lines = block.text.replace("\\\n", " ").splitlines()
    return [shlex.split(line, comments=True) for line in lines if line.strip() and not line.startswith("#")]


def run_block(block: Block, page: Path, names: dict[str, Any]) -> str:
    """What a block prints; Python blocks of a page share their names."""
    if block.kind == "sh":
        printed = ""
        for program, *words in words_of(block):
            assert program == "granular-id", f"{page}:{block.line} runs {program}: say why it is not run"
            printed += ended_well(*words, columns=100)
        return printed
    with contextlib.redirect_stdout(io.StringIO()) as out:
        exec(compile("\n" * block.line + block.text, str(page), "exec", dont_inherit=True), names)
    return out.getvalue()


def assert_printed(printed: str, wanted: str, place: str) -> None:
    """Line by line; a line of ``...`` stands for any lines."""
    lines = [re.escape(line.rstrip()) for line in wanted.rstrip().splitlines()]
    pattern = "\n".join(r"(?:.*\n)*?.*" if line == r"\.\.\." else line for line in lines)
    got = "\n".join(line.rstrip() for line in printed.rstrip().splitlines())
    assert re.fullmatch(pattern, got), f"{place} says\n{wanted}\nbut what ran printed\n{got}"


def run_page(page: Path) -> None:
    """Run a page in the working directory."""
    names: dict[str, Any] = {"__name__": "__main__"}
    printed = None
    for block in blocks_of(page):
        if block.kind in ("python", "sh"):
            printed = None if block.reason else run_block(block, page, names)
            continue
        if block.kind == "text":
            place = f"{page}:{block.line}"
            printed = printed if block.behind else None
            assert printed is not None, f"{place} is no output of a block that ran"
            assert_printed(printed, block.text, place)
        else:
            known = block.kind in NOT_RUN or block.kind.startswith("{")
            assert known, f"{page}:{block.line} is of no known kind: {block.kind}"
        printed = None


ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
BUILT = {"_build", "gallery", "generated"}
PAGES = sorted(page for page in DOCS.rglob("*.md") if not BUILT & set(page.relative_to(DOCS).parts))
EVERY = [*PAGES, *(ROOT / f"{name}.md" for name in ("README", "CONTRIBUTING", "SECURITY"))]
BAGS = DOCS / "formats" / "ros.md"
RUN = [page for page in EVERY if any(block.kind in ("python", "sh") for block in blocks_of(page))]
EMPTY = [
    ROOT / "README.md",
    DOCS / "tutorial.md",
    DOCS / "guide" / "index.md",
]  # these make all that they need


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """What the examples read, as docs/guide/index.md says how to make it."""
    folder = tmp_path_factory.mktemp("docs") / "recordings"
    block = next(block for block in blocks_of(DOCS / "guide" / "index.md") if block.kind == "sh")
    (words,) = words_of(block)
    ended_well(*[folder if word == "recordings" else word for word in words[1:]])
    return folder


@pytest.mark.parametrize("page", RUN, ids=lambda page: str(page.relative_to(ROOT)))
def test_pages_run_as_they_are_printed(page, request, tmp_path, monkeypatch):
    for library in ("h5py", "pyarrow", "rosbags", "mcap", "matplotlib", "distributed"):
        pytest.importorskip(library)
    if page not in EMPTY:
        shutil.copytree(request.getfixturevalue("recordings"), tmp_path / "recordings")
    if page == BAGS:
        shutil.copy(ROOT / "tests" / "data" / "ros" / "bag" / "bag.mcap", tmp_path / "rice_1.mcap")
    monkeypatch.chdir(tmp_path)
    run_page(page)


MODULES = [
    module.name
    for module in pkgutil.walk_packages(granular_id.__path__, "granular_id.")
    if not module.name.endswith(("._core", ".__main__"))
]


@pytest.mark.parametrize("name", MODULES)
def test_examples_of_the_docstrings(name):
    assert doctest.testmod(importlib.import_module(name)).failed == 0


def test_the_first_lines_name_a_push(capsys):
    runpy.run_path(str(ROOT / "examples" / "first_lines.py"))
    assert capsys.readouterr().out.splitlines()[-1] == "a push through rice is named rice"
