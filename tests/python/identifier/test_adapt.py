"""Models brought to another set-up: what they gain, what they keep and drop, and what is refused."""

import dataclasses
import pickle
import re

import numpy as np
import pytest
from sklearn.pipeline import make_pipeline

from evaluation_cases import make_data
from granular_id import ECOCClassifier, Identifier, RawHFMH, _core, synthesize
from granular_id._parallel import single_threaded_blas
from granular_id.identifier import adapt as adapting, describe_performance
from granular_id.identifier.model import known_marks, mark_of
from granular_id.identifier.training import features_of
from granular_id.recording import Dataset, Recording
from granular_id.spaces import Learners, SourceStatistics
from granular_id.synthetic import Rig
from model_cases import with_trained

pytestmark = pytest.mark.filterwarnings("ignore:balanced accuracy on the recordings with a label fell")

SPACES = ["raw", "hfmh", "raw+hfmh", "multiband", "best"]
MATERIALS = ["rice", "fine sugar", "oat flakes", "dry peas", "macaroni"]


def turned(data, gain=1.3, offset=0.4, **meta):
    """The same pushes under another set-up: other gains, another zero."""
    gains = gain ** np.linspace(-1, 1, 6)
    new = {"session": "elsewhere", "meta": meta}
    return Dataset([dataclasses.replace(r, wrench=r.wrench * gains + offset, **new) for r in data])


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
def moved():
    return turned(make_data(6, seed=9))


def first_of_each(data, n):
    """Return the first recordings of each material, of which there are ten."""
    return data[np.arange(len(data)) % 10 < n]


def by_labels(model, new, **options):
    return model.adapt(new, new.y, **options)


def to_all(model, new, **options):
    return model.adapt(new, all_materials=True, **options)


WAYS = {
    "all materials": to_all,
    "labels": by_labels,
    "all materials, then labels": lambda model, new: by_labels(to_all(model, new), new),
}


def weights(model):
    return model.core.coef.tobytes(), model.core.intercept.tobytes()


def streamed(core, wrench, hops):
    stream = _core.StreamingIdentifier(core)
    for part in np.array_split(wrench, hops):
        stream.push(part)
    return stream.losses()


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("space", SPACES)
def test_streams_batches_and_the_file_give_the_same_bits(models, moved, space, way, tmp_path):
    model = WAYS[way](models[space], moved)
    scores = model.scores(moved)
    model.save(tmp_path / "new.safetensors")
    again = Identifier.load(tmp_path / "new.safetensors")
    assert again.scores(moved).tobytes() == scores.tobytes()
    assert pickle.loads(pickle.dumps(model.core)) == model.core == again.core
    losses = model.losses(moved)
    for row, recording in enumerate(moved):
        assert streamed(again.core, recording.wrench, 1 + row % 5).tobytes() == losses[row].tobytes()


@pytest.mark.parametrize("way", WAYS)
def test_adapt_gains_and_leaves_the_model_as_it_was(rig_model, elsewhere, way):
    known, new = elsewhere[np.arange(50) % 2 == 0], elsewhere[np.arange(50) % 2 == 1]
    bytes_before, before = rig_model.core.to_bytes(), np.mean(rig_model.predict(new) == new.y)
    assert np.mean(WAYS[way](rig_model, known).predict(new) == new.y) > before
    assert rig_model.core.to_bytes() == bytes_before
    assert "adapted" not in rig_model.trained


def test_adapt_to_all_materials_uses_no_labels(rig_model, elsewhere):
    bare = Dataset([dataclasses.replace(r, label=None) for r in elsewhere])
    known, unknown = (to_all(rig_model, d) for d in (elsewhere, bare))
    assert weights(known) == weights(unknown)
    assert "balanced accuracy" in known.trained["adapted"]
    assert "balanced accuracy" not in unknown.trained["adapted"]


def test_labels_need_not_be_those_of_the_recordings(rig_model, elsewhere):
    bare = Dataset([dataclasses.replace(r, label=None) for r in elsewhere])
    assert weights(rig_model.adapt(bare, list(elsewhere.y))) == weights(by_labels(rig_model, elsewhere))


