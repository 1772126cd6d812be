"""Every file that a command writes: nothing of another kind is replaced, and nothing at all unasked."""

import hashlib

import pytest

from cli_cases import ended_well, refused
from granular_id.cli.outputs import show
from granular_id.evaluation.result import CSV_COLUMNS as PREDICTED
from granular_id.identifier.answers import CSV_COLUMNS as ANSWERED

ARCHIVE = b"PK\x03\x04 a data set"

SAME = {
    ".json": b'{"format": "1"}',
    ".html": b"<!doctype html>",
    ".png": b"\x89PNG\r\n",
    ".safetensors": b"\x02\0\0\0\0\0\0\0{}",
    "predicted.csv": ",".join(PREDICTED).encode(),
    "answered.csv": ",".join(ANSWERED).encode(),
}

OUTPUTS = [
    (("evaluate", "nowhere", "--report"), "r.html"),
    (("evaluate", "nowhere", "--json"), "r.json"),
    (("evaluate", "nowhere", "--csv"), "predicted.csv"),
    (("train", "nowhere", "-o"), "m.safetensors"),
    (("train", "nowhere", "-o", "m", "--figure"), "f.png"),
    (("train", "nowhere", "-o", "m", "--json"), "r.json"),
    (("confidence", "nowhere", "--figure"), "f.png"),
    (("confidence", "nowhere", "--json"), "r.json"),
    (("explain", "nowhere", "oat", "rice", "--figure"), "f.png"),
    (("explain", "nowhere", "oat", "rice", "--json"), "r.json"),
    (("identify", "nowhere", "recordings", "--json"), "r.json"),
    (("identify", "nowhere", "recordings", "--csv"), "answered.csv"),
    (("model", "nowhere", "--json"), "r.json"),
    (("data", "check", "nowhere", "--json"), "r.json"),
    (("data", "info", "nowhere", "--json"), "r.json"),
    (("data", "plot", "nowhere", "-o"), "f.png"),
]


def digest(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_text_is_broken_between_words(capsys, monkeypatch):
    text = "best names 96.9 % of SYNTHETIC recordings right with held-out sessions (95 % interval 90 to 100)"
    for width in (60, 200):  # of a terminal; no line is wider than 80
        monkeypatch.setenv("COLUMNS", str(width))
        show(text)
        lines = capsys.readouterr().out.splitlines()
        assert max(map(len, lines)) <= min(80, width)
        assert " ".join(line.strip() for line in lines) == text


def test_command_is_broken_as_it_can_be_typed(capsys):
    words = [f"--option-{k} value" for k in range(8)]
    show(f"granular-id data convert {' '.join(words)}")
    lines = capsys.readouterr().out.splitlines()
    assert all(line.endswith(" \\") for line in lines[:-1])
    assert "".join(line.removesuffix("\\").lstrip() for line in lines).split()[3:] == " ".join(words).split()


def test_text_too_long_says_what_has_the_rest(capsys):
    show("\n".join(map(str, range(30))), most=10)
    assert capsys.readouterr().out.splitlines()[8:] == ["8", "... 21 more lines: --details"]


@pytest.mark.parametrize(("words", "name"), OUTPUTS, ids=[" ".join(words) for words, _ in OUTPUTS])
def test_what_is_there_is_kept_before_anything_is_read(words, name, tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.chdir(tmp_path)
    there = tmp_path / name
    option = words[-1].replace("-o", "--output")
    same = SAME.get(name) or SAME[there.suffix]
    for file, content, force, said in [
        ("other.npz", ARCHIVE, (), "must end in "),
        ("other.npz", ARCHIVE, ("--force",), "must end in "),
        (name, ARCHIVE, (), "what is there is not "),
        (name, ARCHIVE, ("--force",), "what is there is not "),
        (name, same, (), "there is such a file already; add --force to replace it"),
        (name, same, ("--force",), "nowhere"),
        (name, b"", (), "nowhere"),  # nothing is lost
    ]:
        path = tmp_path / file
        path.write_bytes(content)
        before = digest(path)
        line = refused(*words, path.name, *force)
        assert said in line
        assert said == "nowhere" or option in line
        assert digest(path) == before
    assert {path.name for path in tmp_path.iterdir()} == {"other.npz", name}


@pytest.mark.parametrize(
    ("words", "name"), [(("demo", "-o", "."), "report.html"), (("demo", "-o", "."), "result.json")]
)
def test_what_lies_in_a_folder_is_kept(words, name, tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.chdir(tmp_path)
    (tmp_path / name).write_bytes(SAME[f".{name.partition('.')[2]}"])
    (tmp_path / "holiday.png").write_bytes(ARCHIVE)  # nobody writes this one
    assert f"{words[-2].replace('-o', '--output')} {name}: there is such a file already" in refused(*words)
    (tmp_path / name).write_bytes(ARCHIVE)
    assert f"{name}: what is there is not " in refused(*words, "--force")


def test_what_commands_write_is_replaced_by_force(folder, tmp_path, no_pictures):
    outputs = {"--report": "r.html", "--json": "r.json", "--csv": "p.csv"}
    files = [tmp_path / name for name in outputs.values()]
    words = ["evaluate", folder, "--spaces", "hfmh", "--quiet"]
    words += [word for pair in zip(outputs, files, strict=True) for word in pair]
    ended_well(*words)
    before = [digest(path) for path in files]
    assert "--report" in refused(*words)
    assert [digest(path) for path in files] == before
    for path in files:
        path.write_bytes(path.read_bytes()[:100])
    ended_well(*words, "--force")
    assert all(path.stat().st_size > 100 for path in files)
