"""`adapt`: the model it writes is that of the library; what it prints, and refuses."""

from dataclasses import replace

import numpy as np
import pytest

from cli_cases import ended_well, make, refused, run, saved
from granular_id import save
from granular_id.identifier import Identifier, adapt as adapting
from granular_id.io import load
from granular_id.recording import Dataset
from granular_id.synthetic import synthesize
from model_cases import with_trained


def moved(n, *, labels=True, **fields):
    """The small recordings in another set-up: other gains, another zero, another session."""
    data = make(n, **fields)
    return Dataset(
        [
            replace(r, wrench=1.2 * r.wrench + 0.3, session="elsewhere", label=r.label if labels else None)
            for r in data
        ]
    )


@pytest.fixture(scope="module")
def fresh(tmp_path_factory):
    """Five labelled recordings of each material."""
    return saved(moved(5), tmp_path_factory.mktemp("adapt") / "fresh")


@pytest.fixture(scope="module")
def nameless(tmp_path_factory):
    """The same without labels."""
    return save(moved(5, labels=False), tmp_path_factory.mktemp("adapt") / "nameless.npz")


def weights(model):
    return model.core.coef.tobytes(), model.core.intercept.tobytes()


@pytest.mark.parametrize("word", ["--labelled", "--all-materials"])
def test_adapt_writes_the_model_of_the_library(model, fresh, tmp_path, word):
    before = model.read_bytes()
    ended_well("adapt", model, fresh, "-o", tmp_path / "new.safetensors", word)
    data = load(fresh)
    way = {"labels": data.y} if word == "--labelled" else {"all_materials": True}
    wanted = Identifier.load(model).adapt(data, **way)
    assert weights(Identifier.load(tmp_path / "new.safetensors")) == weights(wanted)
    assert model.read_bytes() == before


@pytest.mark.parametrize(
    ("words", "came"), [([], "neither is given"), (["--labelled", "--all-materials"], "not both")]
)
def test_adapt_in_neither_or_both_ways_is_refused(model, fresh, tmp_path, words, came):
    line = refused("adapt", model, fresh, "-o", tmp_path / "new.safetensors", *words)
    assert line.startswith(
        "error: give --labelled, to take the labels of a few recordings of each material, or "
    )
    assert line.endswith(f"--all-materials, where the recordings hold all materials about equally: {came}")


def test_allow_missing_goes_with_labels(model, fresh, tmp_path):
    words = ("--all-materials", "--allow-missing")
    line = refused("adapt", model, fresh, "-o", tmp_path / "new.safetensors", *words)
    assert line == "error: leave out --allow-missing: --all-materials declares that no material is missing"


def test_what_was_done_and_what_comes_next_is_printed(model, fresh, tmp_path):
    new = tmp_path / "new.safetensors"
    out = ended_well("adapt", model, fresh, "-o", new, "--labelled")
    for line in (
        "15 recordings, 3 materials, 60 samples at 125 Hz\n",
        "adapted by 15 labelled recordings, ",
        "after, each named by a model made without it\n",
        f"wrote {new}\n",
        f"granular_id.cli identify {new} PATH\n",
        f"live --model {new} --source URL --pre-s SECONDS\n",  # the model does not know its rest
    ):
        assert line in out, out
    assert "SYNTHETIC" not in out


@pytest.mark.filterwarnings("default")
def test_a_warning_is_a_line(model, tmp_path):
    one = save(Dataset([r for r in moved(5) if r.label == "rice"]), tmp_path / "one.npz")
    words = ("--labelled", "--allow-missing")
    ended = run("adapt", model, one, "-o", tmp_path / "new.safetensors", *words)
    assert (
        "warning: all recordings are of one material, rice: the set-up cannot be told from it" in ended.stderr
    )


def test_quiet_leaves_what_was_done(model, nameless, tmp_path):
    out = ended_well(
        "adapt", model, nameless, "-o", tmp_path / "new.safetensors", "--all-materials", "--quiet"
    )
    assert out.startswith("adapted by 15 recordings declared to hold all materials, ")
    assert "balanced accuracy" not in out
    assert "PATH" not in out
    assert "wrote" in out


def test_a_declared_model_takes_labels_and_says_so(model, fresh, tmp_path):
    first, second = tmp_path / "first.safetensors", tmp_path / "second.safetensors"
    ended_well("adapt", model, fresh, "-o", first, "--all-materials")
    ended_well("adapt", first, fresh, "-o", second, "--labelled")
    told = ended_well("model", "info", second)
    (line,) = (line for line in told.splitlines() if line.startswith("adapted: "))
    assert line.startswith("adapted: by 15 labelled recordings, ")
    assert "accuracy: not known: the model was adapted to another set-up" in told
    ended_well("identify", second, fresh)


def test_recordings_come_to_the_model_as_for_identify(model, tmp_path):
    long = save(moved(3, samples=200), tmp_path / "long.npz")
    new = tmp_path / "new.safetensors"
    line = refused("adapt", model, long, "-o", new, "--labelled")
    assert line.endswith("state --lead-s or pass --begin-at first")
    ended_well("adapt", model, long, "-o", new, "--labelled", "--begin-at", "first")
    data = load(long)
    wanted = Identifier.load(model).adapt(data, data.y, begin_at="first")
    assert weights(Identifier.load(new)) == weights(wanted)


