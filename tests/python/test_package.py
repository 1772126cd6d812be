"""The package as a whole: what it exports, and what importing it costs."""

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
