"""Runs a page: its Python and its commands in their order, held to the output that stands behind them."""

from __future__ import annotations

import contextlib
import io
import re
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Any

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
