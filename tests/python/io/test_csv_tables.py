"""CSV tables as pandas, numpy and robots write them: one recording, or many told apart by a column."""

import gzip

import numpy as np
import pytest

from granular_id.io import load
from granular_id.recording import AXES

pandas = pytest.importorskip("pandas")
WRENCH = np.random.default_rng(4).normal(size=(6, 6)).round(4)
STAMPS = np.arange(6) / 500


def frame(**more):
    return pandas.DataFrame({"time": STAMPS} | dict(zip(AXES, WRENCH.T, strict=True)) | more)


OF_ROBOT = {"time": "timestamp"} | {axis: f"actual_TCP_force_{i}" for i, axis in enumerate(AXES)}
WRITTEN = {
    "pandas with its index": ("a.csv", frame().to_csv(), "''"),
    "pandas twice": ("a.csv", frame(**{"Unnamed: 0": range(6)}).to_csv(), "'', 'Unnamed: 0'"),
    "savetxt": ("a.csv", "# " + frame().to_csv(index=False), None),
    "savetxt with blanks": ("a.csv", "# " + frame().to_csv(index=False, sep=" "), None),
    "gzip": ("a.csv.gz", frame().to_csv(index=False), None),
    "tabs": ("a.tsv", frame().to_csv(index=False, sep="\t"), None),
    "tabs, gzip": ("a.TSV.gz", frame().to_csv(index=False, sep="\t"), None),
    "semicolons": ("a.csv", frame().to_csv(index=False, sep=";"), None),
    "a separator at the end": ("a.csv", frame().to_csv(index=False).replace("\n", ",\n"), "''"),
    "other columns": ("a.csv", frame(note='a, "b"', temp=20.5).to_csv(index=False), "'note', 'temp'"),
    "parts of times": ("a.csv", frame(delay_ns=3, nanosec=7).to_csv(index=False), "'delay_ns', 'nanosec'"),
    "a robot": (
        "a.csv",
        frame(actual_q_0=0.5).rename(columns=OF_ROBOT).to_csv(index=False, sep=" "),
        "'actual_q_0'",
    ),
}


@pytest.mark.parametrize("name", WRITTEN)
def test_tables_as_others_write_them(tmp_path, name):
    file, text, unread = WRITTEN[name]
    data = gzip.compress(text.encode()) if file.endswith(".gz") else text.encode()
    (tmp_path / file).write_bytes(data)
    data = load(tmp_path / file)
    assert data[0].wrench.tolist() == WRENCH.tolist()
    assert data[0].rate_hz == 500
    notes = [note for note in data.history[-1].notes if "not read" in note]
    assert notes == ([] if unread is None else [f"columns that are not read: {unread}"])


def test_one_long_table_of_many_recordings(tmp_path):
    about = frame(trial=[7, 7, 7, 3, 3, 3], material=["rice"] * 3 + ["oats, rolled"] * 3, session="s1")
    about["time"] %= 0.006
    about.to_csv(tmp_path / "all.csv", index=False)
    data = load(tmp_path / "all.csv")
    assert data.names == ("all.csv[7]", "all.csv[3]")
    assert [r.label for r in data] == ["rice", "oats, rolled"]
    assert set(data.sessions) == {"s1"}
    assert [r.rate_hz for r in data] == [500, 500]
    assert np.vstack([r.wrench for r in data]).tolist() == WRENCH.tolist()
