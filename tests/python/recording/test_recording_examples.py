"""The examples in the docstrings of the recordings' modules run."""

import doctest
import importlib
import pkgutil

import pytest

import granular_id.io
import granular_id.recording

MODULES = [
    f"{package.__name__}.{module.name}"
    for package in (granular_id.recording, granular_id.io)
    for module in pkgutil.iter_modules(package.__path__)
]


@pytest.mark.parametrize("name", MODULES)
def test_examples_run(name):
    assert doctest.testmod(importlib.import_module(name)).failed == 0


def test_there_are_examples():
    found = doctest.DocTestFinder()
    names = [
        test.name for name in MODULES for test in found.find(importlib.import_module(name)) if test.examples
    ]
    assert len(names) >= 8
