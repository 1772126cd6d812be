"""Callers that do what they should not: arrays that change while they are read, sizes that no memory holds.

The cases of a test share a process of their own, which names each, and must live on.
"""

import os
import sys

import pytest

from core_cases import printed_by

pytestmark = [
    pytest.mark.thread_unsafe(reason="starts processes"),
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits memory, reads /proc"),
]

BEGIN = """
import resource, tempfile, warnings
from pathlib import Path
import numpy as np
import granular_id as gid
from granular_id import _core
from granular_id.live import WrenchBuffer

SPEC = gid.FeatureSpec(hfmh=False)

def limit(room_mb=600):
    size = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (size + room_mb * 10**6, resource.RLIM_INFINITY))

def full():
    buffer = WrenchBuffer(2000.0)
    buffer.push_block(np.zeros((10**6, 6)))
    return buffer

def model(coef, n_samples=100, n_axes=3, classes=("a", "b"), codes=((1,), (-1,))):
    intercept = np.zeros(len(coef))
    return _core.Model(SPEC, coef, intercept, codes, classes, n_samples=n_samples, n_axes=n_axes)

def low_pass(order):
    return _core.butter(order, "lowpass", 1.0, 0.0, 10.0)

def case(name):
    print(name, flush=True)
"""

SHRINK = """
tried = []

def shrink(*_, **__):
    tried.append(True)
    X.resize((1, 1, 1), refcheck=False)

class Number:
    def __index__(self):
        shrink()
        return 1

class Array:
    def __init__(self, *shape):
        self.shape = shape
    def __array__(self, dtype=None, copy=None):
        shrink()
        return np.zeros(self.shape)
    def __len__(self):
        return self.shape[0]

class Names(list):
    def __iter__(self):
        shrink()
        return super().__iter__()

class Flags(np.ndarray):
    @property
    def flags(self):
        shrink()
        return super().flags
    base = flags
"""

CALLS = """
case({name!r})
tried.clear()
X = np.zeros((2000, 100, 3))
try:
    {call}
except (ValueError, TypeError):
    pass
assert tried
"""

CHANGED = {
    "threads of multi-band features": "_core.MultiBandExtractor(100, 3).extract(X, Number())",
    "threads of sizes of bands": "_core.MultiBandExtractor(100, 3).band_rms(X, threads=Number())",
    "threads of features": "_core.extract_features(X, SPEC, Number())",
    "a warning": "X = np.zeros((1, 10, 200_000)); warnings.showwarning = shrink;"
    "_core.extract_features(X, SPEC, None)",
    "threads of scores": "model(np.zeros((1, 300))).scores(X, Number())",
    "classes of a model": "X = np.zeros((1, 1 << 20)); model(X, 1 << 20, 1, Names('ab'))",
    "another array of a model": "X = np.zeros((1, 1 << 20)); model(X, 1 << 20, 1, codes=Array(2, 1))",
    "times of rows": "X = np.zeros((100_000, 6)); WrenchBuffer(1000.0).push_block(X, Array(100_000))",
    "bins of a histogram": "X = np.zeros(1 << 20); _core.histogram(X, Number(), -1.0, 1.0)",
    "nothing of a subclass": "out = np.empty((2000, 300)).view(Flags); out.flags;"
    "_core.extract_features(X, SPEC, None, out); assert len(tried) == 1",
}

LIMITED = """
case({name!r})
limit()
try:
    {call}
except MemoryError as error:
    assert str(error)
else:
    raise AssertionError("there was memory enough")
"""

