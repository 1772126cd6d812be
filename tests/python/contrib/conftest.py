"""The adapters, as if their package were installed: with its entry points."""

import sys
from pathlib import Path

import pytest

CONTRIB = Path(__file__).resolve().parents[3] / "contrib"


@pytest.fixture(autouse=True)
def installed(tmp_path, monkeypatch):
    tomllib = pytest.importorskip("tomllib", reason="Python 3.11 reads TOML")
    project = tomllib.loads((CONTRIB / "pyproject.toml").read_text("utf-8"))["project"]
    folder = tmp_path / f"granular_id_contrib-{project['version']}.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text(f"Name: {project['name']}\nVersion: {project['version']}\n", "utf-8")
    lines = []
    for group, points in project["entry-points"].items():
        lines += [f"[{group}]", *(f"{name} = {target}" for name, target in points.items())]
    (folder / "entry_points.txt").write_text("\n".join(lines), "utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr("granular_id.live.push._QUIET_S", 20.0)  # a busy machine must not fail a test
    assert str(CONTRIB) in sys.path
