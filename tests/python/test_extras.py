"""What is said of libraries that are not there can be typed, and works however the package was installed."""

import re
import shlex
from importlib.metadata import PackageNotFoundError

import pytest

from granular_id._text import install


@pytest.mark.parametrize(("extra", "library"), [("app", "matplotlib"), ("hdf5", "h5py"), ("ros", "rosbags")])
def test_the_libraries_of_an_extra_are_named_by_themselves(extra, library):
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