@pytest.mark.parametrize("space", ["raw+hfmh", "best"])
def test_what_was_measured_on_the_old_model_is_dropped(models, moved, space):
    new = to_all(models[space], moved)
    assert new.core.early is None
    assert "confidence" not in new.trained
    assert new.trained["estimate"] is None
    decision = new.identify(moved[0])
    assert (decision.candidates, decision.unknown) == ((), None)
    text = "\n".join(describe_performance(new))
    assert "adapted: by 24 recordings declared to hold all materials, " in text
    assert "unknown materials: none: the model was" in text
    with pytest.raises(ValueError, match="knows no probabilities"):
        new.predict_proba(moved)


def test_file_says_in_a_line_how_it_was_adapted(rig_model, elsewhere, tmp_path):
    by_labels(to_all(rig_model, elsewhere), first_of_each(elsewhere, 3)).save(tmp_path / "m.safetensors")
    line = Identifier.load(tmp_path / "m.safetensors").trained["adapted"]
    assert re.match(r"by 15 labelled recordings, .* UTC; balanced accuracy [\d.]+ % before, [\d.]+ %", line)
    one = by_labels(rig_model, first_of_each(elsewhere, 1))
    assert "accuracy" not in one.trained["adapted"]  # none can be named by a model made without it


def test_labelled_recordings_that_come_again_are_warned_of(rig_model, rig_data, elsewhere):
    few = first_of_each(elsewhere, 3)
    own = rig_data[[i for i in range(60) if i % 12 < 2]]
    new = by_labels(rig_model, few)
    assert mark_of(few.X[0]) in known_marks(new)
    for model, again, n in ((rig_model, own, 10), (new, few, 15)):
        with pytest.warns(UserWarning, match=f"{n} of {n} recordings have trained or adapted the model"):
            by_labels(model, again)
    by_labels(to_all(rig_model, few), few)  # without labels they taught it nothing


def test_set_up_becomes_that_of_the_new_recordings():
    old = turned(make_data(4), 1, 0, tool="spoon", frame="flange", tare="rest")
    new = turned(make_data(4, seed=3), tool="cylinder", sensor="Mini45")
    model = by_labels(Identifier.fit(old, "hfmh", estimate=False), new)
    # What was done to samples is that of the new recordings, too.
    assert model.trained["setup"] == {"tool": ["cylinder"], "sensor": ["Mini45"], "frame": ["flange"]}
    assert "; set-up: " in model.trained["adapted"]
    assert "tool 'cylinder', in training 'spoon'" in model.trained["adapted"]


def test_adapt_replaces_the_mean_of_provisional_answers(models, moved):
    new = to_all(models["raw"], moved).core
    np.testing.assert_array_equal(new.raw_mean, moved.X.mean(axis=0).T.ravel())


WEIGHTED = make_pipeline(RawHFMH(block_weights="unit"), ECOCClassifier())


@pytest.mark.parametrize("space", [*SPACES, WEIGHTED], ids=str)
def test_source_is_mean_and_spread_of_what_weights_are_for(data, models, space):
    model = models[space] if isinstance(space, str) else Identifier.fit(data, space, estimate=False)
    core = model.core
    with single_threaded_blas():
        learners = Learners(core.coef, core.intercept, core.coding_matrix, core.losses)
        codes = np.searchsorted(model.classes, data.y)
        wanted = SourceStatistics.of(features_of(core, data.X), codes, learners)
    stored = adapting._read_source(model)
    for name in ("mean", "sd", "scores"):
        assert getattr(stored, name).tobytes() == getattr(wanted, name).tobytes()


