"""The public names and signatures are those that were stored: a change of them is made knowingly.

After a change that the changelog names, here: ``python golden/oracle.py write golden/public.json --only api``.
"""

from __future__ import annotations

import json
import runpy
import sys
from pathlib import Path

import pytest

GOLDEN = Path(__file__).with_name("golden")


@pytest.mark.skipif(
    sys.version_info[:2] != (3, 11), reason="other versions of Python write signatures otherwise"
)
def test_public_names_and_signatures_are_the_stored_ones():
    oracle = runpy.run_path(str(GOLDEN / "oracle.py"))
    stored = json.loads((GOLDEN / "public.json").read_text(encoding="utf-8"))["api"]
    assert oracle["differences"](stored, oracle["api"]()) == []
