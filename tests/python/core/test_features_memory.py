"""Memory: a batch takes its input, its output and little more, and calls leave nothing behind.

Each measurement has a process of its own, whose peak nothing else has raised.
``GRANULAR_ID_CALLS=1000000 pytest tests/python/core/test_features_memory.py`` makes 50 times as many small calls.
"""

import json
import os
import sys

import pytest

from core_cases import printed_by

pytestmark = [
    pytest.mark.thread_unsafe(reason="starts processes"),
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc"),
]

MB = 1e6
N_CALLS = int(os.environ.get("GRANULAR_ID_CALLS", "20000"))

STATUS = """
import json, sys
import numpy as np
import granular_id as gid

def status(name):
    for line in open("/proc/self/status"):
        if line.startswith(name):
            return 1024 * int(line.split()[1])

def numbers(shape):
    wrench = np.empty(shape)
    np.random.default_rng(0).standard_normal(out=wrench)
    return wrench
"""

PEAK = """
shape, options = json.loads(sys.argv[1])
for warm in (3, 40):
    gid.extract_features(numbers((warm, 20, shape[-1])), **options)
wrench = numbers(shape)
before = status("VmRSS")
features = gid.extract_features(wrench, **options)
print(json.dumps({"input": wrench.nbytes, "output": features.nbytes, "more": status("VmHWM") - before}))
"""

CALLS = """
n_calls, = json.loads(sys.argv[1])
one, batch = numbers((30, 6)), numbers((5, 30, 6))
bad = batch.copy()
bad[3, 2, 1] = np.nan
spec = gid.FeatureSpec(n_bins=10)
out = np.empty((5, 240))

def refused(call, *args, **keywords):
    try:
        call(*args, **keywords)
    except (TypeError, ValueError):
        return
    raise AssertionError("not refused")

def calls(n):
    for i in range(n // 10):
        gid.extract_features(one)
        gid.extract_features(one[::2], n_bins=10)
        gid.extract_features(one.astype(np.float32), spec=spec)
        gid.extract_features(batch, spec=spec, threads=1, out=out)
        gid.extract_features(batch, spec=spec, threads=2 + i % 2, dtype=np.float32)
        gid.feature_names(spec, n_samples=30)
        repr(gid.FeatureSpec(bin_range=[(-1, 1)] * 6))
        refused(gid.extract_features, bad, threads=2)
        refused(gid.extract_features, one, out=out)
        refused(gid.FeatureSpec, cutoff_hz=300)

calls(2000)
before = status("VmRSS")
calls(n_calls)
print(json.dumps(status("VmRSS") - before))
"""


def measured(program, *arguments):
    return json.loads(printed_by(STATUS + program, json.dumps(arguments)))


@pytest.mark.parametrize(
    ("shape", "options"),
    [
        ((400, 1600, 6), {"threads": 1}),
        ((400, 1600, 6), {"threads": 2, "n_bins": 3000}),
        ((900_000, 6), {}),
        ((200_000, 1, 25), {"threads": 2, "raw": False, "n_bins": 2}),
    ],
    ids=str,
)
def test_a_batch_takes_its_input_its_output_and_little_more(shape, options):
    got = measured(PEAK, shape, options)
    assert got["more"] > 0.95 * got["output"]  # or the peak was there before, and nothing is measured
    assert got["more"] - got["output"] < 20 * MB


def test_calls_leave_nothing_behind():
    assert measured(CALLS, N_CALLS) < 0.4 * MB
