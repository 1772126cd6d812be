"""Every file that a command writes: nothing of another kind is replaced, and nothing at all unasked."""

import shlex

import pytest

from cli_cases import ended_well, make, refused, run
from granular_id.cli.outputs import show
from granular_id.io import save

FOREIGN = {
    ".json": b'{"format": "1"}',
    ".jsonl": b'{"format": "1"}',
    ".html": b"<!doctype html><html>",
    ".png": b"\x89PNG\r\n",
    ".svg": b"<?xml version='1.0'?><svg/>",
    ".pdf": b"%PDF-1.4",
    ".safetensors": b'\x02\0\0\0\0\0\0\0{"__metadata__":{"format":"pt"}}',
    ".csv": b"recording,label\n",
    ".npz": b"PK\x03\x04 arrays of others",
}
"""Files of the same kind that another program has written."""

WRITTEN = [
    ("evaluate {small} --spaces hfmh -q", "--report", "r.html"),
    ("evaluate {small} --spaces hfmh -q", "--json", "r.json"),
    ("evaluate {small} --spaces hfmh -q", "--csv", "r.csv"),
    ("train {small} --space hfmh -q", "--output", "m.safetensors"),
    ("train {small} --space hfmh -q -o m.safetensors", "--figure", "f.png"),
    ("train {small} --space hfmh -q -o m.safetensors", "--json", "r.json"),
    ("confidence {small} --space hfmh", "--figure", "f.svg"),
    ("confidence {small} --space hfmh", "--json", "r.json"),
    ("explain {small} oat rice --space hfmh", "--figure", "f.pdf"),
    ("explain {small} oat rice --space hfmh", "--json", "r.json"),
    ("identify {model} {small} -q", "--json", "r.json"),
    ("identify {model} {small} -q", "--csv", "r.csv"),
    ("identify {model} {small} -q --hop-s 0.2", "--csv", "r.csv"),
    ("live --source sim:rice?rate_hz=125&speed=20 --model {model} --pre-s 0.1 --n 1 -q", "--json", "r.jsonl"),
    ("adapt {model} {small} --labelled -q", "--output", "m.safetensors"),
    ("model {model}", "--json", "r.json"),
    ("data check {small}", "--json", "r.json"),
    ("data info {small}", "--json", "r.json"),
    ("data plot {small} -n 1", "--output", "f.png"),
    ("data convert {small}", "", "x.npz"),
    ("data synthesize --materials rice --n-per-class 1", "", "x.npz"),
]


def test_text_is_broken_between_words(capsys, monkeypatch):
    text = "best names 96.9 % of SYNTHETIC recordings right with held-out sessions (95 % interval 90 to 100)"
    for width in (60, 200):  # of a terminal; no line is wider than 80
        monkeypatch.setenv("COLUMNS", str(width))
        show(text)
        lines = capsys.readouterr().out.splitlines()
        assert max(map(len, lines)) <= min(80, width)
        assert " ".join(line.strip() for line in lines) == text


def test_command_is_broken_as_it_can_be_typed(capsys):
    words = ["granular-id", "data", "convert", *(f"--option-{k}=it's of {k} parts" for k in range(8))]
    show(shlex.join(words))
    printed = capsys.readouterr().out
    lines = printed.splitlines()
    assert len(lines) > 3
    assert all(line.endswith(" \\") for line in lines[:-1])
    assert shlex.split(printed.replace("\\\n", "")) == words


def test_text_too_long_says_what_has_the_rest(capsys):
    command = f"granular-id data info {'x' * 50} --units rad/s,m/s2 --details"
    show("\n".join(map(str, range(30))), most=10, rest=command)
    *lines, first, second = capsys.readouterr().out.splitlines()
    assert lines[-2:] == ["6", "... 23 more lines:"]
    assert f"{first.removesuffix(chr(92))}{second.strip()}" == command


@pytest.fixture
def place(folder, model, tmp_path, monkeypatch):
    """Where commands run, and what they read."""
    monkeypatch.chdir(tmp_path)
    return {"small": folder, "model": model}


@pytest.mark.filterwarnings("default")
@pytest.mark.usefixtures("no_pictures")
@pytest.mark.parametrize(("typed", "option", "name"), WRITTEN)
def test_force_replaces_only_what_the_command_wrote(place, tmp_path, typed, option, name):
    pytest.importorskip("matplotlib")
    there, foreign = tmp_path / name, FOREIGN[(tmp_path / name).suffix]
    words = [*typed.format(**place).split(), *filter(None, [option]), name]
    there.write_bytes(foreign)
    for force in ((), ("--force",)):
        assert f"{option} {name}: what is there is not ".strip() in refused(*words, *force)
    assert there.read_bytes() == foreign
    there.write_bytes(b"")  # nothing is lost
    result = run(*words)
    assert result.exit_code == 0, result.output
    whole = there.read_bytes()
    if "m.safetensors" in words[:-1]:
        (tmp_path / "m.safetensors").unlink()
    assert f"{name}: there is such a file already; add --force to replace it" in refused(*words)
    assert there.read_bytes() == whole
    assert not option or "must end in " in refused(*words[:-1], "other.xyz", "--force")


def test_force_reaches_the_file(place, tmp_path):
    words = ("model", place["model"], "--json", tmp_path / "r.json")
    ended_well(*words)
    whole = (tmp_path / "r.json").read_bytes()
    (tmp_path / "r.json").write_bytes(whole[:100])
    ended_well(*words, "--force")
    assert (tmp_path / "r.json").read_bytes() == whole


def test_force_keeps_what_others_wrote_into_a_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "report.html").write_bytes(FOREIGN[".html"])
    (tmp_path / "holiday.png").write_bytes(FOREIGN[".png"])  # nobody writes this one
    assert "--output report.html: what is there is not a report" in refused("demo", "-o", ".", "--force")


@pytest.mark.parametrize(
    ("source", "output"),
    [
        ("x.npz", "x.npz"),
        ("link.npz", "x.npz"),
        ("x.npz", "link.npz"),
        ("link", "x.npz"),
        ("x.parquet", "x.parquet"),
    ],
)
def test_convert_by_force_never_touches_its_source(tmp_path, monkeypatch, source, output):
    pytest.importorskip("pyarrow")
    monkeypatch.chdir(tmp_path)
    save(make(2), "x.npz")
    save(make(2), "x.parquet", "parquet")
    (tmp_path / "link.npz").symlink_to("x.npz")
    (tmp_path / "link").symlink_to(".")
    files = {path: path.read_bytes() for path in tmp_path.glob("x*/**/*") if path.is_file()}
    line = refused("data", "convert", source, output, "--force")
    assert "belongs to" in line or "is a folder, --force replaces files only" in line
    assert {path: path.read_bytes() for path in tmp_path.glob("x*/**/*") if path.is_file()} == files
