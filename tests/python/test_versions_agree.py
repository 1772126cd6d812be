"""What several files state is the same in each: the version, pins of tools, the largest wheel."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def stated(path, pattern):
    """What a pattern finds in a file, once for each different find."""
    found = re.findall(pattern, (ROOT / path).read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert found, f"{path} has no {pattern}"
    return {text.replace("_", "") for text in found}


VERSIONS = {
    "CITATION.cff": r"^version: (.+)$",
    "contrib/conda/recipe.yaml": r'^  version: "(.+)"$',
    "contrib/pyproject.toml": r'^version = "(.+)"$',
    "docs/reference/citing.md": r"version = \{(.+?)\}",
}


@pytest.mark.parametrize("path", VERSIONS)
def test_every_file_has_the_version_of_the_crate(path):
    assert stated(path, VERSIONS[path]) == stated("Cargo.toml", r'^version = "(.+)"$')


def test_the_changelog_has_a_section_for_the_version():
    assert stated("Cargo.toml", r'^version = "(.+)"$') <= stated("CHANGELOG.md", r"^## \[(\d.+?)\]")


@pytest.mark.parametrize("tool", ["ruff", "zizmor"])
def test_hooks_have_the_tools_of_make_lint(tool):
    newest = rf'^{tool}==([\d.]+)(?:; python_version >= ".+")?$'
    assert stated(".pre-commit-config.yaml", rf"\[{tool}==(.+?)\]") == stated("requirements-dev.txt", newest)


def test_wheels_are_built_by_one_maturin_and_have_one_limit():
    hosted, pinned = ".github/workflows/wheels.yml", "requirements-release.txt"
    assert stated(hosted, r"maturin-version: v(.+)$") == stated(pinned, r"^maturin==(.+)$")
    assert stated(hosted, r"-size \+(\d+)c") == stated("tests/wheels.py", r"^LIMIT_BYTES = ([\d_]+)$")
