"""The pages are true: their examples run, their links and commands exist."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import typer.main

from granular_id.cli.app import app
from granular_id.io import save
from granular_id.synthetic import synthesize

ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "docs").rglob("*.md"))
EVERY = [*PAGES, ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
BLOCK = re.compile(r"```(\w*)\n(.*?)```", re.DOTALL)


def of(page):
    return str(page.relative_to(ROOT))


def blocks(page, language):
    return [text for kind, text in BLOCK.findall(page.read_text(encoding="utf-8")) if kind == language]


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """What the examples read: a small set of simulated pushes under the name that the pages use."""
    folder = tmp_path_factory.mktemp("docs")
    save(synthesize(["rice", "fine sugar"], n_per_class=3), folder / "recordings", "csv")
    return folder


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page, "python")], ids=of)
def test_examples_run(page, files, tmp_path_factory):
    for library in ("h5py", "pyarrow", "rosbags", "mcap", "matplotlib"):
        pytest.importorskip(library)
    folder = tmp_path_factory.mktemp(page.stem)
    (folder / "recordings").symlink_to(files / "recordings")
    text = "\n".join(blocks(page, "python"))
    run = subprocess.run(
        [sys.executable, "-W", "error", "-c", text],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
        cwd=folder,
    )
    assert run.returncode == 0, run.stderr


def test_rules_are_applied_to_models_of_any_number_of_materials(tmp_path):
    save(synthesize(["rice", "fine sugar", "cat litter"], n_per_class=4), tmp_path / "recordings", "csv")
    text = "\n".join(blocks(ROOT / "docs" / "confidence.md", "python"))
    subprocess.run([sys.executable, "-W", "error", "-c", text], check=True, timeout=120, cwd=tmp_path)


@pytest.mark.parametrize("page", EVERY, ids=of)
def test_links_lead_somewhere(page):
    links = re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8"))
    assert [link for link in links if not (page.parent / link).exists()] == []


@pytest.mark.parametrize("page", EVERY, ids=of)
def test_commands_exist_with_their_options(page):
    """Every line that begins with granular-id, in a block or between backquotes, names what there is."""
    text = page.read_text(encoding="utf-8")
    lines = [line for _, block in BLOCK.findall(text) for line in block.splitlines()]
    lines += re.findall(r"`(granular-id [^`]*)`", BLOCK.sub("", text))
    for line in lines:
        if not line.strip().startswith("granular-id "):
            continue
        words = shlex.split(line.partition("#")[0])[1:]
        command = typer.main.get_command(app)
        while words and hasattr(command, "commands") and not words[0].startswith("-"):
            assert words[0] in command.commands, line
            command = command.commands[words.pop(0)]
        known = {
            name for parameter in command.params for name in (*parameter.opts, *parameter.secondary_opts)
        }
        used = [word.partition("=")[0] for word in words if re.match(r"--?[a-zA-Z]", word)]
        assert [word for word in used if word not in known | {"--help"}] == [], line


def test_every_format_has_a_page():
    from granular_id.io.formats import FORMATS

    pages = {"npy": "npz", "mat": "matlab"}
    for known in FORMATS:
        page = ROOT / "docs" / "formats" / f"{pages.get(known.name, known.name)}.md"
        assert page.is_file(), known.name
        assert page.name in (ROOT / "docs" / "formats" / "README.md").read_text(encoding="utf-8")


def test_bits_of_flags_are_those_documented():
    from granular_id.recording import SampleFlag

    text = (ROOT / "docs" / "formats" / "csv.md").read_text(encoding="utf-8")
    for flag in SampleFlag:
        assert f"{flag.value} {flag.name.lower().replace('_', ' ')}" in text
    assert np.log2([flag.value for flag in SampleFlag]).tolist() == [0, 1, 2, 3]
