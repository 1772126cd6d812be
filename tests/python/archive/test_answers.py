"""Answers about an archive are those that the model gives of its recordings loaded, to the last bit."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

import granular_id as gid
from archive_cases import files_in, poison, samples_in, small_partitions
from granular_id._core import FeatureSpec
from granular_id.archive import Answers, Archive, PartitionError, append, extract, identify
from granular_id.archive.answers import COLUMNS, MODEL, AnswersSpec
from granular_id.archive.partitions import one_of_each, partitions_of, process_partition
from granular_id.identifier import Identifier, identify_all
from granular_id.io import load
from granular_id.io.parquet.writing import save_parquet
from granular_id.recording import Dataset, Recording, SampleFlag, StepReport
from granular_id.recording.onset import ONSET_STEP

LABELS = ("oat flakes", "rice", "sugar")
N_SAMPLES, LEAD = 60, 10


def pushes(n=24, *, seed=0, n_samples=N_SAMPLES, **fields):
    """Recordings of three materials that begin to move at their trigger."""
    rng = np.random.default_rng(seed)
    every = []
    for i in range(n):
        wrench = np.round(rng.normal(0.1 * (i % 3), 0.3 + 0.06 * (i % 3), (n_samples, 6)) * 64) / 64
        about = {"label": LABELS[i % 3], "session": f"day {i % 2}", "name": f"push {i}"}
        every.append(Recording(wrench, rate_hz=500, **{**about, "trigger_index": LEAD, **fields}))
    return Dataset(every)


@pytest.fixture(scope="module")
def trained():
    return pushes(30, meta={"frame": "flange", "sensor": "Mini45", "trigger": "motion"})


@pytest.fixture(scope="module")
def model(trained):
    return Identifier.fit(trained, "hfmh", coverage=0.8)


def rows_of(answers):
    return answers.table.select(["name", "label", *COLUMNS]).to_pylist()


def expected(model, data):
    """What `granular-id identify` answers of a data set."""
    rows = []
    for one in identify_all(model, model.requirements.crop(data)).each():
        about = {"label": one.pop("truth"), "answer": one["label"]}
        rows.append({**one, **about, **{name: list(one[name]) for name in ("candidates", "warnings")}})
    return rows


def answered(model, data, tmp_path, **options):
    archive = save_parquet(data, tmp_path / "archive", recordings_per_group=5)
    return identify(archive, model, tmp_path / "out", progress=False, **options)


def mixed(trained):
    """Recordings of the training and fresh ones, longer ones, flagged ones, one without a label."""
    flags = np.zeros(N_SAMPLES, np.uint8)
    flags[[3, 7]] = SampleFlag.SATURATED
    fresh = list(pushes(12, seed=1))
    fresh[2] = replace(fresh[2], flags=flags)
    fresh[4] = replace(fresh[4], label=None)
    longer = [replace(one, trigger_index=LEAD + k) for k, one in enumerate(pushes(6, seed=2, n_samples=90))]
    padded = np.vstack([np.zeros((5, 6)), trained[0].wrench, np.zeros((5, 6))])
    longer[5] = replace(trained[0], wrench=padded, trigger_index=LEAD + 5)  # the model knows it, cropped
    early = np.zeros(90, np.uint8)
    early[0] = SampleFlag.BAD_STATUS  # cropped away
    longer[3] = replace(longer[3], flags=early)
    return Dataset([*trained[3:9], *fresh, *longer])


@pytest.mark.parametrize("space", ["hfmh", "raw+hfmh", "multiband"])
def test_answers_are_those_of_recordings_loaded(trained, space, tmp_path, monkeypatch):
    small_partitions(monkeypatch, 10)
    own = Identifier.fit(trained, space, coverage=0.8)
    data = mixed(trained)
    answers = answered(own, data, tmp_path, n_jobs=2)
    assert rows_of(answers) == expected(own, data)
    assert answers.extraction.n_partitions == 3


def test_answers_of_a_model_without_marks_have_no_trained_on(tmp_path):
    from model_cases import random_model

    axes = {"axes": '["fx", "fy", "fz", "tx", "ty", "tz"]', "units": '["N", "N", "N", "N m", "N m", "N m"]'}
    core = random_model(0, 3, N_SAMPLES, 6, spec=FeatureSpec(n_bins=5), metadata={**axes, "lead_s": ""})
    assert answered(Identifier(core), pushes(6), tmp_path).table["trained_on"].to_pylist() == [None] * 6


def test_recordings_that_do_not_hold_the_length_have_no_answer(model, tmp_path):
    longer = [replace(one, trigger_index=k) for k, one in enumerate(pushes(12, n_samples=64))]
    without = [replace(one, trigger_index=None) for one in pushes(3, seed=1, n_samples=70)]
    data = Dataset([*longer, *pushes(3), *without, *pushes(3, n_samples=40)])
    answers = answered(model, data, tmp_path)
    starts = [0 if one.n_samples <= N_SAMPLES else (one.trigger_index or 0) - LEAD for one in data]
    fits = [0 <= start <= one.n_samples - N_SAMPLES for start, one in zip(starts, data, strict=True)]
    cropped = model.requirements.crop(data[fits])
    assert [row for row in rows_of(answers) if row["answer"]] == expected(model, cropped)
    n_without = len(data) - len(cropped)
    assert f"{n_without} recordings without an answer: too short, or no trigger" in answers.summary().notes


def last_of(**fields):
    """Eight recordings like those of the training, and one that is not."""
    return Dataset([*pushes(8), replace(pushes(1)[0], **fields)])


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (last_of(rate_hz=250), "has 250 Hz, the model was trained at 500 Hz"),
        (last_of(meta={"frame": "tool"}), "frame 'tool', in training 'flange'"),
        (pushes(4).select(axes=["fx", "fy"]), "has the axes fx fy; the model was trained on"),
        (pushes(4, n_samples=40), "'push 0' has 40 samples and no trigger .* takes 60; all 4 recordings are"),
    ],
    ids=["rate", "frame", "axes", "lengths"],
)
def test_what_does_not_fit_is_refused_before_any_work(model, tmp_path, data, message):
    with pytest.raises(gid.GranularIdError, match=message):
        answered(model, data, tmp_path)
    assert not (tmp_path / "out").exists()


def test_setup_that_differs_is_warned_of_once(model, tmp_path):
    message = "another set-up than in the training: sensor 'Nano17', in training 'Mini45'"
    with pytest.warns(UserWarning, match=f"^{message}$") as caught:
        answered(model, pushes(11, meta={"sensor": "Nano17"}), tmp_path)
    assert len(caught) == 1
    assert caught[0].filename == answered.__code__.co_filename


def test_setup_of_an_archive_knows_its_steps(model, tmp_path):
    append(tmp_path, Dataset(pushes(6).recordings, (StepReport(ONSET_STEP),)))
    message = ("trigger 'onset', in training 'motion'",)
    assert model.requirements.check(load(tmp_path)) == message
    assert model.requirements.check(one_of_each(Archive(tmp_path), 500.0)) == message


def test_model_lies_beside_its_answers_and_is_compared(model, tmp_path):
    model.save(tmp_path / "kitchen.safetensors")
    answers = answered(tmp_path / "kitchen.safetensors", pushes(6), tmp_path)
    assert (answers.folder / MODEL).read_bytes() == model.core.to_bytes()
    spec = AnswersSpec(str(answers.folder / MODEL), answers.spec["answers"]["model"])
    partition = partitions_of(Archive(tmp_path / "archive"))[0]
    assert len(pickle.dumps((partition, spec))) < 1000
    with pytest.raises(gid.GranularIdError, match="is no longer the model that answers here"):
        process_partition(partition, replace(spec, sha256="0" * 64))


def test_answers_of_another_model_are_refused(model, trained, tmp_path):
    answers = answered(model, pushes(6), tmp_path)
    before = files_in(answers.folder)
    other = Identifier.fit(trained, "raw", estimate=False)
    with pytest.raises(gid.GranularIdError, match=r"other work already: model '.*; name another folder"):
        identify(tmp_path / "archive", other, answers.folder, progress=False)
    with pytest.raises(gid.GranularIdError, match=r"already: .*answers.* there, .*features.* wanted; name"):
        extract(tmp_path / "archive", answers.folder, progress=False)
    assert files_in(answers.folder) == before


def test_answers_of_a_damaged_row_group_are_left_out(model, tmp_path, monkeypatch):
    archive = save_parquet(pushes(20), tmp_path / "archive", recordings_per_group=5)
    poison(samples_in(archive), 1)
    small_partitions(monkeypatch, 5)
    with pytest.raises(PartitionError, match="row group 1"):
        identify(archive, model, tmp_path / "out", progress=False)
    with pytest.raises(FileNotFoundError, match=r"answers are not finished.*partial=True"):
        Answers(tmp_path / "out")
    answers = Answers(tmp_path / "out", partial=True)
    assert len(answers) == 15
    assert "not finished: these are the answers that there are" in answers.summary().notes


def test_summary_counts_as_a_batch_does(model, trained, tmp_path):
    data = mixed(trained)
    batch = identify_all(model, model.requirements.crop(data))
    each = list(batch.each())
    table = answered(model, data, tmp_path).summary()
    assert table.title == "Materials named in 24 recordings"
    assert table.header == ("material", "answers", "share", "recordings of it", "named rightly")
    for name, answers, _, true, rightly in table.rows:
        of_it = [one["label"] == name for one in each if one["truth"] == name]
        assert (int(answers), int(true)) == (int((batch.labels == name).sum()), len(of_it))
        assert rightly == f"{100 * np.mean(of_it):.1f} %"
    assert table.notes[: len(batch.table().notes)] == batch.table().notes
    unknown, several = sum(one["unknown"] for one in each), sum(len(one["candidates"]) > 1 for one in each)
    notes = "\n".join(table.notes)
    assert f"\n{unknown} of 24 answers like no known" in notes
    assert f"\n{several} of 24 answers with several candidates" in notes
    assert "\n1 recording with flagged samples: see the column warnings" in notes


def test_summary_of_unlabelled_recordings_knows_no_truth(model, tmp_path):
    table = answered(model, pushes(6, seed=5, label=None), tmp_path).summary()
    assert table.header == ("material", "answers", "share")
    assert sum(int(row[1]) for row in table.rows) == 6
