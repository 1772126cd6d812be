"""Every argument that the core takes: things of another kind, objects that raise, answer oddly, or come back meanwhile.

Arrays that change while they are read are in `test_callers.py`.
"""

import numpy as np
import pytest

import granular_id as gid
from granular_id import _core
from granular_id.live import WrenchBuffer

SPEC = gid.FeatureSpec(n_bins=4)
MODEL = _core.Model(
    gid.FeatureSpec(hfmh=False), np.ones((1, 6)), [0.0], [[1], [-1]], ["rice", "salt"], n_samples=2, n_axes=3
)
X, ROW = np.ones((5, 40, 6)), np.arange(6.0)
SOS = _core.butter(2, "lowpass", 1.0, 0.0, 10.0)


class Hostile:
    """Answers to every question of Python's about numbers and arrays with one function's answer."""

    def __init__(self, answer):
        self.answer = answer

    def __index__(self):
        return self.answer()

    def __float__(self):
        return self.answer()

    def __array__(self, dtype=None, copy=None):
        return self.answer()


def raised(error):
    def answer():
        raise error

    return Hostile(answer)


# The first word of a key is the name by which an argument is refused.
INTEGERS = {
    "n_samples": lambda it: SPEC.n_features(it, 6),
    "order": lambda it: gid.FeatureSpec(order=it),
    "threads": lambda it: _core.extract_features(X, SPEC, it),
    "threads of scores": lambda it: MODEL.scores(np.zeros((2, 3)), it),
    "n_bins": lambda it: _core.histogram(ROW, it, -1.0, 1.0),
    "axis": lambda it: _core.sosfilt(SOS, ROW, it, None),
    "hop": lambda it: gid.StreamingExtractor(SPEC, hop=it),
    "n_axes of a model": lambda it: _core.Model(SPEC, ROW, ROW, ROW, ["a"], n_axes=it),
    "n_axes of multi-band features": lambda it: _core.MultiBandExtractor(100, it),
    "max_file_bytes": lambda it: _core.Model.from_bytes(b"", max_file_bytes=it),
    "reorder_depth": lambda it: WrenchBuffer(reorder_depth=it),
    "flags": lambda it: WrenchBuffer().push(ROW, flags=it),
    "host_ns": lambda it: WrenchBuffer().push(ROW, host_ns=it),
    "n": lambda it: WrenchBuffer().window(it),
    "max_rows": lambda it: WrenchBuffer().reader().read(it),
}
NUMBERS = {
    "rate_hz": lambda it: gid.FeatureSpec(rate_hz=it),
    "rate_hz of multi-band features": lambda it: _core.MultiBandExtractor(100, 6, rate_hz=it),
    "seconds": WrenchBuffer,
    "t": lambda it: WrenchBuffer().push(ROW, it),
    "timeout_s": lambda it: WrenchBuffer().reader().wait(it),
}
ARRAYS = {
    "wrench": lambda it: _core.extract_features(it, SPEC, 1),
    "bin_range": lambda it: gid.FeatureSpec(bin_range=it),
    "a": lambda it: _core.histogram(it, 4, -1.0, 1.0),
    "sos": lambda it: _core.sosfilt(it, ROW, 0, None),
    "x": lambda it: _core.sosfilt(SOS, it, 0, None),
    "zi": lambda it: _core.sosfilt(SOS, ROW, 0, it),
    "coef": lambda it: _core.Model(SPEC, it, [0.0], [[1], [-1]], ["a", "b"]),
    "scores": MODEL.apply_rules,
    "wrench of a model": MODEL.scores,
    "scales": lambda it: _core.MultiBandExtractor(100, 6, scales=it),
    "wrench of a stream": lambda it: gid.StreamingExtractor(SPEC).push(it),
    "wrench of an identifier": lambda it: _core.StreamingIdentifier(MODEL).push(it),
    "wrench of a row": lambda it: WrenchBuffer().push(it),
    "wrench of rows": lambda it: WrenchBuffer().push_block(it),
    "t of rows": lambda it: WrenchBuffer().push_block([ROW], it),
}
ARGUMENTS = {**INTEGERS, **NUMBERS, **ARRAYS}


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, MemoryError, ZeroDivisionError])
@pytest.mark.parametrize("argument", ARGUMENTS)
def test_what_an_argument_raises_arrives_as_it_is(argument, error):
    mine = error("mine")
    with pytest.raises(error) as got:
        ARGUMENTS[argument](raised(mine))
    assert got.value is mine


