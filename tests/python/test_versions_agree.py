"""Versions agree: that of the package in every file that states it, and those of what it needs."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

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


def test_requirements_pin_what_pyproject_admits():
    project = pytest.importorskip("tomllib").loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    groups = project["project"]["optional-dependencies"] | project["dependency-groups"]
    groups["core"] = project["project"]["dependencies"]
    pins: dict[str, list[str]] = {}
    for line in (ROOT / "requirements.txt").read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            name, _, version = line.partition(" ;")[0].partition("==")
            pins.setdefault(canonicalize_name(name), []).append(version)
    for name in ("core", "app", "hdf5", "dask", "ros", "dev", "docs", "release"):
        for wanted in map(Requirement, groups[name]):
            versions = pins.get(canonicalize_name(wanted.name), ["none"])
            assert all(wanted.specifier.contains(version) for version in versions), f"{wanted}: {versions}"
