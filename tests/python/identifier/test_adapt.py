"""Models brought to another set-up: what they gain, what they keep and drop, and what is refused."""

import dataclasses
import pickle
import re

import numpy as np
import pytest
from sklearn.pipeline import make_pipeline

from evaluation_cases import make_data
from granular_id import ECOCClassifier, Identifier, MultiBand, RawHFMH, _core, load, synthesize
from granular_id._parallel import single_threaded_blas
from granular_id.identifier import adapt as adapting, describe_performance
from granular_id.recording import Dataset, Recording
from granular_id.spaces import BestClassifier
from granular_id.spaces.presets import fit_pipeline
from granular_id.synthetic import Rig

pytestmark = pytest.mark.filterwarnings("ignore:balanced accuracy on the recordings with a label fell")

SPACES = ["raw", "hfmh", "raw+hfmh", "multiband", "best"]
MATERIALS = ["rice", "fine sugar", "oat flakes", "dry peas", "macaroni"]


def turned(data, gain=1.3, offset=0.4, **meta):
    """The same pushes under another set-up: other gains, another zero."""
    gains = gain ** np.linspace(-1, 1, 6)
    return Dataset(
        [
            Recording(
                r.wrench * gains + offset,
                rate_hz=r.rate_hz,
                label=r.label,
                session="elsewhere",
                name=r.name,
                meta=meta,
            )
            for r in data
        ]
    )


@pytest.fixture(scope="module")
def rig_data():
    return synthesize(MATERIALS, 12, duration_s=1.0, seed=1)


@pytest.fixture(scope="module")
def rig_model(rig_data):
    return Identifier.fit(rig_data, "multiband", estimate=False)


@pytest.fixture(scope="module")
def elsewhere():
    rig = Rig(depth_m=0.05, tool_diameter_m=0.012)
    return synthesize(MATERIALS, 10, duration_s=1.0, seed=7, rig=rig)


@pytest.fixture(scope="module")
def of_spaces(data):
    return {
        space: Identifier.fit(data, space, estimate=space == "raw+hfmh", target_error=0.2) for space in SPACES
    }


@pytest.fixture(scope="module")
def moved():
    return turned(make_data(6, seed=9))


def by_labels(model, new, **options):
    return model.adapt(new, new.y, **options)


def to_all(model, new, **options):
    return model.adapt(new, all_materials=True, **options)


WAYS = {
    "all materials": to_all,
    "labels": by_labels,
    "all materials, then labels": lambda model, new: by_labels(to_all(model, new), new),
}


def streamed(core, wrench, hops):
    stream = _core.StreamingIdentifier(core)
    for part in np.array_split(wrench, hops):
        stream.push(part)
    return stream.losses()


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("space", SPACES)
def test_streams_batches_and_the_file_give_the_same_bits(of_spaces, moved, space, way, tmp_path):
    model = WAYS[way](of_spaces[space], moved)
    scores = model.scores(moved)
    model.save(tmp_path / "new.safetensors")
    again = Identifier.load(tmp_path / "new.safetensors")
    assert again.scores(moved).tobytes() == scores.tobytes()
    assert pickle.loads(pickle.dumps(model.core)) == model.core == again.core
    losses = model.losses(moved)
    for row, recording in enumerate(moved):
        assert streamed(again.core, recording.wrench, 1 + row % 5).tobytes() == losses[row].tobytes()


@pytest.mark.parametrize("way", WAYS)
def test_a_model_gains_by_recordings_of_the_new_set_up(rig_model, elsewhere, way):
    known, new = elsewhere[np.arange(50) % 2 == 0], elsewhere[np.arange(50) % 2 == 1]
    before = np.mean(rig_model.predict(new) == new.y)
    assert np.mean(WAYS[way](rig_model, known).predict(new) == new.y) > before


def test_adapt_leaves_the_model_as_it_was(rig_model, elsewhere):
    before = rig_model.core.to_bytes()
    to_all(rig_model, elsewhere)
    assert rig_model.core.to_bytes() == before
    assert "adapted" not in rig_model.trained


