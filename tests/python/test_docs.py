"""The pages are true: their examples run, their links and commands exist."""

from __future__ import annotations

import re
import runpy
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import typer.main

from cli_cases import ended_well
from granular_id.cli.app import app
from granular_id.identifier import Identifier
from granular_id.io import save
from granular_id.io.formats import FORMATS
from granular_id.recording import SampleFlag
from granular_id.synthetic import synthesize

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
EVERY = [*PAGES, ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
BLOCK = re.compile(r"```(\w*)\n(.*?)```", re.DOTALL)


def of(page):
    return str(page.relative_to(ROOT))


def text_of(page):
    return page.read_text(encoding="utf-8")


def blocks(page, language):
    return [text for kind, text in BLOCK.findall(text_of(page)) if kind == language]


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """What the examples read: a small set of simulated pushes."""
    data = synthesize(["rice", "fine sugar"], n_per_class=3)
    return save(data, tmp_path_factory.mktemp("docs") / "recordings", "csv")


def run_examples(page, folder, monkeypatch):
    """Run what stands on a page as one program, in a folder; every warning is an error."""
    program = folder / "page.py"
    program.write_text("\n".join(blocks(page, "python")), encoding="utf-8")
    monkeypatch.chdir(folder)
    return runpy.run_path(str(program), run_name="__main__")


def commands_on(page):
    """The commands of a page in order: the words behind the name of the program."""
    lines = "".join(blocks(page, "")).splitlines()
    return [shlex.split(line, comments=True)[1:] for line in lines if line.startswith("granular-id ")]


def test_the_readme_runs_in_an_empty_folder_as_it_is_printed(tmp_path):
    """A process each, as they are typed; commands of other pages run in this one."""
    for words in commands_on(ROOT / "README.md"):
        command = [sys.executable, "-m", "granular_id", *words]
        ran = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=300)
        assert ran.returncode == 0, f"{words}\n{ran.stdout}\n{ran.stderr}"
    assert {"drives.html", "drives.npz", "drives.safetensors", "answers.png"} <= {
        path.name for path in tmp_path.iterdir()
    }


TUTORIAL = DOCS / "tutorial.md"
SAND = DOCS / "sand.md"


def test_the_tutorial_runs_in_an_empty_folder_as_it_is_printed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for words in commands_on(TUTORIAL):
        ended_well(*words)
    run_examples(TUTORIAL, tmp_path, monkeypatch)


def test_the_commands_about_archives_run(tmp_path, monkeypatch):
    """Those that need no cluster, with recordings of another day to name."""
    for library in ("pyarrow", "distributed"):
        pytest.importorskip(library)
    data = synthesize(["rice", "fine sugar"], n_per_class=6, duration_s=0.5)
    fresh = synthesize(["rice", "fine sugar"], n_per_class=6, duration_s=0.5, seed=1)
    Identifier.fit(data, "hfmh", estimate=False, progress=False).save(tmp_path / "kitchen.safetensors")
    save(fresh, tmp_path / "recordings", "csv")
    monkeypatch.chdir(tmp_path)
    printed = "".join(ended_well(*words) for words in commands_on(DOCS / "scale.md"))
    assert "12 recordings, 2 materials" in printed
    assert "Materials named in 12" in printed


@pytest.mark.parametrize(
    "page", [page for page in PAGES if page not in (TUTORIAL, SAND) and blocks(page, "python")], ids=of
)
def test_examples_run(page, recordings, tmp_path, monkeypatch):
    for library in ("h5py", "pyarrow", "rosbags", "mcap", "matplotlib"):
        pytest.importorskip(library)
    (tmp_path / "recordings").symlink_to(recordings)
    run_examples(page, tmp_path, monkeypatch)


@pytest.mark.data
def test_the_page_about_sand_prints_what_it_says(data_dir, tmp_path, monkeypatch, capsys):
    pytest.importorskip("rosbags")
    (tmp_path / "sand_press").symlink_to(data_dir / "sand_press")
    run_examples(SAND, tmp_path, monkeypatch)
    assert capsys.readouterr().out == "".join(blocks(SAND, "text"))


def test_rules_are_applied_to_models_of_any_number_of_materials(tmp_path, monkeypatch):
    data = synthesize(["rice", "fine sugar", "cat litter"], n_per_class=4, duration_s=1.0)
    save(data, tmp_path / "recordings", "csv")
    run_examples(DOCS / "confidence.md", tmp_path, monkeypatch)


def test_the_example_of_the_readme_prints_what_it_says(tmp_path, monkeypatch, capsys):
    run_examples(ROOT / "README.md", tmp_path, monkeypatch)
    lines = capsys.readouterr().out.splitlines()
    assert lines[:2] == ["(60, 1600, 6)", "(60, 10200) hfmh_fx_00"]
    assert lines[-1] == "rice"


@pytest.mark.parametrize("page", EVERY, ids=of)
def test_links_lead_somewhere(page):
    links = re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", text_of(page))
    assert [link for link in links if not (page.parent / link).exists()] == []


COMMAND = typer.main.get_command(app)


def commands_of(group):
    for command in group.commands.values():
        yield from commands_of(command) if hasattr(command, "commands") else [command]


HELPS = {
    f"{command.callback.__module__}.{command.callback.__qualname__}": command.help
    for command in commands_of(COMMAND)
}


@pytest.mark.parametrize("text", [*map(text_of, EVERY), *HELPS.values()], ids=[*map(of, EVERY), *HELPS])
def test_commands_exist_with_their_options(text):
    """Every line that begins with granular-id, in a block or between backquotes, names what there is."""
    lines = [line for _, block in BLOCK.findall(text) for line in block.splitlines()]
    lines += re.findall(r"`(granular-id [^`]*)`", BLOCK.sub("", text))
    for line in lines:
        if not line.strip().startswith("granular-id "):
            continue
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
    assert {"demo", "test", "bench-peers"} <= named
    assert all(re.search(rf"^{target}:", makefile, flags=re.MULTILINE) for target in named)


def test_every_format_has_a_page():
    pages = {"npy": "npz", "mat": "matlab"}
    for known in FORMATS:
        page = DOCS / "formats" / f"{pages.get(known.name, known.name)}.md"
        assert page.is_file(), known.name
        assert page.name in text_of(DOCS / "formats" / "README.md")


def test_bits_of_flags_are_those_documented():
    text = text_of(DOCS / "formats" / "csv.md")
    for flag in SampleFlag:
        assert f"{flag.value} {flag.name.lower().replace('_', ' ')}" in text
    assert np.log2([flag.value for flag in SampleFlag]).tolist() == [0, 1, 2, 3]
