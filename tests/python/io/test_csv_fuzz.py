"""Random bytes and mutated files: either recordings or the documented exception, nothing else.

``GRANULAR_ID_CASES=100000 pytest tests/python/io/test_csv_fuzz.py -k campaign -s`` runs the long campaign and prints
how many files were read, refused and compared. ``tests/fuzz`` does the same to the table reader alone.
"""

import os
import re
from collections import Counter

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, example, given, settings, strategies as st

from granular_id._core import write_number_table
from granular_id.io import RecordingFileError, load
from granular_id.io.columns import axis_of
from granular_id.io.csv.numbers import parse_numbers
from granular_id.recording import AXES

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
@settings(max_examples=200)
def test_tables_agree_with_a_slow_twin(rows, line_end, last):
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
    ("columns", "problem"),
    [
        ([np.zeros(3), np.zeros(2)], "each column must hold 3 values, got 2"),
        ([np.array([0.0, np.nan])], "column 0 must be finite, got NaN in row 1"),
        ([np.zeros((2, 2))], "1-D array of float64 or uint8"),
        ([np.zeros(2, dtype=np.float32)], "1-D array of float64 or uint8"),
        ([[1.0]], "1-D array of float64 or uint8"),
    ],
)
def test_columns_that_cannot_be_written(columns, problem):
    with pytest.raises((TypeError, ValueError), match=problem):
        write_number_table(columns)


def test_a_column_with_odd_steps_is_written_as_it_is():
    packed = np.zeros(5, dtype=[("flag", "u1"), ("value", "f8")])
    packed["value"] = np.arange(5) + 0.5
    assert write_number_table([packed["value"]]) == write_number_table([packed["value"].copy()])


CELLS = [
    b"",
    b"nan",
    b"-inf",
    b"1e999",
    b"1_0",
    b"0x1",
    b"+.5e-3",
    b" 7. ",
    b"1e-999",
    b"9007199254740993",
    b"--1",
    b'"1"',
]
NAMES = [
    b"fx",
    b"Fx [N]",
    b"mx",
    b"Torque_y",
    b"t",
    b"time_s",
    b"stamp",
    b"flags",
    b"tx_Nmm",
    b"temp",
    b"wrench.force.z",
]
DIRT = [
    b"",
    b",",
    b"\n",
    b"\r",
    b"\0",
    b"-",
    b"e",
    b".",
    b'"',
    b"\xff",
    b"\xef\xbb\xbf",
    b" ",
    b"\t",
    b"\xe2\x88\x92",
]


def pick(rng, items):
    return items[rng.integers(len(items))]  # rng.choice would cut NUL bytes off


def a_file(rng):
    """Make a file of a few lines, and damage it in up to three ways."""
    time = np.arange(rng.integers(1, 6)) * 0.01 + rng.choice([0.0, 5.0, 1.6e9])
    names = [b"time", *(axis.encode() for axis in AXES)]
    if rng.random() < 0.2:
        names[rng.integers(len(names))] = pick(rng, NAMES)
    rows = [[repr(float(t)).encode(), *(b"%.17g" % v for v in rng.normal(size=6))] for t in time]
    line_end = b"\r\n" if rng.random() < 0.3 else b"\n"
    for _ in range(rng.choice([0, 0, 1, 2])):
        row = pick(rng, rows)
        if rng.random() < 0.5 and row:
            row[rng.integers(len(row))] = pick(rng, CELLS)
        elif rng.random() < 0.5:
            row.insert(rng.integers(len(row) + 1), b"1")
        else:
            i, j = rng.integers(len(rows), size=2)
            rows[i] = list(rows[j])
    data = line_end.join(b",".join(row) for row in [names, *rows]) + pick(rng, [b"", line_end, 2 * line_end])
    for _ in range(rng.choice([0, 0, 1, 2])):
        start = int(rng.integers(len(data) + 1))
        data = data[:start] + pick(rng, DIRT) + data[start + int(rng.integers(4)) :]
    return data[: rng.integers(len(data) + 1)] if rng.random() < 0.05 else data


def read_plainly(data):
    """Return what a file that is right in every way holds: stamps (or None) and samples."""
    lines = data.decode("utf-8-sig").replace("\r\n", "\n").rstrip("\n \t\r").split("\n")
    axes = [axis_of(name.strip().strip('"').strip()) for name in lines[0].split(",")]
    table = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
    stamps = table[:, axes.index("time")] if "time" in axes else None
    return stamps, table[:, [axes.index(axis) for axis in AXES]]


def test_campaign(tmp_path):
    n_cases = int(os.environ.get("GRANULAR_ID_CASES", "500"))
    rng = np.random.default_rng(20240326)
    counts = Counter()
    file = tmp_path / "a_1.csv"
    for _ in range(n_cases):
        data = a_file(rng)
        file.write_bytes(data)
        result, error = outcome(load, file, rate_hz=None if rng.random() < 0.8 else 100.0)
        if error is not None:
            assert error.path == str(file)
            assert len(str(error)) < 1000
            counts["refused"] += 1
            continue
        stamps, wrench = read_plainly(data)
        assert result[0].wrench.tobytes() == wrench.tobytes()
        if result[0].time_s is not None:
            assert result[0].time_s.tobytes() == (stamps - stamps[0] + 0.0).tobytes()
        counts["read"] += 1
        counts["values"] += wrench.size
    print(f"CSV files: {n_cases} made, {dict(counts)}, 0 other outcomes")
    assert counts["read"] > n_cases // 10
    assert counts["refused"] > n_cases // 10
