"""The pages are true: their examples run, their links and commands exist."""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
import typer.main

from cli_cases import ended_well
from granular_id.cli.app import app
from granular_id.io.formats import FORMATS
from granular_id.recording import SampleFlag
from pages import blocks_of, run_page, words_of

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
BUILT = {"_build", "gallery", "generated"}
PAGES = sorted(page for page in DOCS.rglob("*.md") if not BUILT & set(page.relative_to(DOCS).parts))
EVERY = [*PAGES, *(ROOT / f"{name}.md" for name in ("README", "python/README", "CONTRIBUTING", "SECURITY"))]
LINKED = [
    *EVERY,
    *(ROOT / f"{name}.md" for name in ("CHANGELOG", "CODE_OF_CONDUCT", "contrib/README", "rust/README")),
]
SAND = DOCS / "guide" / "sand.md"
BAGS = DOCS / "formats" / "ros.md"
RUN = [page for page in EVERY if any(block.kind in ("python", "sh") for block in blocks_of(page))]
EMPTY = [
    ROOT / "README.md",
    DOCS / "tutorial.md",
    DOCS / "guide" / "index.md",
]  # these make all that they need


def of(page):
    return str(page.relative_to(ROOT))


def text_of(page):
    return page.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """What the examples read, as docs/guide/index.md says how to make it."""
    folder = tmp_path_factory.mktemp("docs") / "recordings"
    block = next(block for block in blocks_of(DOCS / "guide" / "index.md") if block.kind == "sh")
    (words,) = words_of(block)
    ended_well(*[folder if word == "recordings" else word for word in words[1:]])
    return folder


@pytest.mark.parametrize(
    "page", [pytest.param(page, marks=[pytest.mark.data] * (page == SAND), id=of(page)) for page in RUN]
)
def test_pages_run_as_they_are_printed(page, request, tmp_path, monkeypatch):
    for library in ("h5py", "pyarrow", "rosbags", "mcap", "matplotlib", "distributed"):
        pytest.importorskip(library)
    if page not in EMPTY:
        shutil.copytree(request.getfixturevalue("recordings"), tmp_path / "recordings")
    if page == BAGS:
        shutil.copy(ROOT / "tests" / "data" / "ros" / "bag" / "bag.mcap", tmp_path / "rice_1.mcap")
    if page == SAND:
        (tmp_path / "sand_press").symlink_to(request.getfixturevalue("data_dir") / "sand_press")
    monkeypatch.chdir(tmp_path)
    run_page(page)


def test_little_of_what_stands_there_does_not_run():
    blocks = [block for page in RUN for block in blocks_of(page) if block.kind in ("python", "sh")]
    left_out = [block for block in blocks if block.reason]
    assert len(left_out) < len(blocks) / 4


def places_of(page):
    """The anchors of its headings, as the hosting site and myst make them."""
    headings = re.findall(r"^#+ (.+)$", re.sub(r"^```.*?^```$", "", text_of(page), flags=re.M | re.S), re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", LINKED, ids=of)
def test_links_lead_somewhere(page):
    """Those to the gallery, which the site makes, are checked by `make docs`."""
    broken = []
    for link, path, place in re.findall(r"\]\((([^)#:]*)#?([^)]*))\)", text_of(page)):
        target = page.parent / path if path else page
        if ":" in link or "/gallery/" in link:
            continue
        if not target.exists() or (place and place not in places_of(target)):
            broken.append(link)
    assert broken == []


COMMAND = typer.main.get_command(app)


def commands_of(group):
    for command in group.commands.values():
        yield from commands_of(command) if hasattr(command, "commands") else [command]


HELPS = {
    f"{command.callback.__module__}.{command.callback.__qualname__}": command.help
    for command in commands_of(COMMAND)
}


@pytest.mark.parametrize("text", [*map(text_of, LINKED), *HELPS.values()], ids=[*map(of, LINKED), *HELPS])
def test_commands_exist_with_their_options(text):
    """Every line that begins with granular-id, in a block or between backquotes, names what there is."""
    joined = text.replace("\\\n", " ")
    lines = [line for line in joined.splitlines() if line.startswith("granular-id ")]
    lines += re.findall(r"`(granular-id [^`]*)`", joined)
    for line in lines:
        words = shlex.split(line.partition("#")[0])[1:]
        command = COMMAND
        while words and hasattr(command, "commands") and not words[0].startswith("-"):
            assert words[0] in command.commands, line
            command = command.commands[words.pop(0)]
        known = {
            name for parameter in command.params for name in (*parameter.opts, *parameter.secondary_opts)
        }
        used = [word.partition("=")[0] for word in words if re.match(r"--?[a-zA-Z]", word)]
        assert [word for word in used if word not in known | {"--help"}] == [], line


def test_every_command_has_examples_in_its_help():
    assert len(HELPS) == len([*commands_of(COMMAND)]) > 20
    assert [name for name, text in HELPS.items() if "Examples:" not in text] == []


def test_make_targets_of_the_readme_exist():
    makefile = text_of(ROOT / "Makefile")
    named = set(re.findall(r"\bmake ([a-z-]+)", text_of(ROOT / "README.md")))
    assert {"demo", "docs", "test"} <= named
    assert all(re.search(rf"^{target}:", makefile, flags=re.MULTILINE) for target in named)


def test_every_format_has_a_page():
    pages = {"npy": "npz", "mat": "matlab"}
    for known in FORMATS:
        page = DOCS / "formats" / f"{pages.get(known.name, known.name)}.md"
        assert page.is_file(), known.name
        assert page.name in text_of(DOCS / "formats" / "index.md")


def test_bits_of_flags_are_those_documented():
    text = text_of(DOCS / "formats" / "csv.md")
    for flag in SampleFlag:
        assert f"{flag.value} {flag.name.lower().replace('_', ' ')}" in text
    assert np.log2([flag.value for flag in SampleFlag]).tolist() == [0, 1, 2, 3]