def test_all_materials_uses_no_labels(rig_model, elsewhere):
    bare = Dataset([dataclasses.replace(r, label=None) for r in elsewhere])
    known, unknown = (to_all(rig_model, d) for d in (elsewhere, bare))
    assert known.core.coef.tobytes() == unknown.core.coef.tobytes()
    assert known.core.intercept.tobytes() == unknown.core.intercept.tobytes()
    assert "balanced accuracy" in known.trained["adapted"]
    assert "balanced accuracy" not in unknown.trained["adapted"]


def test_labels_need_not_be_those_of_the_recordings(rig_model, elsewhere):
    bare = Dataset([dataclasses.replace(r, label=None) for r in elsewhere])
    made, wanted = rig_model.adapt(bare, list(elsewhere.y)), by_labels(rig_model, elsewhere)
    assert made.core.coef.tobytes() == wanted.core.coef.tobytes()
    assert made.core.intercept.tobytes() == wanted.core.intercept.tobytes()


@pytest.mark.parametrize(
    ("labels", "all_materials", "came"), [(None, False, "neither"), (["rice"] * 50, True, "both")]
)
def test_adapt_in_neither_or_both_ways_is_refused(rig_model, elsewhere, labels, all_materials, came):
    with pytest.raises(
        ValueError, match=f"needs one of two ways, got {came}: give the labels .* all_materials=True"
    ):
        rig_model.adapt(elsewhere, labels, all_materials=all_materials)


@pytest.mark.parametrize("space", ["raw+hfmh", "best"])
def test_what_was_measured_on_the_old_model_is_dropped_and_said(models, moved, space):
    new = to_all(models[space], moved)
    assert new.core.early is None
    assert "confidence" not in new.trained
    assert new.trained["estimate"] is None
    decision = new.identify(moved[0])
    assert (decision.candidates, decision.unknown) == ((), None)
    told = "\n".join(describe_performance(new))
    for line in (
        "adapted: by 24 recordings declared to hold all materials, ",
        "unknown materials: none: the model was",
    ):
        assert line in told
    with pytest.raises(ValueError, match="knows no probabilities"):
        new.predict_proba(moved)


def test_the_file_says_in_a_line_how_it_was_adapted(rig_model, elsewhere, tmp_path):
    few = elsewhere[[i for i in range(50) if i % 10 < 3]]
    by_labels(to_all(rig_model, elsewhere), few).save(tmp_path / "m.safetensors")
    line = Identifier.load(tmp_path / "m.safetensors").trained["adapted"]
    assert re.fullmatch(
        r"by 15 labelled recordings, \d{4}-\d\d-\d\d \d\d:\d\d UTC; balanced accuracy [\d.]+ % before, "
        r"[\d.]+ % after, each named by a model made without it",
        line,
    )


def test_one_labelled_recording_each_has_no_accuracy_after(rig_model, elsewhere):
    one = elsewhere[[i for i in range(50) if i % 10 == 0]]
    assert "accuracy" not in by_labels(rig_model, one).trained["adapted"]


def test_labelled_recordings_that_come_again_are_warned_of(rig_model, rig_data, elsewhere):
    few = elsewhere[[i for i in range(50) if i % 10 < 3]]
    own = rig_data[[i for i in range(60) if i % 12 < 2]]
    for model, again, n in ((rig_model, own, 10), (by_labels(rig_model, few), few, 15)):
        with pytest.warns(
            UserWarning, match=f"{n} of {n} recordings have trained or adapted the model before"
        ):
            by_labels(model, again)
    by_labels(to_all(rig_model, few), few)  # without labels they taught it nothing


def test_labelled_recordings_count_as_trained_on(rig_model, elsewhere):
    few = elsewhere[[i for i in range(50) if i % 10 < 2]]
    assert adapting.Metadata(by_labels(rig_model, few).core).marks >= {
        adapting.stored_marks(few[[0]])["recording_marks"]
    }


