"""Files read in a child process: the same recordings and errors, and whatever ends the child ends one file only."""

import os
import re
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest

pytest.importorskip("h5py")
pytest.importorskip("mcap")
pytest.importorskip("pyarrow")
pytest.importorskip("rosbags")

from dataset_strategies import assert_same_bits
from good_files import PATHS, write_good
from granular_id.io import RecordingFileError, isolate, load

ROW = "1,2,3,4,5,6\n"
TABLE = "fx,fy,fz,tx,ty,tz\n" + ROW * 4


def child(monkeypatch, code):
    """Let the child run some lines before it serves."""
    every = f"import os, sys, time\nimport numpy as np\nfrom granular_id.io import isolate\n{textwrap.dedent(code)}\n"
    monkeypatch.setattr(isolate, "_CHILD", ("-c", every + "isolate._serve()"))


ODD = """
    real = isolate.read_file
    def read_file(source, options):
        what = source.path.stem.partition("_")[0]
        open(source.path.parent / "pid", "w").write(str(os.getpid()))
        if what == "crash":
            os.abort()
        if what == "exit":
            os._exit(3)
        if what == "spin":
            while True: pass
        if what == "sleep":
            time.sleep(1000)
        if what == "eat":
            eaten = np.empty(1 << 28)
        print("said on the way")
        return real(source, options)
    isolate.read_file = read_file
"""


def test_recordings_and_what_is_said_of_them_are_the_same_in_every_format(tmp_path):
    for kind in PATHS:
        (tmp_path / kind / "1").mkdir(parents=True)
        write_good(kind, tmp_path / kind / "1")
    index = "".join(f"{kind}/1/{name},{500 if kind == 'npy' else ''}\n" for kind, name in PATHS.items())
    (tmp_path / "index.csv").write_text("file,rate_hz\n" + index)
    here, there = load(tmp_path), load(tmp_path, isolate=True)
    assert_same_bits(there, here)
    assert there.history == here.history


@pytest.mark.parametrize(
    "text",
    [
        "time,fx,fy,fz,tx,ty,tz\n5," + ROW + "5.01," + ROW,
        "time,fx,fy,fz,tx,ty,tz\n0," + ROW + "0.01," + ROW.strip(),
        "time,fx,fy,fz,tx,ty,tz,rate\n0,1,2,3,4,5,6,99\n0.01,1,2,3,4,5,6,100\n",
    ],
    ids=["a clock that begins late", "no line end", "rates that change"],
)
def test_remarks_are_the_same(tmp_path, text):
    (tmp_path / "a.csv").write_text(text)
    here, there = load(tmp_path), load(tmp_path, isolate=True)
    assert there.history == here.history
    assert len(there.history[-1].rows) == 1


def test_a_folder_with_an_index_and_a_relative_path(tmp_path, monkeypatch):
    (tmp_path / "set").mkdir()
    (tmp_path / "set" / "a.csv").write_text(TABLE)
    stamps = TABLE.replace("\n1", "\n0,1", 1).replace("\n1", "\n3,1")
    (tmp_path / "set" / "b.csv").write_text(f"time,{stamps}")
    index = 'file,label,rate_hz,trigger_index,meta\na.csv,rice,250,2,"{""tool"": ""rod""}"\nb.csv,peas,irregular,,\n'
    (tmp_path / "set" / "index.csv").write_text(index)
    monkeypatch.chdir(tmp_path)
    options = {"on_time_error": "repair"}
    here, there = load("set", **options), load("set", isolate=True, **options)
    assert_same_bits(there, here)
    assert there.history == here.history


def test_errors_are_the_same(tmp_path):
    texts = ("", TABLE + "1,2,x,4,5,6\n", TABLE, "time," + TABLE)
    for i, text in enumerate(texts):
        (tmp_path / f"{i}.csv").write_text(text)
    skipped = []
    for isolated in (False, True):
        with pytest.raises(RecordingFileError, match="none of 4") as caught:
            load(tmp_path, isolate=isolated, on_error="skip")
        skipped.append({**vars(caught.value.__cause__), "said": str(caught.value)})
        with pytest.raises(RecordingFileError) as caught:
            load(tmp_path / "1.csv", isolate=isolated)
        skipped[-1] |= {f"of {key}": value for key, value in vars(caught.value).items()}
    assert skipped[0] == skipped[1]


@pytest.mark.parametrize(
    ("what", "said"),
    [
        ("crash", "crashed .SIGABRT"),
        ("exit", "crashed .exit code 3"),
        ("spin", "not read within"),
        ("sleep", "not read within"),
        ("eat", "needs more memory"),
    ],
)
def test_what_ends_the_child_is_said_of_the_file_and_the_others_load(tmp_path, monkeypatch, what, said):
    child(monkeypatch, ODD)
    if "within" in said:
        monkeypatch.setattr(isolate, "_FREE_S", 1.0)
    for name in ("a_1", f"{what}_2", "c_3"):
        (tmp_path / f"{name}.csv").write_text(TABLE)
    data = load(tmp_path, isolate=True, rate_hz=100, on_error="skip")
    assert data.names == ("a_1.csv", "c_3.csv")
    (row,) = data.history[-1].rows
    assert row["name"] == f"{what}_2.csv"
    assert re.search(said, row["skipped"])


