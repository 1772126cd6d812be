"""scipy's own tests of these functions, run against the twins."""

import importlib
import importlib.util
import inspect
import re
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy.signal import butter as scipy_butter, sos2tf

from granular_id import signal as twins

pytestmark = pytest.mark.thread_unsafe(reason="replaces functions of scipy's test modules")

SOSFILT = [
    "test_rank1",
    "test_rank2",
    "test_rank3",
    "test_initial_conditions",
    "test_initial_conditions_2",
    "test_initial_conditions_3d_axis1",
    "test_bad_zi_shape",
    "test_sosfilt_zi",
    "test_sosfilt_zi_2",
]
BUTTER = ["test_degenerate", "test_basic", "test_highpass", "test_bandpass", "test_bandstop", "test_fs_param"]


def scipys_tests(name: str, request: pytest.FixtureRequest) -> ModuleType:
    module = f"scipy.signal.tests.{name}"
    try:
        source = Path(importlib.util.find_spec(module).origin).read_text(encoding="utf-8")
        # scipy's suite has marks of its own, which are unknown here.
        for mark in {
            *re.findall(r"mark\.(\w+)", source),
            "skip_xp_backends",
            "uses_xp_capabilities",
            "xfail_xp_backends",
        }:
            request.config.addinivalue_line("markers", f"{mark}: used by scipy's own tests")
        return importlib.import_module(module)
    except (ImportError, AttributeError) as error:
        pytest.skip(f"this scipy comes without its tests, or they need something missing: {error}")


def run(module: ModuleType, class_name: str, test: str, **arguments: str) -> None:
    case = getattr(module, class_name)()
    if not hasattr(case, test):
        pytest.skip(f"this scipy has no {class_name}.{test}")
    method = getattr(case, test)
    if "xp" in inspect.signature(method).parameters:
        from scipy._lib._array_api import array_namespace

        arguments["xp"] = array_namespace(np.empty(0))
    method(**arguments)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("test", SOSFILT)
def test_sosfilt(test, dtype, request, monkeypatch):
    module = scipys_tests("test_signaltools", request)
    calls = []
    for name in ("sosfilt", "sosfilt_zi"):
        monkeypatch.setattr(module, name, counted(getattr(twins, name), calls))
    run(module, "TestSOSFilt", test, dt=dtype)
    assert calls


@pytest.mark.parametrize("test", BUTTER)
def test_butter(test, request, monkeypatch):
    module = scipys_tests("test_filter_design", request)
    calls = []
    twin = counted(twins.butter, calls)

    def butter(N, Wn, btype="low", analog=False, output="ba", fs=None):
        # Analog filters and order 0 are not made here; other forms are derived from the sections.
        if analog or N == 0:
            return scipy_butter(N, Wn, btype, analog=analog, output=output, fs=fs)
        sos = twin(N, Wn, btype, fs=fs)
        n_roots = N if np.size(Wn) == 1 else 2 * N
        return zpk(sos, n_roots) if output == "zpk" else tuple(c[: n_roots + 1] for c in sos2tf(sos))

    monkeypatch.setattr(module, "butter", butter)
    run(module, "TestButter", test)
    assert calls


def counted(function, calls):
    def call(*args, **kwargs):
        calls.append(args)
        return function(*args, **kwargs)

    return call


def zpk(sos, n_roots):
    """Zeros, poles and gain, with double roots found exactly (numpy.roots splits them by 1e-8)."""
    zeros = [root for row in sos for root in quadratic_roots(row[:3] / row[0])]
    poles = [root for row in sos for root in quadratic_roots(row[3:])]
    # An odd order is filled up with one root at the origin on both sides.
    for roots in (zeros, poles):
        if len(roots) > n_roots:
            roots.remove(0)
    # Zeros at DC first, as scipy lists them.
    z, p = np.array(sorted(zeros, key=lambda root: -root.real)), np.array(poles)
    return (z.real if not z.imag.any() else z), p, sos[0, 0]


def quadratic_roots(coefficients):
    _, c1, c2 = coefficients
    root = np.sqrt(complex(c1 * c1 - 4 * c2))
    large = (-c1 - root) / 2 if c1 > 0 else (-c1 + root) / 2
    return [large, c2 / large if large else 0j]