def test_the_set_up_becomes_that_of_the_new_recordings():
    old = turned(make_data(4), 1, 0, tool="spoon", frame="flange")
    new = turned(make_data(4, seed=3), tool="cylinder", sensor="Mini45")
    model = by_labels(Identifier.fit(old, "hfmh", estimate=False), new)
    assert model.trained["setup"] == {"tool": ["cylinder"], "sensor": ["Mini45"], "frame": ["flange"]}
    assert model.trained["adapted"].endswith("; set-up: tool 'cylinder', in training 'spoon'")


def test_adapt_replaces_the_mean_of_provisional_answers(of_spaces, moved):
    new = to_all(of_spaces["raw"], moved).core
    np.testing.assert_array_equal(new.raw_mean, moved.X.mean(axis=0).T.ravel())


# What a model keeps of its training.


@pytest.mark.parametrize(
    "space", [*SPACES, make_pipeline(RawHFMH(block_weights="unit"), ECOCClassifier())], ids=str
)
def test_it_keeps_mean_and_spread_of_what_its_weights_are_for(data, space):
    model = Identifier.fit(data, space, estimate=False)
    with single_threaded_blas():
        wanted = adapting._statistics(model.core, adapting.features_of(model.core, data.X), data.y)
    assert model.trained["source"] == adapting._stored_source(wanted)


@pytest.mark.parametrize("space", SPACES)
def test_features_are_extracted_once_for_the_weights_and_what_is_kept(data, space, monkeypatch):
    monkeypatch.setattr("granular_id.identifier.training.features_of", None)
    assert "source" in Identifier.fit(data, space, estimate=False).trained


def without_source(model):
    trained = {name: value for name, value in model.trained.items() if name != "source"}
    return Identifier(adapting._changed(model.core, trained))


@pytest.mark.parametrize("way", [to_all, by_labels])
def test_a_model_without_source_takes_its_training(rig_model, rig_data, elsewhere, way):
    old = without_source(rig_model)
    with pytest.raises(ValueError, match="pass the recordings of its training, trained_on=data"):
        way(old, elsewhere)
    first, second = way(old, elsewhere, trained_on=rig_data).core, way(rig_model, elsewhere).core
    assert first.coef.tobytes() == second.coef.tobytes()
    assert first.intercept.tobytes() == second.intercept.tobytes()
    for model in (old, rig_model):
        with pytest.raises(
            ValueError, match="trained_on must be the recordings that the model was trained on"
        ):
            way(model, elsewhere, trained_on=rig_data[::2])


def test_a_model_that_keeps_what_it_needs_goes_by_that(rig_model, rig_data, elsewhere):
    for model in (rig_model, to_all(rig_model, elsewhere)):
        plain, given = by_labels(model, elsewhere), by_labels(model, elsewhere, trained_on=rig_data)
        assert plain.core.intercept.tobytes() == given.core.intercept.tobytes()


@pytest.fixture(scope="module")
def pipeline(rig_data):
    classifier = BestClassifier(shrinkages=[None], relative_costs=[1.0])
    return fit_pipeline(make_pipeline(MultiBand(), classifier), rig_data, rig_data.y)


def test_a_model_that_was_told_its_training_keeps_it(rig_model, rig_data, pipeline, elsewhere):
    for old in (without_source(rig_model), Identifier.from_classifier(pipeline)):
        first = to_all(old, elsewhere, trained_on=rig_data)
        again = by_labels(first, elsewhere)
        assert np.mean(again.predict(elsewhere) == elsewhere.y) > 0.9
        with pytest.raises(ValueError, match="has been adapted since"):
            to_all(first, elsewhere)
    wanted = by_labels(to_all(rig_model, elsewhere), elsewhere).core
    made = by_labels(to_all(without_source(rig_model), elsewhere, trained_on=rig_data), elsewhere).core
    assert made.coef.tobytes() == wanted.coef.tobytes()


