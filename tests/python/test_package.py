"""The package as a whole: what it exports, what importing it costs, what it offers where an extra is missing."""

import re
import shlex
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, requires

import pytest

import granular_id
from granular_id._text import install
from model_cases import random_model


def test_everything_exported_exists():
    for name in granular_id.__all__:
        assert getattr(granular_id, name) is not None
    assert set(granular_id.__all__) <= set(dir(granular_id))


def test_unknown_names_are_attribute_errors():
    with pytest.raises(AttributeError, match="'granular_id' has no attribute 'nonsense'"):
        _ = granular_id.nonsense


IMPORTS = """
import sys, numpy as np, granular_id as gid
def loaded(*names):
    return [name for name in sys.modules if name.startswith(names)]
wrench = np.zeros((16, 6))
gid.extract_features(wrench)
model = gid.Identifier.load(sys.argv[1])
stream = gid.StreamingIdentifier(model)
stream.push(wrench)
assert stream.decision() == model.identify(wrench)
assert not loaded("sklearn", "scipy", "matplotlib", "typer"), "to extract and to identify"
import granular_id.evaluation
assert not loaded("granular_id.plotting"), "to evaluate"
import granular_id.plotting
assert not loaded("matplotlib"), "to import what plots"
granular_id.plotting.plot_recordings(gid.Dataset.from_arrays([wrench], ["a"], rate_hz=10))
assert not loaded("matplotlib.pyplot"), "to plot"
"""


@pytest.mark.thread_unsafe(reason="starts a process")
def test_libraries_are_loaded_where_they_are_needed(tmp_path):
    granular_id.Identifier(random_model(0, 3, 16, 6)).save(tmp_path / "m.safetensors")
    subprocess.run([sys.executable, "-c", IMPORTS, tmp_path / "m.safetensors"], check=True, timeout=300)


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