def test_a_refused_frame_is_accepted(tmp_path):
    def framed(name, frame, data):
        return save(Dataset([replace(r, meta={"frame": frame}) for r in data]), tmp_path / name)

    model, new = tmp_path / "m.safetensors", tmp_path / "new.safetensors"
    Identifier.fit(load(framed("old.npz", "flange", make(4))), "hfmh", estimate=False).save(model)
    other = framed("new.npz", "table", moved(4))
    words = ("adapt", model, other, "-o", new, "--labelled")
    assert refused(*words).endswith("add --accept frame")
    out = ended_well(*words, "--accept", "frame")
    assert "set-up: frame 'table', in training 'flange'" in out


def test_synthetic_recordings_are_called_so(tmp_path):
    data = synthesize(["rice", "fine sugar"], n_per_class=4, duration_s=0.5)
    model = tmp_path / "m.safetensors"
    Identifier.fit(data, "hfmh", estimate=False).save(model)
    words = ("adapt", model, save(data, tmp_path / "d.npz"), "-o", tmp_path / "new.safetensors")
    out = ended_well(*words, "--all-materials")
    assert "SYNTHETIC recordings and a model of such: this says nothing about real materials" in out


# Refused, in options.


def test_the_model_itself_is_replaced_only_when_asked(model, fresh, tmp_path):
    own = tmp_path / "own.safetensors"
    own.write_bytes(model.read_bytes())
    words = ("adapt", own, fresh, "-o", own, "--labelled")
    line = refused(*words)
    assert "is MODEL itself: give the new model another name, or add --force to replace MODEL" in line
    assert own.read_bytes() == model.read_bytes()
    ended_well(*words, "--force")
    assert "adapted" in Identifier.load(own).trained


def test_outputs_are_checked_first(model, fresh, tmp_path):
    def said(model, recordings, output):
        return refused("adapt", model, recordings, "-o", output, "--labelled")

    other = tmp_path / "there.safetensors"
    other.write_bytes(model.read_bytes())
    assert "there is such a file already; add --force" in said(model, fresh, other)
    assert "must end in .safetensors" in said(model, fresh, tmp_path / "new.csv")
    assert "no such file or folder" in said(model, tmp_path / "no", tmp_path / "new")
    assert "no such file or folder" in said(tmp_path / "no", fresh, tmp_path / "new")


def test_the_model_comes_first(model, fresh, tmp_path):
    line = refused("adapt", fresh, model, "-o", tmp_path / "new", "--labelled")
    assert line.endswith("is no recordings but a model file: MODEL comes first, then RECORDINGS")


def test_a_refusal_writes_nothing(model, fresh, tmp_path, monkeypatch):
    monkeypatch.setattr(adapting, "_new_model", lambda *_, **__: (_ for _ in ()).throw(ValueError("full")))
    refused("adapt", model, fresh, "-o", tmp_path / "new.safetensors", "--labelled")
    assert list(tmp_path.iterdir()) == []


def test_too_few_recordings_are_refused_in_options(model, tmp_path):
    few = save(moved(5)[np.arange(8)], tmp_path / "few.npz")
    line = refused("adapt", model, few, "-o", tmp_path / "new", "--all-materials")
    assert (
        "error: --all-materials needs 3 recordings a material in the mean, 9 for 3 materials, got 8" in line
    )
    assert line.endswith("record more, or add --labelled in its place")


def test_missing_materials_are_named_and_allowed(model, tmp_path):
    some = save(moved(4)[np.arange(8)], tmp_path / "some.npz")
    new = tmp_path / "new.safetensors"
    line = refused("adapt", model, some, "-o", new, "--labelled")
    assert "sugar is missing" in line
    assert line.endswith("record them, or add --allow-missing")
    out = ended_well("adapt", model, some, "-o", new, "--labelled", "--allow-missing")
    assert "materials that were missing, and gain nothing: sugar" in out


def test_labels_that_are_missing_or_unknown_are_refused(model, nameless, tmp_path):
    line = refused("adapt", model, nameless, "-o", tmp_path / "new", "--labelled")
    assert "15 recordings have no label, the first is " in line
    salt = save(Dataset([replace(r, label="salt") for r in moved(1)]), tmp_path / "salt.npz")
    line = refused("adapt", model, salt, "-o", tmp_path / "new", "--labelled")
    assert (
        line
        == "error: every label must be one that the model knows (granular-id model info MODEL), got 'salt'"
    )


def test_a_model_that_keeps_nothing_of_its_training_says_the_way_out(model, fresh, tmp_path):
    known = Identifier.load(model)
    trained = {name: value for name, value in known.trained.items() if name != "source"}
    old = tmp_path / "old.safetensors"
    Identifier(with_trained(known.core, trained)).save(old)
    line = refused("adapt", old, fresh, "-o", tmp_path / "new", "--labelled")
    assert "learners on 420 features are too many; train one on a pipeline that ends in " in line


def test_an_adapted_model_is_not_declared_again(model, fresh, tmp_path):
    new = tmp_path / "new.safetensors"
    ended_well("adapt", model, fresh, "-o", new, "--labelled")
    line = refused("adapt", new, fresh, "-o", tmp_path / "newer", "--all-materials")
    assert line.startswith("error: --all-materials starts from the columns of the training")
    assert line.endswith("adapt the model that it was made from")
