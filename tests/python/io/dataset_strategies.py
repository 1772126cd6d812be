"""Data sets of every kind that a file must give back bit for bit, for hypothesis; and how to compare them."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from granular_id._checks import OVERRIDES
from granular_id.recording import Dataset, Recording, SampleFlag, StepReport

_FINITE = st.floats(allow_nan=False, allow_infinity=False)
_TEXT = st.text(
    st.characters(blacklist_categories=("Cc", "Cs", "Zl", "Zp"), blacklist_characters=OVERRIDES), max_size=8
)
_LABEL = _TEXT.map(str.strip).filter(bool)
_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | _FINITE | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)
_UNITS = st.dictionaries(
    st.sampled_from(["fx", "force", "mx", "WX [V]"]), st.sampled_from(["mN", "a,b", "[", "\u00b5T"])
)
_META = st.dictionaries(st.text(max_size=5), _JSON, max_size=3)


@st.composite
def recordings(draw, axes=None):
    n_axes = 6 if axes is None else len(axes)
    n = draw(st.integers(1, 6))
    clock = {"rate_hz": draw(st.sampled_from([500.0, 62.5, 1e-3, 1 / 3]))}
    if draw(st.booleans()):
        spread = draw(
            st.sampled_from([0, 1e-6, 1e-3, 1, 1e4])
        )  # from even, which a reader takes for a rate, to wild
        steps = draw(st.lists(st.floats(0, 1), min_size=n - 1, max_size=n - 1))
        clock = {"time_s": np.cumsum([0.0, *(0.002 * (1 + spread * step) for step in steps)])}
    flags = hnp.arrays(np.uint8, n, elements=st.integers(0, int(sum(SampleFlag))))
    return Recording(
        draw(hnp.arrays(np.float64, (n, n_axes), elements=_FINITE)),
        **clock,
        label=draw(st.none() | _LABEL),
        session=draw(st.none() | _LABEL),
        start_time=draw(st.none() | _FINITE),
        trigger_index=draw(st.none() | st.integers(0, n - 1)),
        meta=draw(_META | st.builds(lambda units: {"units": units}, _UNITS)),
        flags=draw(st.none() | flags),
        name=draw(_TEXT),
        axes=axes,
    )


@st.composite
def datasets(draw):
    """Ragged, irregular, flagged, unlabelled recordings with nested meta; six axes, or others."""
    axes = draw(
        st.sampled_from([None, None, ("force",), ("fx", "fz", "depth \u03b1"), ("wx (raw)", "WX [V]", "mx")])
    )
    items = draw(st.lists(recordings(axes), min_size=1, max_size=4))
    steps = draw(st.lists(st.builds(StepReport, st.just("made"), _META, _META), max_size=2))
    return Dataset(items, steps)


def small():
    """A recording at a rate with all that may be stated, and one of stamps, without a label."""
    about = {"label": "oat flakes", "session": "mon", "start_time": 1.7e9, "meta": {"tool": {"d_mm": 17}}}
    regular = Recording(np.arange(12.0).reshape(2, 6), rate_hz=500, name="one", **about)
    uneven = {"time_s": [0, 0.25, 0.375], "trigger_index": 1, "flags": [0, 1, 2]}
    stamped = Recording(-np.arange(18.0).reshape(3, 6), name="two", **uneven)
    return Dataset([regular, stamped], [StepReport("load", {"format": "csv"})])


def assert_same_bits(a, b):
    """Compare data sets more strictly than == does: -0.0 is not 0.0, and types of numbers count."""
    assert len(a) == len(b)
    for one, other in zip(a, b, strict=True):
        assert one == other
        assert repr(one.meta) == repr(other.meta)
        assert repr(one.start_time) == repr(other.start_time)
        for name in ("wrench", "time_s", "flags"):
            x, y = getattr(one, name), getattr(other, name)
            assert (x is None) == (y is None)
            if x is not None:
                assert x.dtype == y.dtype
                assert x.tobytes() == y.tobytes()
                assert not y.flags.writeable