TOO_LARGE = {
    "multi-band features": "_core.MultiBandExtractor(100, 6).extract(np.zeros((3_000_000, 1, 6)))",
    "scores": "model(np.ones((10**5, 1)), 1, 1, codes=np.tile([[1], [-1]], 10**5)).scores(np.zeros((10**7, 1, 1)))",
    "losses": "codes = np.repeat([[1], [-1]], (1, 1023), axis=0);"
    "model(np.ones((1, 1)), 1, 1, list(map(str, range(1024))), codes).losses(np.zeros((10**5, 1)))",
    "a filter": "_core.sosfilt(low_pass(32), np.zeros((1, 4_000_000)), 0, None)",
    "a stream": "gid.StreamingExtractor(gid.FeatureSpec(n_bins=1), n_samples=1, n_axes=1 << 24)",
    "rows for a buffer": "X, t = np.zeros((10**7, 6)), np.zeros(10**7); limit(50); WrenchBuffer(1.0).push_block(X, t)",
    "rows of a buffer": "buffer = full(); limit(20); buffer.reader(from_oldest=True).read()",
    "a window of a buffer": "buffer = full(); limit(20); buffer.window(10**6)",
    "a buffer": "limit(50); WrenchBuffer(20000.0)",
    "weights of a model": "large = model(np.ones((1, 1 << 22)), 1 << 20, 4); limit(20); large.coef",
    "a model": "X = np.ones((1, 1 << 22)); limit(20); model(X, 1 << 20, 4)",
    "a stream of a model": "large = model(np.ones((1, 1 << 22)), 1 << 20, 4); limit(20);"
    "_core.StreamingIdentifier(large)",
    "features of a stream": "stream = gid.StreamingExtractor(SPEC, n_samples=1 << 20, n_axes=4); limit(20);"
    "stream.features()",
    "bytes of a model": "large = model(np.ones((1, 1 << 22)), 1 << 20, 4); limit(20); large.to_bytes()",
    "a file of a model": "file = Path(tempfile.mkdtemp(), 'model');"
    "file.write_bytes(model(np.ones((1, 1 << 22)), 1 << 20, 4).to_bytes()); limit(10);"
    "_core.Model.read(file, max_file_bytes=1 << 30)",
}

ABSURD = """
case({name!r})
MANY = 1 << 62
FAR = np.broadcast_to(0.0, (1 << 45, 6))
try:
    {call}
except (MemoryError, ValueError) as error:
    assert str(error)
else:
    raise AssertionError("done")
"""

WITHOUT_LIMIT = {
    "recordings": "gid.extract_features(FAR)",
    "scores": "model(np.ones((6, 1)), 1, 1, codes=np.tile([[1], [-1]], 6)).losses(FAR)",
    "a signal": "_core.sosfilt(low_pass(2), FAR, 0, None)",
    "bins": "_core.histogram([0.0], MANY, -1.0, 1.0)",
    "ranges": "gid.FeatureSpec(bin_range=FAR[:, :2])",
    "n_features": "gid.FeatureSpec().n_features(MANY, MANY)",
    "a stream": "gid.StreamingExtractor(SPEC, n_samples=MANY, n_axes=MANY)",
    "rows of a stream": "gid.StreamingExtractor(SPEC).push(FAR)",
    "multi-band features": "_core.MultiBandExtractor(MANY, MANY)",
    "no samples": "_core.MultiBandExtractor(100, 6).extract(np.empty((10**12, 0, 6)))",
    "a buffer": "WrenchBuffer(1e300)",
    "a window": "WrenchBuffer().window(MANY)",
    "rows of a buffer": "WrenchBuffer().push_block(FAR)",
}


def lives_on(begin, template, cases):
    """Run the cases one after the other: each is named before its turn, and the process ends as it should."""
    program = BEGIN + begin + "".join(template.format(name=name, **case) for name, case in cases.items())
    # A fixed threshold: memory that was freed goes back to the system, and is no room for the next case.
    environment = {"OPENBLAS_NUM_THREADS": "1", "MALLOC_MMAP_THRESHOLD_": "131072"}
    assert printed_by(program, **os.environ | environment).splitlines() == list(cases)


def test_arrays_that_shrink_while_they_are_read():
    """Whatever comes of it, an answer or an error: no memory that is not there is read."""
    lives_on(SHRINK, CALLS, {name: {"call": call} for name, call in CHANGED.items()})


def test_sizes_for_which_there_is_no_memory():
    lives_on("", LIMITED, {name: {"call": call} for name, call in TOO_LARGE.items()})


def test_sizes_that_no_machine_has():
    lives_on("", ABSURD, {name: {"call": call} for name, call in WITHOUT_LIMIT.items()})