LIES = {
    "no JSON": "return 'no', []",
    "a line without end": "return {'error': 'x' * (2 << 20)}, []",
    "nested too deeply": "isolate._line = lambda head: b'[' * 100_000 + b'\\n'; return {}, []",
    "nothing asked for": "return {'columns': {}}, []",
    "another entry": "return {'code': 'import os'}, []",
    "an unknown column": "head['columns']['evil'] = [1]",
    "too few bytes, then its end": "columns.pop(0); threading.Timer(0.3, os._exit, [0]).start()",
    "a shape beyond all memory": "head['columns']['wrench'] = [2**40, 6]",
    "a shape below zero": "head['columns']['wrench'] = [-4, -6]",
    "a shape of one axis": "head['columns']['wrench'] = [24]",
    "a shape of text": "head['columns']['wrench'] = ['4', '6']",
    "samples that are not finite": "columns[0] = columns[0] * np.nan",
    "lengths that do not add up": "columns[1] = columns[1] * 2",
    "a description that is no JSON": "columns[-1] = columns[-1] * 0",
    "a description of other things": "columns[-1] = columns[-1][:2] * 0 + 91; head['columns']['about'] = [2]",
    "millions of objects": "columns[-1] = np.tile(columns[-1][:1], 1 << 20); head['columns']['about'] = [1 << 20]",
}


def test_answers_of_a_child_that_was_taken_over_are_checked(tmp_path, monkeypatch):
    names = [f"lie_{i}" for i in range(len(LIES))]
    told = "\n".join(
        f"    if source.path.stem == {name!r}:\n        {lie}"
        for name, lie in zip(names, LIES.values(), strict=True)
    )
    before = "import threading\nreal = isolate._answer\ndef answer(source, options):"
    answer = f"    head, columns = real(source, options)\n{told}\n    return head, columns"
    child(monkeypatch, f"{before}\n{answer}\nisolate._answer = answer")
    for name in ("a_1", *names, "z_1"):
        (tmp_path / f"{name}.csv").write_text(TABLE)
    data = load(tmp_path, isolate=True, rate_hz=100, on_error="skip")
    assert data.names == ("a_1.csv", "z_1.csv")
    assert [row["name"] for row in data.history[-1].rows] == [f"{name}.csv" for name in names]


def test_an_interrupt_ends_the_child(tmp_path, heeding_interrupts):
    (tmp_path / "sleep_1.csv").write_text(TABLE)
    code = f"""
import pathlib, sys
from granular_id.io import isolate, load
code = {textwrap.dedent(ODD)!r}
isolate._CHILD = ("-c", "import os, sys, time\\nfrom granular_id.io import isolate\\n" + code + "\\nisolate._serve()")
load({os.fspath(tmp_path)!r}, isolate=True, rate_hz=100)
"""
    parent = subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE)
    pid = _written(tmp_path / "pid")
    parent.send_signal(signal.SIGINT)
    _, said = parent.communicate(timeout=30)
    assert b"KeyboardInterrupt" in said
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def _written(path: Path) -> int:
    ends = time.monotonic() + 30
    while time.monotonic() < ends:
        if path.exists() and path.read_text():
            return int(path.read_text())
        time.sleep(0.02)
    raise TimeoutError(path)


def test_limits_that_are_there_already_stay(tmp_path):
    (tmp_path / "a.csv").write_text(TABLE)
    code = f"""
import resource
from granular_id.io import load
for what in (resource.RLIMIT_CPU, resource.RLIMIT_AS):
    resource.setrlimit(what, (most := 60 if what == resource.RLIMIT_CPU else 8 << 30, most))
load({os.fspath(tmp_path)!r}, isolate=True, rate_hz=100)
"""
    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_command_line_takes_it_and_load_nothing_but_true_and_false(tmp_path):
    (tmp_path / "a.csv").write_text(TABLE)
    command = [sys.executable, "-m", "granular_id", "data", "info", "--recorded-hz", "100"]
    plain, isolated = (
        subprocess.run([*command, *more, tmp_path / "a.csv"], capture_output=True, text=True, check=False)
        for more in ([], ["--isolate"])
    )
    assert isolated.returncode == 0, isolated.stderr
    assert isolated.stdout == plain.stdout
    with pytest.raises(TypeError, match="isolate must be True or False"):
        load(tmp_path, isolate=1)
