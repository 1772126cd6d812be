"""The version is the same in every file that states it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
VERSIONS = {
    "CHANGELOG.md": r"^## \[(\d.+?)\]",
    "CITATION.cff": r"^version: (.+)$",
    "LICENSE-THIRD-PARTY.yml": r"^- package_name: granular-id\n  package_version: (.+)$",
    "contrib/conda/recipe.yaml": r'^  version: "(.+)"$',
    "contrib/pyproject.toml": r'^version = "(.+)"$',
    "docs/reference/citing.md": r"version = \{(.+?)\}",
    "tests/fuzz/Cargo.lock": r'^name = "granular-id"\nversion = "(.+)"$',
}


def first(path: str, pattern: str) -> str:
    return re.findall(pattern, (ROOT / path).read_text(encoding="utf-8"), flags=re.MULTILINE)[0]


@pytest.mark.parametrize("path", VERSIONS)
def test_version_in_every_file_equals_that_of_the_crate(path):
    assert first(path, VERSIONS[path]) == first("Cargo.toml", r'^version = "(.+)"$')
