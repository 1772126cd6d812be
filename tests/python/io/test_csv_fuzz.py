"""Random bytes and damaged files: either recordings, to the bit, or the one exception.

``GRANULAR_ID_CASES=100000 pytest tests/python/io/test_csv_fuzz.py -k campaign`` tries as many; ``tests/fuzz`` does the
same to the table reader alone.
"""

import re

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, example, given, settings, strategies as st

from effort import cases
from granular_id._core import write_number_table
from granular_id.io import RecordingFileError, load
from granular_id.io.columns import axis_of
from granular_id.io.numbers import parse_numbers
from granular_id.recording import AXES

GOOD = b"time,fx,fy,fz,tx,ty,tz\r\n0.00,1.5,-2,3e0,.4,5,+6\r\n0.01,1,2,3,4,5,6\n0.02, 1, 2, 3,4,5,6\n"
INDEX = (
    b"file,label,session,start_time,rate_hz,trigger_index,name,meta,tool\n"
    b'good.csv,rice,s1,1e9,100,1,"a, b","{""x"": [1]}",t\n'
)
CELLS = '|,|\n|\r|\0|nan|-inf|1e999|-|1_0|0x1|1e-999|"|"1"|\xff|\ufeff| |\t|\u2212|../'
PIECES = st.sampled_from(f"{CELLS}|Fx [N]|Torque_y|time_s|tx_Nmm|flags".split("|")).map(str.encode)
fuzz = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=cases(150))


@st.composite
def damaged(draw, good):
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


def read_plainly(data):
    """Return the samples of a file that is right in every way."""
    lines = data.decode("utf-8-sig").replace("\r\n", "\n").rstrip("\n \t\r").split("\n")
    axes = [axis_of(name.strip().strip('"').strip()) for name in lines[0].split(",")]
    table = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
    return table[:, [axes.index(axis) for axis in AXES]]


@given(data=st.binary(max_size=300) | damaged(GOOD))
@example(GOOD)
@fuzz
def test_campaign_of_files(tmp_path, data):
    file = tmp_path / "a_1.csv"
    file.write_bytes(data)
    for options in ({}, {"on_time_error": "repair"}, {"rate_hz": 100.0}):
        read, error = outcome(load, file, **options)
        if error is not None:
            assert error.path == str(file)
            assert len(str(error)) < 1000
            continue
        assert all(np.isfinite(recording.wrench).all() for recording in read)
        assert all((np.diff(recording.times()) > 0).all() for recording in read)
        if options != {"on_time_error": "repair"} and b'"' not in data and b"_Nmm" not in data:
            header = data.split(b"\n")[0].decode("utf-8-sig").split(",")
            if all(axis_of(name) for name in header):
                assert read[0].wrench.tobytes() == read_plainly(data).tobytes()


@given(data=st.binary(max_size=300) | damaged(INDEX))
@example(INDEX)
@fuzz
def test_campaign_of_indexes(tmp_path, data):
    (tmp_path / "good.csv").write_bytes(GOOD)
    (tmp_path / "index.csv").write_bytes(data)
    for on_error in ("raise", "skip"):
        outcome(load, tmp_path, on_error=on_error)


PLAIN = re.compile(r"[ \t]*[+-]?([0-9]+[.]?[0-9]*|[.][0-9]+)([eE][+-]?[0-9]+)?[ \t]*")
DIGITS = st.integers(0, 10**25).map(str) | st.just("")
SIGNS = st.sampled_from(["", "-", "+", " ", "\t-"])
EXPONENTS = st.just("") | st.integers(-400, 400).map("e{}".format) | st.sampled_from(["E+5", "e", "e-", " "])
NUMBERS = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False).map(repr),
    st.integers(-(10**30), 10**30).map(str),
    st.builds("{}{}.{}{}".format, SIGNS, DIGITS, DIGITS, EXPONENTS),
    st.text("0123456789+-.eE \t", max_size=8),
)


def read_slowly(text):
    """Read a table of two columns with `split`, a regular expression and `float`; say where it fails."""
    values = []
    for number, line in enumerate(re.split("\r?\n", text.rstrip("\r\n \t")), start=2):
        if not line:
            return None, (number, None)
        row = line.split(",")
        for column, cell in zip("ab", row, strict=False):
            if not PLAIN.fullmatch(cell) or np.isinf(float(cell)):
                return None, (number, column)
            values.append(float(cell))
        if len(row) != 2:
            return None, (number, None)
    return np.array(values), None


@given(
    rows=st.lists(
        st.lists(NUMBERS, min_size=1, max_size=3) | st.tuples(NUMBERS, NUMBERS), min_size=1, max_size=5
    ),
    line_end=st.sampled_from(["\n", "\r\n"]),
    last=st.sampled_from(["", "\n", "\r\n\r\n"]),
)
@fuzz
def test_campaign_of_tables_that_agree_with_a_slow_twin(rows, line_end, last):
    """The same bits, or a fault in the same line and column."""
    text = line_end.join(",".join(row) for row in rows) + last
    assume(text.strip())
    expected, place = read_slowly(text)
    values, error = outcome(parse_numbers, text.encode(), 0, ["a", "b"], "x.csv")
    if place is None:
        assert error is None
        assert values.shape == (len(expected) // 2, 2)
        assert values.tobytes() == expected.tobytes()
    else:
        assert (error.line, error.column) == place


@given(values=st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=20))
def test_what_is_written_is_read_back_and_has_as_few_digits_as_python_writes(values):
    text = write_number_table([np.array(values), np.arange(len(values), dtype=np.uint8)])
    table = parse_numbers(text, 0, ["value", "flag"], "x.csv")
    assert table[:, 0].tobytes() == np.array(values).tobytes()
    assert table[:, 1].tolist() == list(range(len(values)))
    for line, value in zip(text.decode().splitlines(), values, strict=True):
        assert digits(line.partition(",")[0]) == digits(repr(value))


def digits(number):
    """Significant digits, without sign, point, exponent and the zeros around them."""
    return re.sub("e.*|[-+.]", "", number).strip("0")


@pytest.mark.parametrize(
    "columns", [[np.zeros(3), np.zeros(2)], [np.array([0, np.nan])], [np.zeros((2, 2))], [[1.0]]]
)
def test_columns_that_cannot_be_written(columns):
    with pytest.raises((TypeError, ValueError), match=r"column|array"):
        write_number_table(columns)


def test_a_column_with_odd_steps_is_written_as_it_is():
    packed = np.zeros(5, dtype=[("flag", "u1"), ("value", "f8")])
    packed["value"] = np.arange(5) + 0.5
    assert write_number_table([packed["value"]]) == write_number_table([packed["value"].copy()])