def test_a_model_that_does_not_know_its_training_doubts_what_it_names_wrong(pipeline, elsewhere):
    model = Identifier.from_classifier(pipeline)
    with pytest.warns(UserWarning, match=r"names only [\d.]+ % of trained_on rightly: if these are not"):
        to_all(model, elsewhere, trained_on=elsewhere)


def test_a_model_too_large_for_it_keeps_nothing(rig_data, elsewhere, monkeypatch):
    monkeypatch.setattr(adapting, "_MOST_SOURCE", 1000)
    model = Identifier.fit(rig_data, "multiband", estimate=False)
    assert "source" not in model.trained
    new = to_all(model, elsewhere, trained_on=rig_data)
    with pytest.raises(ValueError, match="was adapted before: adapt the model that it was made from"):
        by_labels(new, elsewhere, trained_on=rig_data)


def test_a_file_near_its_limit_has_no_room_for_it(rig_data, monkeypatch):
    monkeypatch.setattr(adapting, "_FOR_MORE", 2**25)
    assert "source" not in Identifier.fit(rig_data, "multiband", estimate=False).trained


@pytest.mark.parametrize(
    ("name", "text", "problem"),
    [
        ("sd", "AAAA", "numbers in base64"),
        ("scores", "%", "numbers in base64"),
        ("mean", "", "numbers in base64"),
    ],
)
def test_damaged_numbers_are_refused(rig_model, elsewhere, name, text, problem):
    source = {**rig_model.trained["source"], name: text}
    damaged = Identifier(adapting._changed(rig_model.core, {**rig_model.trained, "source": source}))
    with pytest.raises(ValueError, match=problem):
        to_all(damaged, elsewhere)


def test_an_adapted_entry_that_is_no_text_is_refused(rig_model, tmp_path):
    core = adapting._changed(rig_model.core, {**rig_model.trained, "adapted": ["shift"]})
    Identifier(core).save(tmp_path / "m.safetensors")
    with pytest.raises(ValueError, match="adapted"):
        Identifier.load(tmp_path / "m.safetensors")


# Refused.


def test_too_few_recordings_to_be_all_materials(rig_model, elsewhere):
    with pytest.raises(
        ValueError, match="needs 3 recordings a material in the mean, 15 for 5 materials, got 14"
    ):
        to_all(rig_model, elsewhere[:14])


def test_missing_materials_are_named_and_may_be_accepted(rig_model, elsewhere):
    some = elsewhere[[i for i, label in enumerate(elsewhere.y) if label not in ("rice", "macaroni")]]
    with pytest.raises(
        ValueError, match="macaroni, rice are missing: what the others show does not carry over"
    ):
        by_labels(rig_model, some)
    new = by_labels(rig_model, some, allow_missing=True)
    assert "gain nothing: macaroni, rice" in new.trained["adapted"]


def test_adapt_by_two_labelled_recordings_is_refused(rig_model, elsewhere):
    with pytest.raises(ValueError, match=r"needs at least 3 recordings, got 2"):
        by_labels(rig_model, elsewhere[[0, 10]], allow_missing=True)


def test_recordings_of_one_material_are_warned_of(rig_model, elsewhere):
    with pytest.warns(
        UserWarning, match="all recordings are of one material, rice: the set-up cannot be told"
    ):
        by_labels(rig_model, elsewhere[elsewhere.y == "rice"], allow_missing=True)


def test_a_statement_that_labels_contradict_is_warned_of(rig_model, elsewhere):
    some = elsewhere[np.isin(elsewhere.y, ["rice", "fine sugar", "oat flakes"])]
    with pytest.warns(
        UserWarning, match="all_materials=True states .* by the labels dry peas, macaroni are missing"
    ):
        to_all(rig_model, some)
    unsaid = Dataset([dataclasses.replace(some[0], label=None), *some[1:]])
    to_all(rig_model, unsaid)  # what has no label may be any


