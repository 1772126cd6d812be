"""Random bytes and mutated files: either recordings or the documented exception, nothing else."""

import numpy as np
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from granular_id.io import RecordingFileError, load
from granular_id.io.csv_numbers import _parse_fast, _parse_slowly, parse_numbers

GOOD = b"time,fx,fy,fz,tx,ty,tz\r\n0.00,1.5,-2,3e0,.4,5,+6\r\n0.01,1,2,3,4,5,6\n0.02, 1, 2, 3,4,5,6\n"
INDEX = (
    b"file,label,session,start_time,rate_hz,trigger_index,name,meta,tool\n"
    b'good.csv,rice,s1,1e9,100,1,"a, b","{""x"": [1]}",t\n'
)
PIECES = st.sampled_from(
    [
        b"",
        b",",
        b"\n",
        b"\r",
        b"\0",
        b"nan",
        b"1e999",
        b"-",
        b"1_0",
        b'"',
        b"\xff",
        b"\xef\xbb\xbf",
        b" ",
        b"\t",
        b"../",
    ]
)
fuzz = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=300)


@st.composite
def mutated(draw, good):
    data = bytearray(good)
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(data)))
        end = min(len(data), start + draw(st.integers(0, 8)))
        data[start:end] = draw(PIECES | st.binary(max_size=6))
    return bytes(data)


def outcome(function, *args, **kwargs):
    """Return what a function gives and None, or None and the one exception that it may raise."""
    try:
        return function(*args, **kwargs), None
    except RecordingFileError as error:
        return None, error


def read_or_refuse(path, **options):
    data, error = outcome(load, path, **options)
    if error is not None:
        assert ".csv" in str(error)
        return
    for recording in data:
        assert np.isfinite(recording.wrench).all()
        assert (np.diff(recording.times()) > 0).all()


@given(data=st.binary(max_size=300) | mutated(GOOD))
@example(GOOD)
@fuzz
def test_files(tmp_path, data):
    (tmp_path / "a_1.csv").write_bytes(data)
    for options in ({}, {"on_time_error": "repair"}, {"rate_hz": 100.0}):
        read_or_refuse(tmp_path / "a_1.csv", **options)


@given(data=st.binary(max_size=300) | mutated(INDEX))
@example(INDEX)
@fuzz
def test_indices(tmp_path, data):
    (tmp_path / "good.csv").write_bytes(GOOD)
    (tmp_path / "index.csv").write_bytes(data)
    for on_error in ("raise", "skip"):
        read_or_refuse(tmp_path, on_error=on_error)


NUMBERS = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False).map(repr),
    st.integers(-(10**30), 10**30).map(str),
    st.from_regex(r"[ \t]?[+-]?[0-9]{0,25}\.?[0-9]{0,25}([eE][+-]?[0-9]{1,3})?[ \t]?", fullmatch=True),
    st.text("0123456789+-.eE \t", max_size=8),
)


@given(cells=st.lists(st.tuples(NUMBERS, NUMBERS), min_size=1, max_size=5))
@settings(max_examples=200)
def test_the_fast_pass_agrees_with_the_slow_one(cells):
    """What the fast pass accepts the slow one reads to the same bits; it accepts all that is right."""
    text = "\n".join(",".join(row) for row in cells).encode()
    fast = _parse_fast(text, 2)
    slow, error = outcome(_parse_slowly, text.split(b"\n"), 2, ["a", "b"], "x.csv")
    if error is not None:
        assert fast is None
        return
    assert fast is not None
    assert fast.tobytes() == slow.tobytes()
    assert slow.tobytes() == np.array([[float(c) for c in row] for row in cells]).tobytes()


@given(
    cells=st.lists(st.tuples(NUMBERS, NUMBERS), min_size=1, max_size=5),
    end=st.sampled_from(["", "\n", "\r\n\r\n"]),
)
def test_whole_tables_agree_with_the_slow_pass(cells, end):
    text = "\r\n".join(",".join(row) for row in cells)
    slow, expected = outcome(_parse_slowly, text.encode().split(b"\r\n"), 2, ["a", "b"], "x.csv")
    whole, error = outcome(parse_numbers, (text + end).encode(), 0, ["a", "b"], "x.csv")
    if expected is None:
        assert error is None
        assert whole.tobytes() == slow.tobytes()
    else:
        assert error is not None
        assert error.line == expected.line
