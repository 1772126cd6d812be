"""The package as a whole: what it exports, what importing it costs, what it offers where an extra is missing."""

import re
import shlex
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, requires

import pytest

import granular_id
from granular_id._text import install


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


@pytest.mark.parametrize(("extra", "library"), [("app", "matplotlib"), ("hdf5", "h5py"), ("ros", "rosbags")])
def test_install_names_the_libraries_of_an_extra(extra, library):
    words = shlex.split(install(extra))
    assert words[:2] == ["pip", "install"]
    names = [re.split("[<>=~! ]", word)[0] for word in words[2:]]
    assert library in names
    assert not any(name.startswith("granular") for name in names)


def test_a_copy_that_nobody_installed_names_the_extra(monkeypatch):
    def nothing(_):
        raise PackageNotFoundError

    monkeypatch.setattr("importlib.metadata.requires", nothing)
    assert install("app") == "see the extra 'app' in pyproject.toml"
