"""What the command line refuses: in a few words that name the option or file, with exit code 2 and nothing written."""

import shlex
import warnings
from unittest.mock import Mock

import pytest

from cli_cases import refused, run
from granular_id import _core
from granular_id._checks import argument_error


@pytest.fixture
def place(tmp_path, monkeypatch):
    """Where commands run: with a file that cannot be read, to be untouched by them."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "broken.npz").write_bytes(b"no recordings in here")
    yield tmp_path
    assert [path.name for path in tmp_path.iterdir()] == ["broken.npz"]
    assert (tmp_path / "broken.npz").read_bytes() == b"no recordings in here"


def holds(line, message):
    """Whether a line holds the parts of a message, which dots divide."""
    return all(part in line for part in message.split(" ... "))


BEFORE_READING = [
    ("evaluate broken.npz --bin-range 2", "--bin-range must be LOW,HIGH such as -1.5,1.5, or auto, got '2'"),
    ("evaluate broken.npz --spaces raw,dft --cutoff-hz 5", "the histogram (hfmh), none of raw,dft has one"),
    ("evaluate broken.npz --bin-range 1,inf", "with LOW below HIGH, got '1,inf'"),
    ("evaluate broken.npz --spaces raw,dtf", "--spaces must be one of ... got 'dtf'; did you mean 'dft'?"),
    ("evaluate broken.npz --spaces bset", "--spaces must be one of ... 'paper', 'all', got 'bset'; did you"),
    ("evaluate broken.npz --spaces raw,raw", "--spaces must name at least one feature space, each once"),
    ("evaluate broken.npz --paper 2,6,3 --hold-out tool", "--hold-out tool has no use with --paper"),
    ("evaluate broken.npz --paper 20,50", "--paper must be PARTITIONS,TRAIN,TEST such as 20,50,12"),
    ("evaluate broken.npz --json absent/r.json", "the folder absent does not exist"),
    ("evaluate broken.npz --json r --csv ./r", "would be written twice"),
    ("evaluate broken.npz --csv .", "is a folder, wanted the name of a file"),
    ("demo -o broken.npz", "broken.npz is or lies in a file, wanted a folder"),
    ("train broken.npz -o m --space nose", "--space must be one of 'best', ... got 'nose'"),
    ("train broken.npz -o m --cutoff-hz 5", "are about the histogram (hfmh), best has none"),
    ("train broken.npz -o x.pkl", "--output writes a model: it must end in .safetensors, ... 'x.pkl'"),
    ("confidence broken.npz --levels 0.9,1", "--levels must be numbers between 0 and 1"),
    ("identify broken.npz .", "broken.npz"),
    ("identify broken.npz x.npz -o out --csv x.csv", "--csv does not go with -o"),
    ("identify broken.npz . --jobs 2", "--jobs is about archives and -o"),
    ("identify broken.npz . --figure f.png", "--figure draws answers over all of a recording, with --hop-s"),
    ("model broken.npz", "broken.npz"),
    ("data convert absent broken.npz --force", "what is there is not a data set; give another name"),
    ("data convert absent .", "is a folder, --force replaces files only"),
    ("data synthesize . --force", "is a folder, --force replaces files only"),
    ("data convert absent x.mat", "x.mat cannot be written: wanted a name that ends in .npz"),
    ("data convert absent no/x.npz", "no such folder"),
    ("data convert absent x.npz", "absent: no such file or folder"),
    ("data convert absent x.npz --max-gap-s 1", "--max-gap-s is about gaps ... add --resample-hz"),
    ("data convert absent x.npz --begin-at onset", "--begin-at onset crops recordings: add --duration-s"),
    ("data convert absent x.npz --lead-s 1", "add --begin-at trigger or onset"),
    ("data convert absent x.npz --duration-s few", "must be seconds, or shortest, got 'few'"),
    ("data convert absent x.npz --csv skiprows", "--csv must be KEY=VALUE ... got 'skiprows'"),
    ("data convert absent x.npz --gravity 0,0,1", "add --compensate"),
    ("data convert absent x.npz --frame =0,0,90", "--frame must be NAME, or NAME=roll,pitch,yaw"),
    ("data convert absent x.npz --compensate nowhere.json", "nowhere.json: no such file"),
    ("data plot broken.npz -o x.xyz", "--output ... must end in .png or .svg or .pdf, got 'x.xyz'"),
    ("data plot broken.npz -o x.png --what mean -n 3", "-n does not go with"),
    ("setup payload absent -o t.json", "absent: no such file or folder"),
    ("adapt a.safetensors b.safetensors -o c", "is no recordings but a model file: MODEL comes first"),
    ("adapt broken.npz broken.npz -o c", "give --labelled, ... neither is given"),
    ("extract broken.npz -o out --space raw --model m", "--space and --model both say which features"),
    ("archive info absent", "absent: no such file or folder"),
    ("archive add new absent", "absent: no such file or folder"),
    ("archive add . .", "give the archive another place"),
    ("archive add . broken.npz", "give the archive another place"),
    ("record --source sim:?seed=4 -o x --label ,", "--label must name at least one material"),
    ("record --source sim:?seed=4 -o x --label rice,rice", "must name each material once, got 'rice,rice'"),
    ("record --source sim:?seed=4 -o x --label rice,suger", "'suger'; known: dry peas, rice"),
    ("record --source sim:?seed=4 -o x --label rice --session ' '", "--session is empty"),
    ("record --source sim:?seed=4 -o x --label rice --direction 1,0", "such as 0,-1,0, got '1,0'"),
    ("record --source sim:?seed=4 -o x --label rice --robot ur", "must be one of auto, none, manual, source"),
    (
        "record --source sim:?seed=4 -o x.npz --label rice",
        "an archive, x.parquet, got 'x.npz': granular-id data",
    ),
    ("record --source simm:rice -o x --label rice", "'simm'; known: bota, rdt"),
    ("record --source replay:nowhere -o x --label rice", "nowhere: no such file or folder"),
    ("live --source sim:?seed=4 --model m --no-browser", "is about the page of --view: leave it out"),
    ("live --source sim:?seed=4 --model m --early --archive seen", "with --early there are none"),
    (
        "live --source sim:?seed=4 --model m --hop-s 1 --early",
        "--early is about pushes; with --hop-s answers go on",
    ),
    ("live --source sim:?seed=4 --model m --hop-s 1 --robot manual", "--robot is about pushes"),
    ("live --source sim:?seed=4 --model m --hop-s 1 --direction=-1,0,0", "--direction is about pushes"),
    ("live --source sim:?seed=4 --model m --hop-s 1 --archive seen", "--archive is about pushes"),
    ("live --source sim:?seed=4 --model no.safetensors", "no.safetensors"),
]


@pytest.mark.usefixtures("place")
@pytest.mark.parametrize(("typed", "message"), BEFORE_READING)
def test_option_that_cannot_be_is_refused_first(typed, message):
    assert holds(refused(*shlex.split(typed)), message)


AFTER_READING = [
    ("evaluate {folder} --paper 20,50,12", "class 'oat' has 10 recordings, wanted ... (--paper 20,8,2)"),
    ("evaluate {folder} --hold-out speed", "--hold-out='speed' cannot be held out ... of index.csv"),
    ("evaluate {folder} --json {folder}/index.csv", "index.csv belongs to {folder}"),
    ("evaluate {folder} --csv {folder}/p.csv", "p.csv would be taken for a recording of {folder}"),
    ("explain {folder} oat oat", "FIRST and SECOND must be two materials, got 'oat' twice"),
    ("explain {folder} oat salt", "SECOND is 'salt', which is no label here; there are oat, rice, sugar"),
    ("train {folder} -o m --background salt", "background names 'salt', of which there is no recording"),
    ("identify {folder} {model}", "MODEL comes first, got {folder}: granular-id identify MODEL PATH"),
    ("identify {model} {folder} {folder} -o out", "-o takes the answers about one archive, got 2: name one"),
    ("archive add {folder}/fleet {folder}", "give the archive another place"),
    ("model {model} --json {model}", "belongs to"),
    ("live --source sim:rice --model {model}", "is for 125 Hz, simulated rice delivers 500 Hz"),
    ("data convert {folder} x.npz --tare-s 9 --on-error skip", "none of 30 recordings has 9 s of rest"),
    ("setup payload {folder} -o t.json", "error: gravity must be given"),  # there is no --gravity here
]


@pytest.mark.usefixtures("place")
@pytest.mark.parametrize(("typed", "message"), AFTER_READING)
def test_what_does_not_go_with_the_recordings_is_refused(folder, model, typed, message):
    names = {"folder": folder, "model": model}
    assert holds(refused(*shlex.split(typed.format(**names))), message.format(**names))


USAGE = [
    ("evaluate absent --seed -1", "invalid value for '--seed': "),
    ("data convert absent x.npz --resample-hz inf", "invalid value for '--resample-hz': must be positive"),
    ("train absent -o new --target-error 1.5", "invalid value for '--target-error': must lie between 0"),
    ("explain", "missing argument 'PATH'"),
    ("live --source sim:rice", "missing option '--model' / '-m'"),
    ("evaluate . --nope", "no such option: --nope"),
    ("nothing", "no such command 'nothing'"),
    ("extract . -o ''", "invalid value: an argument is an empty text"),
    ("data plot . --what x", "invalid value for '--what': 'x' is not one of 'recordings'"),
]


@pytest.mark.parametrize(("typed", "message"), USAGE)
def test_wrong_usage_is_refused_as_all_else(typed, message):
    line = refused(*shlex.split(typed))
    assert line.startswith(f"error: {message}")
    assert line.endswith(" --help")


@pytest.mark.parametrize("typed", ["", "data", "archive"])
def test_group_without_a_command_prints_its_help(typed):
    result = run(*shlex.split(typed))
    assert result.exit_code == 2
    assert "Usage: " in result.output
    assert "error" not in result.output


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (argument_error(_core.GranularIdError, "by", "is wrong"), "--hold-out is wrong"),
        (argument_error(_core.GranularIdError, "bin_range", "='x'; wanted"), "--bin-range='x'; wanted"),
        (argument_error(_core.GranularIdError, "data", "is wrong"), "data is wrong"),  # none of its options
        (FileNotFoundError(2, "No such file", "a.csv"), "a.csv: no such file"),
        (FileNotFoundError("seed: no such file or folder"), "seed: no such file or folder"),
    ],
)
def test_refusal_begins_with_the_option_of_its_argument(folder, monkeypatch, error, message):
    monkeypatch.setattr("granular_id.io.load", lambda *_, **__: (_ for _ in ()).throw(error))
    assert refused("evaluate", folder) == f"error: {message}"


@pytest.mark.filterwarnings("default")
def test_warning_of_the_library_is_one_line(folder, monkeypatch):
    monkeypatch.setattr("granular_id.io.load", lambda *_, **__: warnings.warn("of 1 N", stacklevel=1))
    assert run("evaluate", folder).stderr.startswith("warning: of 1 N\n")


@pytest.mark.parametrize("bug", [ValueError("foreign"), TypeError("foreign")])
def test_bug_keeps_its_traceback(folder, monkeypatch, bug):
    monkeypatch.setattr("granular_id.io.load", Mock(side_effect=bug))
    assert run("evaluate", folder).exception is bug