@pytest.mark.filterwarnings("default")
def test_accuracy_that_fell_is_warned_of(rig_model, rig_data):
    some = rig_data[np.isin(rig_data.y, ["rice", "fine sugar", "oat flakes"])]
    unsaid = Dataset([dataclasses.replace(some[0], label=None), *some[1:]])
    with pytest.warns(UserWarning, match=r"label fell from [\d.]+ % to [\d.]+ %: keep the model as it was"):
        to_all(rig_model, unsaid)


def test_columns_of_an_adapted_model_are_no_longer_those_of_the_training(rig_model, elsewhere):
    for way in WAYS.values():
        with pytest.raises(ValueError, match="has been adapted since: adapt the model that it was made from"):
            to_all(way(rig_model, elsewhere), elsewhere)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (lambda r: dataclasses.replace(r, rate_hz=250.0), "250 Hz, the model was trained at 500"),
        (lambda r: dataclasses.replace(r, wrench=r.wrench[:, :3], axes=r.axes[:3]), "has the axes fx fy fz"),
        (lambda r: dataclasses.replace(r, wrench=r.wrench[:400]), "the model takes 500"),
        (lambda r: dataclasses.replace(r, meta={"frame": "turned"}), "another set-up"),
    ],
    ids=["rate", "axes", "length", "frame"],
)
def test_what_identify_refuses_is_refused(rig_model, elsewhere, change, problem):
    with pytest.raises(ValueError, match=problem):
        by_labels(rig_model, Dataset([change(r) for r in elsewhere[:3]]))


def test_ways_out_are_those_that_there_are(rig_model, elsewhere):
    def lengths(*counts):
        return Dataset(
            [dataclasses.replace(elsewhere[k], wrench=np.ones((n, 6))) for k, n in enumerate(counts)]
        )

    with pytest.raises(ValueError, match=r"state lead_s or pass begin_at='first'$"):
        to_all(rig_model, lengths(600, 500, 500))
    with pytest.raises(
        ValueError, match=r"call .align\(500, on_short='skip'\) to leave such recordings out$"
    ):
        to_all(rig_model, lengths(500, 500, 400))
    with pytest.raises(ValueError, match=r"3 of 3 recordings are shorter$"):
        to_all(rig_model, lengths(400, 400, 400))


def test_labels_must_be_there_and_known(rig_model, elsewhere):
    for label, problem in ((None, "no label"), ("salt", "labels of the training, got 'salt'")):
        with pytest.raises(ValueError, match=problem):
            by_labels(rig_model, Dataset([dataclasses.replace(r, label=label) for r in elsewhere]))


@pytest.mark.parametrize(("recordings", "problem"), [(None, "NoneType"), (np.zeros((3, 500, 6)), "ndarray")])
def test_recordings_are_a_dataset(rig_model, recordings, problem):
    with pytest.raises(TypeError, match=f"must be a granular_id.Dataset, got {problem}"):
        rig_model.adapt(recordings, all_materials=True)


def test_real_recordings_of_a_turned_sensor(data_dir):
    data = load(data_dir / "sliding_wrench").resample(100, max_gap_s=1.0).align("shortest")
    some = data[[i for i, label in enumerate(data.y) if label in data.labels[:8]]]
    number = np.array([int(name[-6:-4]) for name in some.names])
    half, later = some[np.flatnonzero(number <= 12)], turned(some[np.flatnonzero(number > 40)], 1.2, 0.3)
    model = Identifier.fit(half, "multiband", estimate=False)
    before, after = (np.mean(m.predict(later) == later.y) for m in (model, to_all(model, later)))
    assert after > before


def test_what_was_done_to_samples_is_that_of_the_new_recordings():
    data = synthesize(["rice", "fine sugar"], 6, duration_s=0.6)
    model = Identifier.fit(data.tare(), "hfmh", estimate=False)
    assert model.trained["setup"]["tare"] == ["rest"]
    plain = synthesize(["rice", "fine sugar"], 6, duration_s=0.6, seed=1)
    adapted = by_labels(model, plain)
    assert "tare" in adapted.trained["adapted"]
    assert "tare" not in adapted.trained["setup"]
