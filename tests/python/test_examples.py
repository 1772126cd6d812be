"""Examples in docstrings and the first lines of a new wheel do what they say; `make docs` runs the gallery."""

import doctest
import importlib
import pkgutil
import runpy
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


def test_the_first_lines_name_a_push(capsys):
    runpy.run_path(str(EXAMPLES / "first_lines.py"))
    assert capsys.readouterr().out.splitlines()[-1] == "a push through rice is named rice"