def named(argument):
    return rf"^{argument.split()[0]} must "


@pytest.mark.parametrize("argument", [*INTEGERS, *NUMBERS])
def test_number_of_another_type_is_refused_by_name(argument):
    for given in ("1", None, [1, 2], 1j, object(), *([] if argument in NUMBERS else [1.5, 1.0])):
        with pytest.raises(TypeError, match=named(argument)):
            ARGUMENTS[argument](Hostile(lambda given=given: given))


@pytest.mark.parametrize(
    "argument", sorted(INTEGERS.keys() - {"n_samples", "axis", "reorder_depth", "flags", "host_ns"})
)
def test_integer_out_of_range_is_refused_by_name(argument):
    for integer in (0, -1, -(2**64)):
        with pytest.raises(ValueError, match=named(argument)):
            INTEGERS[argument](integer)
    with pytest.raises((ValueError, OverflowError)):
        INTEGERS[argument](Hostile(lambda: 2**64))


NO_ARRAYS = {
    "None": Hostile(lambda: None),
    "a list": Hostile(lambda: [1.0]),
    "a text": "1",
    "a generator": (number for number in [1.0]),
    "objects": np.array([object()]),
    "texts": Hostile(lambda: np.array(["1"])),
    "dates": np.zeros(3, "M8[s]"),
    "records": np.zeros(3, "f8,f8"),
    "integers beyond 64 bits": [10**30, 1],
    "a complex number": Hostile(lambda: np.array(1j)),
    "a masked array": np.ma.masked_array([1.0, 2.0], [0, 1]),
    "ragged lists": [[1.0], [1.0, 2.0]],
}


@pytest.mark.parametrize("given", NO_ARRAYS)
@pytest.mark.parametrize("argument", ARRAYS)
def test_what_is_no_array_of_numbers_is_refused_by_name(argument, given):
    wanted = "be a plain array" if given == "a masked array" else "(be an array of|hold) real numbers"
    with pytest.raises((TypeError, ValueError), match=named(argument) + wanted):
        ARRAYS[argument](NO_ARRAYS[given])


def test_an_input_that_turns_out_to_be_the_output_is_refused():
    out = np.ones((4, 6))
    spec = gid.FeatureSpec(hfmh=False)
    with pytest.raises(ValueError, match="out must not"):
        _core.extract_features(Hostile(lambda: out), spec, 1, out.reshape(24))
    assert (out == 1).all()


@pytest.mark.parametrize("stream", [gid.StreamingExtractor(SPEC), _core.StreamingIdentifier(MODEL, hop=1)])
def test_rows_that_push_or_reset_themselves_find_the_stream_free(stream):
    n_axes = 6 if isinstance(stream, gid.StreamingExtractor) else 3

    def within():
        assert stream.push(np.zeros((1, n_axes))) == 1
        return np.ones((1, n_axes))

    def anew():
        stream.reset()
        return np.ones((1, n_axes))

    assert stream.push(Hostile(within)) == 1
    assert stream.n_seen == 2
    stream.reset()
    assert stream.push(Hostile(anew)) == stream.n_seen == 1


def test_nothing_is_taken_of_rows_that_fail():
    stream, buffer = gid.StreamingExtractor(SPEC), WrenchBuffer()
    buffer.push(ROW)
    before = buffer.stats()
    for ask in (
        stream.push,
        lambda it: buffer.push_block([ROW, ROW], it),
        lambda it: buffer.push_block(it, [1.0, 2.0]),
        lambda it: buffer.push_block([ROW, ROW], flags=[0, it]),
        lambda it: buffer.push_block([ROW, ROW], host_ns=[0, it]),
    ):
        with pytest.raises(ZeroDivisionError):
            ask(raised(ZeroDivisionError()))
    assert stream.n_seen == 0
    assert buffer.stats() == before
