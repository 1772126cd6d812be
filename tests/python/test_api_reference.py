"""Every public name stands on exactly one page of the API reference, and nothing else does."""

import importlib
import re
import runpy
from collections import Counter
from pathlib import Path

import granular_id

PAGES = Path(__file__).parents[2] / "docs" / "reference" / "api"
ORACLE = runpy.run_path(str(Path(__file__).with_name("golden") / "oracle.py"))


def public():
    """A name that granular_id has itself counts there only."""
    names = {f"granular_id.{name}" for name in granular_id.__all__}
    for package in filter(None, ORACLE["PACKAGES"]):
        module = importlib.import_module(f"granular_id{package}")
        for name in module.__all__:
            if getattr(granular_id, name, None) is not getattr(module, name):
                names.add(f"granular_id{package}.{name}")
    return names


def test_every_public_name_stands_on_one_page():
    text = "\n".join(page.read_text(encoding="utf-8") for page in sorted(PAGES.glob("*.rst")))
    tables = re.findall(r"^\.\. autosummary::\n(?:   :.*\n)*\n((?:   .+\n)+)", text, flags=re.MULTILINE)
    shown = [f"granular_id.{name}" for table in tables for name in table.split()]
    shown += re.findall(r"^\.\. (?:automodule|py:data):: (\S+)", text, flags=re.MULTILINE)
    assert [name for name, count in Counter(shown).items() if count > 1] == []
    assert set(shown) == public()
