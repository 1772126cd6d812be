"""The examples in the docstrings, those of the gallery, and the first lines that a new wheel runs, do what they say."""

import doctest
import importlib
import os
import pkgutil
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

import granular_id

EXAMPLES = Path(__file__).parents[2] / "examples"
MODULES = [
    module.name
    for module in pkgutil.walk_packages(granular_id.__path__, "granular_id.")
    if not module.name.endswith(("._core", ".__main__"))
]


@pytest.mark.parametrize("name", MODULES)
def test_examples_of_the_docstrings(name):
    assert doctest.testmod(importlib.import_module(name)).failed == 0


def test_there_are_examples():
    found = [
        example for name in MODULES for example in doctest.DocTestFinder().find(importlib.import_module(name))
    ]
    assert sum(bool(example.examples) for example in found) > 100


def test_the_first_lines_name_a_push(capsys):
    runpy.run_path(str(EXAMPLES / "first_lines.py"))
    assert capsys.readouterr().out.splitlines()[-1] == "a push through rice is named rice"


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("[0-9]_*.py")), ids=lambda path: path.stem)
def test_an_example_of_the_gallery_runs_without_a_warning(path, tmp_path, pytestconfig):
    pytest.importorskip("matplotlib", reason="figures need matplotlib")
    # Errors, but where pytest was told otherwise: the oldest matplotlib warns by itself.
    warnings = [f"-W{kind}" for kind in pytestconfig.getini("filterwarnings")]
    environment = {**os.environ, "MPLBACKEND": "agg"}
    subprocess.run([sys.executable, *warnings, path], cwd=tmp_path, env=environment, check=True, timeout=300)