def test_way_out_of_a_model_of_many_materials_works():
    """As the refusal says: 60 materials are too many one-vs-one, and not with fewer learners."""
    rng = np.random.default_rng(0)
    waves = [(f"m{k % 60:02d}", rng.normal(k % 7, 1, (40, 2))) for k in range(180)]
    data = Dataset([Recording(wave, 100.0, label=label, axes=("a", "b")) for label, wave in waves])
    made = []
    for coding in ("onevsone", "onevsall"):
        pipeline = make_pipeline(RawHFMH(cutoff_hz=20.0, n_bins=4), ECOCClassifier(coding))
        made.append(Identifier.fit(data[:120], pipeline, estimate=False))
    with pytest.raises(ValueError, match=r"keeps nothing of its training .*'onevsall'"):
        by_labels(made[0], data[120:])
    assert "adapted" in by_labels(made[1], data[120:]).trained


@pytest.mark.parametrize(("name", "text"), [("sd", "AAAA"), ("scores", "%"), ("mean", "")])
def test_damaged_numbers_are_refused(rig_model, elsewhere, name, text):
    source = {**rig_model.trained["source"], name: text}
    damaged = Identifier(with_trained(rig_model.core, {**rig_model.trained, "source": source}))
    with pytest.raises(ValueError, match="numbers in base64"):
        to_all(damaged, elsewhere)


def test_missing_materials_are_named_and_may_be_accepted(rig_model, elsewhere):
    some = elsewhere[~np.isin(elsewhere.y, ["rice", "macaroni"])]
    with pytest.raises(ValueError, match="macaroni, rice are missing"):
        by_labels(rig_model, some)
    new = by_labels(rig_model, some, allow_missing=True)
    assert "gain nothing: macaroni, rice" in new.trained["adapted"]


@pytest.mark.filterwarnings("default")
def test_doubtful_recordings_are_warned_of(rig_model, rig_data, elsewhere):
    with pytest.warns(UserWarning, match="all recordings are of one material, rice: the set-up cannot be"):
        by_labels(rig_model, elsewhere[elsewhere.y == "rice"], allow_missing=True)
    three = ["rice", "fine sugar", "oat flakes"]
    with pytest.warns(UserWarning, match="all_materials=True states .* dry peas, macaroni are missing"):
        to_all(rig_model, elsewhere[np.isin(elsewhere.y, three)])
    some = rig_data[np.isin(rig_data.y, three)]
    unsaid = Dataset([dataclasses.replace(some[0], label=None), *some[1:]])  # may be any
    with pytest.warns(UserWarning, match=r"fell from [\d.]+ % to [\d.]+ %: keep the model as") as warned:
        to_all(rig_model, unsaid)
    assert len(warned) == 1


def test_adapted_model_is_not_declared_again(rig_model, elsewhere):
    for way in WAYS.values():
        with pytest.raises(ValueError, match="has been adapted since: adapt the model that it was made from"):
            to_all(way(rig_model, elsewhere), elsewhere)


LONGER = {"wrench": np.ones((600, 6)), "trigger_index": None}


@pytest.mark.parametrize(
    ("rows", "change", "options", "message"),
    [
        (slice(50), {}, {}, "needs one of two ways, got neither: give the labels .* all_materials=True"),
        (slice(50), {}, {"labels": ["rice"] * 50, "all_materials": True}, "two ways, got both"),
        (slice(14), {}, {"all_materials": True}, "needs 3 recordings a material .* 15 for 5 .* got 14"),
        ([0, 10], {}, {"labels": ["rice"] * 2, "allow_missing": True}, "at least 3 recordings, got 2"),
        (slice(3), {"meta": {"frame": "turned"}}, None, "another set-up"),
        (slice(3), {"wrench": np.ones((400, 6))}, None, "3 of 3 recordings are shorter$"),
        (slice(3), LONGER, None, r"Dataset\.align\(500\).*\(--duration-s 1\)$"),
        (slice(3), {"label": None}, None, "no label"),
        (slice(3), {"label": "salt"}, None, "labels of the training, got 'salt'"),
    ],
)
def test_adapt_without_a_way_or_recordings_is_refused(rig_model, elsewhere, rows, change, options, message):
    new = Dataset([dataclasses.replace(r, **change) for r in elsewhere[rows]])
    with pytest.raises(ValueError, match=message):
        rig_model.adapt(new, **({"labels": new.y} if options is None else options))
