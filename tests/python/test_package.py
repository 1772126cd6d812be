"""The package as a whole: what it exports, what has moved, and what importing it costs."""

import importlib
import subprocess
import sys
from importlib.metadata import requires

import pytest

import granular_id


def test_everything_exported_exists():
    for name in granular_id.__all__:
        assert getattr(granular_id, name) is not None
    assert set(granular_id.__all__) <= set(dir(granular_id))


def test_unknown_names_are_attribute_errors():
    with pytest.raises(AttributeError, match="'granular_id' has no attribute 'nonsense'"):
        _ = granular_id.nonsense


@pytest.mark.parametrize(
    ("module", "name"), [("best", "BestClassifier"), ("selection", "select"), ("selection", "Selection")]
)
def test_a_name_that_moved_warns_and_works(module, name):
    old = importlib.import_module(f"granular_id.{module}")
    with pytest.warns(DeprecationWarning, match=f"granular_id.{module} has moved: use granular_id"):
        assert getattr(old, name) is getattr(granular_id, name)
    with pytest.raises(AttributeError, match="no attribute 'other'"):
        _ = old.other


def test_extracting_does_not_load_scikit_learn():
    script = (
        "import sys, numpy, granular_id\n"
        "granular_id.extract_features(numpy.zeros((16, 6)))\n"
        "sys.exit(bool({'sklearn', 'scipy', 'matplotlib', 'typer'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", script], check=False, timeout=60).returncode == 0


def test_a_plain_install_needs_numpy_and_scikit_learn_only():
    needed = [line for line in requires("granular-id") or [] if "extra ==" not in line]
    assert sorted(line.split(">")[0] for line in needed) == ["numpy", "scikit-learn"]


def test_axes_and_units_are_those_of_the_core():
    assert granular_id.AXES == ("fx", "fy", "fz", "tx", "ty", "tz")
    assert granular_id.UNITS == ("N", "N", "N", "N m", "N m", "N m")
