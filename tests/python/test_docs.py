"""Pages run as they are printed, docstrings and the first lines of a new wheel, too; `make docs` runs the gallery."""

from __future__ import annotations

import doctest
import importlib
import pkgutil
import runpy
import shutil
from pathlib import Path

import pytest

import granular_id
from cli_cases import ended_well
from pages import blocks_of, run_page, words_of

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
