"""The filter against scipy's: any order, band, signal, axis and state must give the same bits.

``GRANULAR_ID_CASES=100000 pytest tests/python/core/test_signal_properties.py -k campaign -s`` runs the long
campaign and prints how many numbers were compared.
"""

import platform

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy import signal as scipy_signal

from effort import cases
from features_twin import a_wrench
from granular_id.signal import butter, sosfilt, sosfilt_zi

BANDS = ("lowpass", "highpass", "bandpass", "bandstop")
ON_X86 = platform.machine() in {"x86_64", "AMD64"}


def differing_bits(got, wanted):
    """How many float64 values differ; NaN equals NaN."""
    assert got.shape == wanted.shape
    if not ON_X86:  # scipy may be compiled with fused operations
        np.testing.assert_allclose(got, wanted, rtol=1e-9, atol=1e-12)
        return 0
    got, wanted = np.ascontiguousarray(got), np.ascontiguousarray(wanted)
    same = (got.view(np.uint64) == wanted.view(np.uint64)) | (np.isnan(got) & np.isnan(wanted))
    return int(np.count_nonzero(~same))


@st.composite
def designs(draw):
    order = draw(st.integers(1, 32))
    band = draw(st.sampled_from(BANDS))
    edges = sorted(draw(st.lists(st.floats(0.02, 0.98), min_size=2, max_size=2, unique=True)))
    if band in BANDS[:2]:
        return order, edges[0], band
    return order, [edges[0], max(edges[1], edges[0] + 0.01)], band


@given(designs())
@settings(max_examples=60, deadline=None)
def test_butter_equals_scipy(design):
    order, edges, band = design
    wanted = scipy_signal.butter(order, edges, band, output="sos")
    got = butter(order, edges, band)
    assert got.shape == wanted.shape
    if np.ndim(edges) and abs(sum(edges) - 1) < 1e-9:
        return  # poles equally far from the unit circle: see the next test
    for half in (slice(0, 3), slice(3, 6)):
        scale = np.abs(wanted[:, half]).max(axis=1, keepdims=True)
        assert np.all(np.abs(got - wanted)[:, half] <= 1e-11 * scale)


@pytest.mark.parametrize("band", BANDS[2:])
@pytest.mark.parametrize("order", [1, 2, 3, 8, 17, 32])
def test_symmetric_bands_are_scipys_but_for_section_order(order, band):
    edges = [0.3, 0.7]
    got, wanted = butter(order, edges, band), scipy_signal.butter(order, edges, band, output="sos")
    frequencies = np.linspace(0.05, 3.1, 500)
    got_response = scipy_signal.sosfreqz(got, frequencies)[1]
    wanted_response = scipy_signal.sosfreqz(wanted, frequencies)[1]
    np.testing.assert_allclose(got_response, wanted_response, rtol=1e-9, atol=1e-12)
    for row in wanted[:, 3:]:
        assert np.abs(got[:, 3:] - row).sum(axis=1).min() < 1e-12  # every pair of poles is there


@given(st.integers(1, 16), st.floats(0.02, 0.98))
@settings(max_examples=50, deadline=None)
def test_sosfilt_zi_equals_scipy(order, edge):
    sos = scipy_signal.butter(order, edge, output="sos")
    wanted = scipy_signal.sosfilt_zi(sos)
    # A state may be zero but for rounding, which differs between processors.
    np.testing.assert_allclose(sosfilt_zi(sos), wanted, rtol=1e-9, atol=1e-15 * np.abs(wanted).max())


def a_signal(rng, shape):
    """As of the features, or with gaps, huge numbers and negative zeros."""
    kind = rng.integers(8)
    if kind > 2:
        return a_wrench(rng, (1, *shape))[0]
    x = rng.standard_normal(shape)
    if kind == 0:
        x[rng.random(shape) < 0.02] = rng.choice([np.nan, np.inf, -np.inf])
    return x if kind == 0 else x * 10.0 ** rng.integers(200, 307) if kind == 1 else -np.zeros(shape)


def a_case(rng):
    """Sections, a signal of rank 1 to 3, an axis, and a state or None."""
    band = BANDS[rng.integers(4)]
    low, high = np.sort(rng.uniform(0.02, 0.98, 2))
    edges = low if band in BANDS[:2] else [low, max(high, low + 0.01)]
    sos = scipy_signal.butter(rng.integers(1, 33), edges, band, output="sos")
    shape = [rng.integers(1, 200), *rng.integers(1, 12, rng.integers(0, 3))]
    axis = int(rng.integers(-len(shape), len(shape)))
    shape[0], shape[axis] = shape[axis], shape[0]
    zi = None
    if rng.random() < 0.5:
        zi_shape = [len(sos), *shape]
        zi_shape[axis % len(shape) + 1] = 2
        zi = rng.standard_normal(zi_shape)
    return sos, a_signal(rng, shape), axis, zi


def test_sosfilt_campaign_has_the_bits_of_scipy():
    n_cases = cases(200)
    rng = np.random.default_rng(20240326)
    compared = differing = 0
    with np.errstate(all="ignore"):
        for _ in range(n_cases):
            sos, x, axis, zi = a_case(rng)
            got, wanted = sosfilt(sos, x, axis, zi=zi), scipy_signal.sosfilt(sos, x, axis, zi)
            pairs = [(got, wanted)] if zi is None else zip(got, wanted, strict=True)
            for ours, theirs in pairs:
                compared += ours.size
                differing += differing_bits(ours, theirs)
    print(f"sosfilt against scipy: {n_cases} cases, {compared} values, {differing} differing")
    assert compared > n_cases
    assert differing == 0
