"""Names that have moved still work, and say where they are."""

import importlib

import pytest

import granular_id as gid


@pytest.mark.parametrize(
    ("module", "name"), [("best", "BestClassifier"), ("selection", "select"), ("selection", "Selection")]
)
def test_a_name_that_moved_warns_and_works(module, name):
    old = importlib.import_module(f"granular_id.{module}")
    with pytest.warns(DeprecationWarning, match=f"granular_id.{module} has moved: use granular_id"):
        assert getattr(old, name) is getattr(gid, name)
    with pytest.raises(AttributeError, match="no attribute 'other'"):
        _ = old.other
