"""Samples and labels in trees of named arrays, for the tests of their layouts."""

from pathlib import Path

import numpy as np

from granular_id.io.arrays.layouts import recordings_of
from granular_id.io.options import LoadOptions
from granular_id.io.source import FileSource
from granular_id.recording import Dataset

_RNG = np.random.default_rng(1)
X = _RNG.normal(size=(4, 50, 6))
RAGGED = [_RNG.normal(size=(n, 6)) for n in (50, 40, 60, 50)]
LABELS = ["rice", "peas", "rice", "oats"]
SOURCE = FileSource.alone(Path("set.mat"))


def read_tree(tree, source=SOURCE, **settings):
    content = recordings_of(tree, source, LoadOptions(**settings), "variable")
    return Dataset(content.recordings), content.notes
