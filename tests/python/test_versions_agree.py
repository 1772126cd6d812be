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
    "LICENSE-THIRD-PARTY.yml": r"^- package_name: granular-id\n  package_version: (.+)$",
    "contrib/conda/recipe.yaml": r'^  version: "(.+)"$',
    "contrib/pyproject.toml": r'^version = "(.+)"$',
    "docs/reference/citing.md": r"version = \{(.+?)\}",
    "tests/fuzz/Cargo.lock": r'^name = "granular-id"\nversion = "(.+)"$',
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


def test_wheels_are_built_by_one_maturin():
    hosted, pinned = ".github/workflows/wheels.yml", "requirements-release.txt"
    assert stated(hosted, r"maturin-version: v(.+)$") == stated(pinned, r"^maturin==(.+)$")


def test_the_oldest_compiler_is_that_of_the_manifest():
    oldest = stated("Cargo.toml", r'^rust-version = "(.+)"$')
    places = {
        ".github/workflows/tests.yml": r'rust: "(\d.+)"$',
        "Makefile": r"needs (?:a Rust toolchain, |Rust )(\d\.\d+)",
        "README.md": r"Rust (\d\.\d+) or later",
        "docs/install.md": r"Rust (\d\.\d+) or later",
        "docs/reference/versions.md": r"Rust (\d\.\d+), or later",
        "rust/README.md": r"Rust (\d\.\d+) or later",
    }
    assert {path: stated(path, pattern) for path, pattern in places.items()} == dict.fromkeys(places, oldest)


def test_the_hosted_checks_lint_and_build_with_one_compiler():
    lint = stated(".github/workflows/tests.yml", r'RUSTUP_TOOLCHAIN: "(.+)"$')
    assert lint == stated(".github/workflows/wheels.yml", r'(?:RUSTUP_TOOLCHAIN|rust-toolchain): "(.+)"$')


def test_the_recipe_for_conda_forge_asks_for_what_the_package_does():
    lines = (ROOT / "pyproject.toml").read_text(encoding="utf-8").splitlines()
    asked = " ".join(line for line in lines if line.startswith(("requires = ", "dependencies = ", "app = ")))
    wanted = dict(re.findall(r'"([\w-]+)([>=<.,\d]+)"', asked))
    recipe = (ROOT / "contrib/conda/recipe.yaml").read_text(encoding="utf-8")
    found = {
        name.removesuffix("-base"): bound
        for name, bound in re.findall(r"^    - ([\w-]+) ([>=<.,\d]+)$", recipe, re.M)
    }
    assert found == wanted
