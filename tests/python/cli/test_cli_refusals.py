"""What the command line refuses: on one line that names the option or file, with exit code 2 and nothing written."""

import shlex

import numpy as np
import pytest

from cli_cases import LABELS, SMALL, ended_well, make, recording, refused, run, saved, written
from granular_id._checks import argument_error
from granular_id.cli.errors import in_options, words_of
from granular_id.cli.recordings import refuse_unequal
from granular_id.io import load, save
from granular_id.recording import Dataset, Recording
from granular_id.synthetic import synthesize

SMALL_EVALUATION = shlex.join(map(str, SMALL))


@pytest.fixture(scope="module")
def pushes(tmp_path_factory):
    data = synthesize(["rice", "oat flakes"], n_per_class=2, duration_s=1.0, seed=1)
    return save(data, tmp_path_factory.mktemp("data") / "pushes.npz")


@pytest.fixture
def place(tmp_path, monkeypatch):
    """Where commands run: with a file that cannot be read, to be untouched by them."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "broken.npz").write_bytes(b"no recordings in here")
    yield tmp_path
    assert [path.name for path in tmp_path.iterdir()] == ["broken.npz"]
    assert (tmp_path / "broken.npz").read_bytes() == b"no recordings in here"


def holds(line, said):
    """Whether a line holds the parts of what is to be said, which dots divide."""
    return all(part in line for part in said.split(" ... "))


BEFORE_READING = [
    ("evaluate broken.npz --spaces raw,dtf", "there is no feature space 'dtf'; there are raw"),
    ("evaluate broken.npz --spaces ,", "--spaces must name at least one feature space, got ','"),
    ("evaluate broken.npz --spaces raw,raw", "--spaces must name each feature space once"),
    ("evaluate broken.npz --spaces raw --confusion hfmh", "--confusion hfmh is not among"),
    ("evaluate broken.npz --cutoff-hz 80 --rate-hz 100", "--cutoff-hz must be in ... got 80"),
    ("evaluate broken.npz --order 0", "--order must be an integer of at least 1, got 0"),
    ("evaluate broken.npz --n-bins 0", "--n-bins must be an integer"),
    ("evaluate broken.npz --bin-range 2,1", "--bin-range must be finite with low < high"),
    ("evaluate broken.npz --bin-range wide", "--bin-range must be LOW,HIGH such as -1.5,1.5, or auto, got"),
    ("evaluate broken.npz --rate-hz inf", "--rate-hz must be positive and finite, got inf"),
    ("evaluate broken.npz --recorded-hz 0", "--recorded-hz must be positive and finite, got 0"),
    ("evaluate broken.npz --max-gap-s nan", "--max-gap-s must be positive, got nan"),
    ("evaluate broken.npz --n-samples 0", "--n-samples must be at least 1, got 0"),
    ("evaluate broken.npz --n-samples few", "--n-samples must be a whole number or 'shortest', got 'few'"),
    ("evaluate broken.npz --duration-s -1", "--duration-s must be positive and finite, got -1"),
    ("evaluate broken.npz --n-samples 10 --duration-s 1", "one of --duration-s and --n-samples, not both"),
    ("evaluate broken.npz --json absent/r.json", "the folder absent does not exist"),
    ("evaluate broken.npz --json r --csv ./r", "would be written twice"),
    ("evaluate broken.npz --csv .", "is a folder, wanted the name of a file"),
    ("demo -o broken.npz", "broken.npz is or lies in a file, wanted a folder"),
    (
        "evaluate broken.npz --spaces raw,dft --n-bins 7",
        "left out with --spaces raw,dft, which have no use for it",
    ),
    ("explain broken.npz oat oat", "FIRST and SECOND must be two materials, got 'oat' twice"),
    ("explain broken.npz oat rice --space paper", "there is no feature space 'paper'; there are raw"),
    ("explain broken.npz oat rice --figure f.xyz", "--figure must end in .png, .svg or .pdf, got"),
    ("explain broken.npz oat rice --figure a.svg --json a.svg", "a.svg would be written twice"),
    ("train broken.npz -o m --space nose", "--space must be one of 'best', ... got 'nose'"),
    ("train broken.npz -o x.pkl", "--output writes a model: it must end in .safetensors, ... 'x.pkl'"),
    ("train broken.npz -o x.safetensor", "it must end in .safetensors, ... 'x.safetensor'"),
    ("identify", "error: a model file and recordings are needed, got neither: granular-id identify"),
    ("identify absent.safetensors .", "absent.safetensors"),
    ("identify broken.npz .", "broken.npz"),
    ("model info absent.safetensors", "absent.safetensors"),
    ("model info broken.npz", "broken.npz"),
    ("data convert absent broken.npz", "there is something already; nothing is overwritten"),
    ("data convert absent x", "does not say which format is wanted; give --to one of csv, npz, parquet"),
    ("data convert absent x.mat", "can only be read"),
    ("data convert absent no/x.npz", "no such folder"),
    ("data convert absent x --to excel", "--to excel; wanted one of csv"),
    ("data convert absent x --to matlab", "--to matlab; wanted one of csv"),
    ("data convert absent x.npz --to csv", "ends like another format"),
    ("data convert absent x.npz", "absent: no such file or folder"),
    (
        "data convert absent x.npz --max-gap-s 1",
        "error: --max-gap-s is about gaps that resampling fills: add --ra",
    ),
    (
        "data convert absent x.npz --on-gap skip",
        "error: --on-gap is about gaps that resampling fills: add --ra",
    ),
    ("data check absent --false-alarm-rate 2", "--false-alarm-rate must lie between 0 and 1, got 2"),
    ("data plot broken.npz -o x.xyz", "--output must end in .png, .svg or .pdf, got 'x.xyz'"),
    ("data synthesize y.npz --materials 'sand and stone'", "sand and stone"),
]


@pytest.mark.usefixtures("place")
@pytest.mark.parametrize(("typed", "said"), BEFORE_READING)
def test_what_cannot_be_is_refused_before_anything_is_read(typed, said):
    assert holds(refused(*shlex.split(typed)), said)


AFTER_READING = [
    (
        "evaluate {folder} --paper --train 50",
        "class 'oat' has 10 recordings, wanted ... ; add --train 8 --test 2",
    ),
    ("evaluate {folder} {small} --n-samples 999", "too short"),
    (
        "evaluate {folder} --exclude salt",
        "--exclude names 'salt', which is no label here; there are oat, rice, sug",
    ),
    ("evaluate {folder} --exclude oat,rice,sugar", "--exclude leaves no recording"),
    ("evaluate {folder} {small} --exclude oat,rice", "at least 2 classes, got only 'sugar'"),
    ("evaluate {folder} {small} --cutoff-hz 80", "--cutoff-hz must be in ... got 80"),
    (
        "evaluate {folder} --spaces best --C 3",
        "--C must be left out with --spaces best, which brings its own",
    ),
    (
        "evaluate {folder} --spaces best --n-bins 7",
        "--n-bins must be left out with --spaces best, which has no use",
    ),
    ("evaluate {folder} --spaces raw,dft --n-bins 7", "--spaces raw,dft, which have no use for it"),
    (
        "evaluate {folder} --spaces multiband --block-weights unit",
        "--spaces multiband, which always weighs its",
    ),
    ("train {folder} -o m --tare-s 0.1", "--tare-s is not for models, ... : leave it out"),
    ("train {folder} -o m --space hfmh --tare-s 0.1", "--tare-s ... : leave it out; --initial steady keeps"),
    ("train {folder} -o m --space dft", "--space must be one of 'best', 'multiband', 'raw', ... got 'dft'"),
    ("train {folder} -o m --space raw --block-weights unit", "--space raw, which has a single block"),
    ("train {folder} -o m --exclude oat,rice", "at least 2 classes, got only 'sugar'"),
    ("train {folder} -o m --space hfmh --cutoff-hz 80", "--cutoff-hz must be in ... got 80"),
    ("train {folder} -o {folder}/index.csv", "index.csv belongs to {folder}"),
    (
        "explain {folder} oat rice --space multiband --C 3",
        "--C must be left out with --space multiband, which ",
    ),
    ("confidence {folder} --space multiband --C 3", "--C must be left out with --space multiband, which "),
    ("identify {folder}", "are needed, got {folder} alone: granular-id identify"),
    (
        "identify {folder} {model}",
        "{folder} is a folder, wanted a model file, ... the model comes first: granular-id identify MODEL PATH",
    ),
    (
        "model info .",
        "error: . is a folder, wanted a model file, as granular-id train and Identifier.save write",
    ),
    ("identify -m absent.safetensors {model}", "error: absent.safetensors: no such file or folder"),
    ("identify -m {model}", "error: no recordings given: granular-id identify -m MODEL PATH..."),
    ("identify {model} {folder} --lead-s 1 --begin-at first", "--lead-s is time kept"),
    ("identify {model} {folder} --onset-at a=1", "add --begin-at onset"),
    ("model info {model} --json {model}", "belongs to"),
    (
        "data info {folder} --topic /wrench",
        "--topic must be left out where no file is a bag or MCAP: 30 files, the",
    ),
    ("data info {folder} --json {folder}/index.csv", "belongs to"),
    ("data info {pushes} --json {pushes}", "belongs to"),
    ("data check {folder} --json {folder}/index.csv", "belongs to"),
    ("evaluate {folder} --json {folder}/index.csv", "belongs to"),
    ("data convert {folder} x.npz --begin-at trigger", "add --duration-s or --n-samples"),
    ("data convert {folder} x.npz --lead-s 1", "add --begin-at trigger or onset"),
    ("data convert {pushes} x.npz --onset-at rice_00=0.2", "add --begin-at onset"),
    (
        "data convert {folder} x.npz --begin-at trigger --n-samples 9",
        "have no trigger_index ... add --begin-at onset, state it with --onset-at NAME=SECONDS",
    ),
    ("data plot {folder} -o x.png --draw fx,tx", "mixes units"),
    ("data plot {folder} -o x.png --draw force", "must name some of fx"),
    ("data plot {pushes} -o x.png --what onset --draw fx", "--draw does not go with"),
    ("data plot {pushes} -o x.png --what mean -n 3", "-n does not go with"),
    (
        "data plot {pushes} -o x.png --what onset --onset-at rice",
        "must be NAME=SECONDS or NAME=none, got 'rice'",
    ),
    ("data plot {pushes} -o x.png --what onset --onset-at a=1 --onset-at a=2", "names 'a' twice"),
    ("data plot {pushes} -o x.png --what onset --onset-at rice_0=1", "called 'rice_0'"),
]


@pytest.mark.usefixtures("place")
@pytest.mark.parametrize(("typed", "said"), AFTER_READING)
def test_what_does_not_go_with_the_recordings_is_refused(folder, model, pushes, typed, said):
    names = {"folder": folder, "model": model, "pushes": pushes, "small": SMALL_EVALUATION}
    assert holds(refused(*shlex.split(typed.format(**names))), said.format(**names))


@pytest.mark.usefixtures("place")
@pytest.mark.parametrize("command", ["train {} -o m", "explain {} oat rice", "confidence {}"])
@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("--cutoff-hz 11", "error: --cutoff-hz ... --space best"),
        ("--order 4", "error: --order ... --space best"),
        ("--n-bins 50", "error: --n-bins ... --space best"),
        ("--bin-range auto", "error: --bin-range ... --space best"),
        ("--initial steady", "error: --initial ... --space best"),
        ("--block-weights unit", "error: --block-weights ... --space best"),
        ("--C 3", "error: --C ... --space best"),
        (
            "--space raw --n-bins 50",
            "error: --n-bins must be left out with --space raw, which has no use for it",
        ),
        ("--space hfmh --block-weights unit", "--space hfmh, which "),
        ("--space multiband --block-weights unit", "--space multiband, which always weighs its blocks alike"),
    ],
)
def test_options_that_a_space_has_no_use_for_are_refused(folder, command, options, said):
    assert holds(refused(*shlex.split(f"{command.format(folder)} {options}")), said)


@pytest.mark.usefixtures("place")
@pytest.mark.parametrize(
    ("typed", "said"),
    [
        ("evaluate absent --train 0", "'--train': must be at least 1, got 0"),
        ("evaluate absent --test 0", "'--test': must be at least 1, got 0"),
        ("evaluate absent --partitions 0", "'--partitions': must be at least 1, got 0"),
        ("evaluate absent --seed -1", "'--seed': must be at least 0, got -1"),
        ("evaluate absent --threads 0", "'--threads': must be at least 1, got 0"),
        ("evaluate absent --tare-s 0", "'--tare-s': must be positive and finite, got 0"),
        ("evaluate absent --cutoff-hz 0", "'--cutoff-hz': must be positive and finite, got 0"),
        ("evaluate absent --C nan", "'--C': must be positive and finite, got nan"),
        ("confidence absent --share-known 1", "'--share-known': must lie between 0 and 1, got 1"),
        ("demo -o new --seed -1", "'--seed': must be at least 0, got -1"),
        ("demo -o new --threads 0", "'--threads': must be at least 1, got 0"),
        ("train absent -o new --target-error 1.5", "'--target-error': must lie between 0 and 1, got 1.5"),
        ("train absent -o new --coverage 0", "'--coverage': must lie between 0 and 1, got 0"),
        ("train absent -o new --share-known 1", "'--share-known': must lie between 0 and 1, got 1"),
    ],
)
def test_bounds_of_options_are_checked_before_anything_else(typed, said):
    assert refused(*typed.split()).startswith(f"error: invalid value for {said}; see ")


@pytest.mark.parametrize(
    "words",
    [("evaluate",), ("evaluate", "x", "--frobnicate"), ("nonsense",), ("evaluate", "x", "--train", "ten")],
)
def test_unknown_options_and_missing_words_exit_with_two(words):
    result = run(*words)
    assert result.exit_code == 2
    assert "Traceback" not in result.output


# -- recordings that need an option


def test_irregular_stamps_need_a_rate_and_the_proposed_one_works(tmp_path):
    irregular = saved(make(jitter=0.5), tmp_path / "irregular")
    words = ("evaluate", irregular, *SMALL, "--spaces", "hfmh")
    line = refused(*words)
    assert "30 of 30 recordings are sampled irregularly, with a median step of" in line
    assert line.endswith("add --rate-hz 100")
    assert "add --n-samples shortest" in refused(*words, "--rate-hz", 100)
    proposed = ("--rate-hz", 100, "--n-samples", "shortest")
    out = ended_well(*words, *proposed, "--json", tmp_path / "r.json")
    assert "resample: rate_hz=100, max_gap_s=0.25" in out
    assert "dropped_samples" in out
    history = written(tmp_path / "r.json")["data"]["history"]
    assert [step["step"] for step in history] == ["load", "resample", "align"]
    assert len(history[1]["rows"]) == 30


def test_gaps_and_short_recordings_are_left_out_when_asked(tmp_path):
    rng = np.random.default_rng(3)
    hole = recording(rng, 0, 90, jitter=0.5)
    time_s = hole.time_s + (np.arange(60) > 20)
    hole = Recording(hole.wrench, time_s=time_s, label="oat", name="oat/oat_90.csv")
    short = recording(rng, 1, 91, samples=30, jitter=0.5)
    saved(Dataset([*make(jitter=0.5), hole, short]), tmp_path / "x")
    words = ("evaluate", tmp_path / "x", *SMALL, "--rate-hz", 100)
    gap = "'oat/oat_90.csv' has a gap of 1 ... beyond --max-gap-s 0.25; 1 of 32 recordings ... --on-gap skip"
    assert holds(refused(*words), gap)
    line = refused(*words, "--on-gap", "skip", "--n-samples", 40)
    assert holds(line, "'rice/rice_91.csv' is too short ... --on-short skip")
    out = ended_well(*words, "--on-gap", "skip", "--n-samples", 40, "--on-short", "skip")
    assert holds(out, "oat/oat_90.csv ... gap of 1 ... rice/rice_91.csv ... is too short")
    assert "largest_gap_s: 1" in ended_well(*words, "--max-gap-s", "inf", "--n-samples", "shortest")


def test_files_without_time_need_the_rate_they_were_recorded_at(tmp_path):
    rng = np.random.default_rng(0)
    for label in LABELS[:2]:
        (tmp_path / label).mkdir()
        for i in range(9):
            rows = "\n".join(",".join(f"{x:.4f}" for x in row) for row in rng.normal(size=(50, 6)))
            (tmp_path / label / f"{i}.csv").write_text(f"fx,fy,fz,tx,ty,tz\n{rows}\n")
    line = refused("evaluate", tmp_path, *SMALL)
    assert "has no time column and no rate is stated; pass --recorded-hz" in line
    out = ended_well("evaluate", tmp_path, *SMALL, "--recorded-hz", 500, "--details")
    assert "halves in time order, by file order: the recordings carry no start time" in out


@pytest.mark.parametrize("fault", ["broken", "backward", "cut off"])
def test_damaged_files_are_refused_left_out_repaired_or_mentioned(tmp_path, fault):
    data = saved(make(jitter=0.5 if fault == "backward" else 0), tmp_path / "x")
    bad = data / "oat" / "oat_03.csv"
    text = bad.read_text(encoding="utf-8")
    words = ("evaluate", data, *SMALL, "--spaces", "hfmh")
    if fault == "broken":
        bad.write_text(text.replace("fx", "fq", 1), encoding="utf-8")
        assert holds(refused(*words), f"{bad} ... ; add --on-error skip to leave such files out")
        out = ended_well(*words, "--on-error", "skip")
        assert holds(out, f"1 file skipped:\n ... {bad.name}")
    elif fault == "backward":
        lines = text.splitlines()
        lines[5], lines[6] = lines[6], lines[5]
        bad.write_text("\n".join(lines) + "\n", encoding="utf-8")
        words = (*words, "--rate-hz", 100, "--n-samples", "shortest")
        assert holds(refused(*words), f"{bad} ... --on-time-error repair")
        out = ended_well(*words, "--on-time-error", "repair")
        assert "time repaired in 1 recording (1 sample moved): oat/oat_02.csv\n" in out
        assert "30 recordings, 3 materials, 60 samples, irregular in time\n" in out
    else:
        bad.write_text(text.rstrip("\n"), encoding="utf-8")
        assert "may be cut off, in 1 recording: oat/oat_02.csv\n" in ended_well(*words)


def test_no_order_in_time_leaves_halves_out_and_says_so(tmp_path):
    timed = make()
    one = timed[4]
    without = Recording(one.wrench, rate_hz=125.0, label=one.label, name=one.name)
    data = saved(Dataset([*timed[:4], without, *timed[5:]]), tmp_path / "x")
    out = ended_well("evaluate", data, *SMALL, "--details")
    assert f"not halves in time: recording {one.name!r} has no start time" in out
    assert "no start time" in refused("evaluate", data, *SMALL, "--hold-out", "time")


def test_folders_without_recordings_labels_or_samples_are_told(tmp_path):
    (tmp_path / "empty").mkdir()
    assert "holds no recordings" in refused("evaluate", tmp_path / "empty")
    one = saved(make()[:10], tmp_path / "one")
    assert "at least 2 classes, got only 'oat'" in refused("evaluate", one, *SMALL)
    row = "time,fx,fy,fz,tx,ty,tz\n0,1,2,3,4,5,6\n"
    folder = tmp_path / "single"
    folder.mkdir()
    file = folder / "x.csv"
    file.write_text(row, encoding="utf-8")
    assert f"{file}: no recording has a label" in refused("evaluate", file)
    index = folder / "index.csv"
    index.write_text("file,material\nx.csv,rice\n", encoding="utf-8")
    line = refused("evaluate", folder)
    assert line.endswith(f"{folder}: index.csv has no column label (found: file, material)")
    index.write_text("label\nrice\n", encoding="utf-8")  # columns stay what they are, and are no options
    assert "'start_time', 'rate_hz', 'trigger_index'" in refused("data", "info", folder)
    index.unlink()
    for name in ("oat_1", "oat_2", "rice_1", "rice_2"):
        file.with_stem(name).write_text(row, encoding="utf-8")
    file.unlink()
    line = refused("evaluate", folder)
    assert "4 of 4 recordings hold a single sample, the first is 'oat_1.csv'" in line


def test_rates_that_differ_are_refused_with_the_lowest_proposed():
    slow = Recording(np.zeros((9, 6)), rate_hz=50.0, label="a", name="slow")
    fast = Recording(np.zeros((9, 6)), rate_hz=500.0, label="a", name="fast")
    with pytest.raises(ValueError, match=r"sampled at 50 to 500 Hz; .*: add --rate-hz 50"):
        refuse_unequal(Dataset([slow, fast]))


def test_options_that_change_nothing_in_some_spaces_are_noted(folder):
    words = ("evaluate", folder, *SMALL, "--spaces", "hfmh,raw,dft", "--no-baselines")
    assert "note: --n-bins changes nothing in raw, dft\n" in ended_well(*words)
    assert "changes nothing" not in ended_well(*words, "--quiet")


# -- words of an error


@pytest.mark.parametrize(("debug", "error"), [(False, ZeroDivisionError), (True, ValueError)])
def test_an_error_that_is_not_the_users_keeps_its_traceback_and_with_debug_every_one(
    folder, monkeypatch, debug, error
):
    def broken(*args, **kwargs):
        raise error

    monkeypatch.setattr("granular_id.io.load", broken)
    if debug:
        monkeypatch.setenv("GRANULAR_ID_DEBUG", "1")
    assert isinstance(run("evaluate", folder).exception, error)


def test_messages_speak_in_options():
    assert in_options("raise max_gap_s=0.25\n or on_gap='skip'") == "raise --max-gap-s 0.25 or --on-gap skip"
    assert in_options("train_per_class must be 1") == "--train must be 1"
    for untouched in (
        "/data/n_bins/x.csv: broken",
        "'n_bins'",
        "the order of files",
        "files in order must",
        "no_rate_hz",
        "nor among what is known of it (meta: frame, lead_s, rest_s=1)",
        "there is no column 'nope'; there are fx, rate_hz",
        "no recording states it; those that can be: session (12 values), lead_s (12 values)",
        "save texts as numpy.array(texts, dtype=str)",
        "Dataset.from_arrays(f['X'].transpose(1, 0, 2), f['y'], rate_hz=float(numpy.ravel(f['fs'])[0]))",
        "Dataset.from_frames({name: f[name] for name in f.dtype.names}, rate_hz=RATE)",
    ):
        assert in_options(untouched) == untouched
    for argument, option in {"C": "--C", "order": "--order", "by": "--hold-out", "format": "--to"}.items():
        assert words_of(argument_error(ValueError, argument, "is wrong")) == f"{option} is wrong"
    assert words_of(FileNotFoundError("C: no such file or folder")) == "C: no such file or folder"
    gap = argument_error(ValueError, "on_gap", "='x'; wanted 'raise' or 'skip'")
    assert str(gap) == "on_gap='x'; wanted 'raise' or 'skip'"
    assert words_of(gap) == "--on-gap x; wanted 'raise' or 'skip'"
    rate = argument_error(ValueError, "rate_hz", "must be positive")
    assert words_of(rate, rate_option="--recorded-hz") == "--recorded-hz must be positive"


def test_the_default_of_gaps_is_that_of_the_library():
    from granular_id.cli.recordings import MAX_GAP_S
    from granular_id.recording import clock

    assert MAX_GAP_S == clock.MAX_GAP_S


USAGE = [
    ("explain", "missing argument 'PATH'"),
    ("explain . rice", "missing argument 'SECOND'"),
    ("live --source sim:rice", "missing option '--model' / '-m'"),
    ("evaluate . --nope", "no such option: --nope"),
    ("train . --seed x", "invalid value for '--seed': "),
    ("nothing", "no such command 'nothing'"),
    ("data nothing", "no such command 'nothing'"),
    ("record --n", "option '--n' requires an argument"),
]


@pytest.mark.parametrize(("typed", "said"), USAGE)
def test_wrong_usage_is_said_on_one_line_as_all_else(typed, said):
    line = refused(*shlex.split(typed))
    assert line.startswith(f"error: {said}")
    assert line.endswith(" --help") or "requires" in line


@pytest.mark.parametrize("typed", ["", "data", "model"])
def test_a_group_without_a_command_prints_its_help(typed):
    result = run(*shlex.split(typed))
    assert result.exit_code == 2
    assert "Usage: " in result.output
    assert "error" not in result.output


# -- labels with blanks


def test_labels_with_blanks_are_typed_with_underscores_everywhere(tmp_path):
    words = ("--materials", "rice,oat_flakes,fine_sugar", "--per-class", 4, "--rate-hz", 100)
    ended_well("data", "synthesize", tmp_path / "x.npz", *words)
    file = tmp_path / "x.npz"
    assert "oat flakes" in ended_well("data", "info", file)
    out = ended_well("explain", file, "rice", "oat_flakes", "--exclude", "fine_sugar", "--space", "raw")
    assert "--exclude left out fine sugar" in out
    assert "oat flakes" in out
    assert "'oat_meal', which is no label here" in refused(
        "explain", file, "rice", "oat_meal", "--space", "raw"
    )
    record = ("--source", "sim:", "--n", 1, "--speed", 50, "--duration-s", 0.5)
    ended_well("record", *record, "--label", "oat_flakes", "-o", tmp_path / "pushes")
    assert load(tmp_path / "pushes").labels == ("oat flakes",)
