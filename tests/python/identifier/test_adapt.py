"""Models brought to another set-up: what they gain, what they keep and drop, and what is refused."""

import dataclasses
import pickle
import warnings

import numpy as np
import pytest
from sklearn.pipeline import make_pipeline

from evaluation_cases import make_data
from granular_id import ECOCClassifier, Identifier, MultiBand, _core, load, synthesize
from granular_id._parallel import single_threaded_blas
from granular_id.identifier import adapt as adapting, describe_performance
from granular_id.recording import Dataset, Recording
from granular_id.spaces import BestClassifier, BlockScaler
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


WAYS = {
    "shift": lambda model, new: model.adapt(new),
    "z": lambda model, new: model.adapt(new, all_materials=True),
    "labelled": lambda model, new: model.recalibrate(new),
    "z, then labelled": lambda model, new: model.adapt(new, all_materials=True).recalibrate(new),
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


@pytest.fixture(scope="module")
def large_model():
    return Identifier.fit(synthesize(n_per_class=10, duration_s=1.0, seed=1), "multiband", estimate=False)


@pytest.fixture(scope="module")
def other_rigs():
    rigs = [Rig(depth_m=0.05), Rig(tool_diameter_m=0.025), Rig(speed_m_s=0.02), Rig(tool_diameter_m=0.012)]
    return [
        synthesize(n_per_class=8, duration_s=1.0, seed=20 + number, rig=rig)
        for number, rig in enumerate(rigs)
    ]


@pytest.mark.parametrize("materials", ["all", "half", "three", "unequal"])
def test_the_default_is_at_most_a_point_below_none_in_the_mean(large_model, other_rigs, materials):
    model, gains = large_model, []
    for number, data in enumerate(other_rigs):
        order = np.random.default_rng(number).permutation(11)
        labels = np.array(model.classes)[order[: {"half": 5, "three": 3}.get(materials, 11)]]
        most = {label: 8 - 7 * k // 10 if materials == "unequal" else 8 for k, label in enumerate(labels)}
        rows = [np.flatnonzero(data.y == label)[: most[label]] for label in labels]
        new = data[np.concatenate(rows)]
        gains.append(np.mean(model.adapt(new).predict(new) == new.y) - np.mean(model.predict(new) == new.y))
    assert np.mean(gains) > -0.01


def test_a_shift_changes_intercepts_only_and_leaves_the_model_as_it_was(rig_model, elsewhere):
    before = rig_model.core.to_bytes()
    new = rig_model.adapt(elsewhere)
    assert np.array_equal(new.core.coef, rig_model.core.coef)
    assert not np.array_equal(new.core.intercept, rig_model.core.intercept)
    assert rig_model.core.to_bytes() == before
    assert rig_model.adaptations == ()


def test_declared_sessions_get_mean_and_sd_of_the_training_in_each_column(rig_model, rig_data, elsewhere):
    own, other = (rig_model.spec.extract(d.X) for d in (rig_data, elsewhere))
    scale = np.clip(own.std(axis=0) / np.maximum(other.std(axis=0), 1e-300), 0.2, 5)
    mean = np.mean([own[rig_data.y == label].mean(axis=0) for label in MATERIALS], axis=0)
    rows = (other - other.mean(axis=0)) * scale + mean
    wanted = rows @ rig_model.core.coef.T + rig_model.core.intercept
    new = rig_model.adapt(elsewhere, all_materials=True, rounds=0)
    np.testing.assert_allclose(new.scores(elsewhere), wanted, atol=1e-8)


def test_labels_are_not_used_by_adapt(rig_model, elsewhere):
    bare = Dataset([dataclasses.replace(r, label=None) for r in elsewhere])
    known, unknown = (rig_model.adapt(d) for d in (elsewhere, bare))
    assert known.core.intercept.tobytes() == unknown.core.intercept.tobytes()
    entry = unknown.adaptations[-1]
    assert (entry.n_judged, entry.accuracy_before, entry.accuracy_after) == (0, None, None)


@pytest.mark.parametrize("space", ["raw+hfmh", "best"])
def test_what_was_measured_on_the_old_model_is_dropped_and_said(models, moved, space):
    new = models[space].adapt(moved)
    core = new.core
    assert (core.early, core.sigmoid, core.posterior_weights, core.metadata["posterior"]) == (
        None,
        None,
        None,
        "",
    )
    assert "confidence" not in new.trained
    assert new.trained["estimate"] is None
    decision = new.identify(moved[0])
    assert (decision.candidates, decision.unknown) == ((), None)
    told = "\n".join(describe_performance(new))
    for line in (
        "adapted: balanced shift",
        "no longer true, and dropped",
        "unknown materials: none: the model was",
    ):
        assert line in told
    assert "candidates" in new.adaptations[-1].dropped
    assert ("probabilities" in new.adaptations[-1].dropped) == (space == "best")
    with pytest.raises(ValueError, match="knows no probabilities"):
        new.predict_proba(moved)


def test_the_file_holds_the_history(rig_model, elsewhere, tmp_path):
    few = elsewhere[[i for i in range(50) if i % 10 < 3]]
    rig_model.adapt(elsewhere, all_materials=True).recalibrate(few).save(tmp_path / "m.safetensors")
    first, second = Identifier.load(tmp_path / "m.safetensors").adaptations
    assert (first.method, first.rounds, first.n_recordings) == ("mean and SD of each column", 2, 50)
    assert first.sessions == tuple(f"session {k}" for k in range(1, 5))
    assert len(first.sha256) == 64
    assert first.made.endswith("+00:00")
    assert sum(first.shares_before.values()) == pytest.approx(1) == sum(first.shares_after.values())
    assert second.materials == dict.fromkeys(sorted(MATERIALS), 3)
    assert second.n_judged == 15
    assert 0 <= second.accuracy_after <= 1
    assert "balanced accuracy on the 15 with a label that the model knows: " in str(second)
    assert "each named by a recalibration without it" not in str(second)  # all have adapted it before
    assert "each named by a recalibration without it" in str(rig_model.recalibrate(few).adaptations[-1])


def test_the_accuracy_after_labels_is_of_models_without_the_recordings_they_name(rig_model, elsewhere):
    one = elsewhere[[i for i in range(50) if i % 10 == 0]]
    entry = rig_model.recalibrate(one).adaptations[-1]
    assert entry.accuracy_before is not None
    assert entry.accuracy_after is None
    assert "not known, with fewer than two" in str(entry)


def test_recordings_that_the_model_has_seen_are_told_of(rig_model, rig_data, elsewhere):
    few = elsewhere[[i for i in range(50) if i % 10 < 3]]
    assert rig_model.recalibrate(few).adaptations[-1].n_seen == 0
    again = rig_model.adapt(elsewhere[:40]).recalibrate(few).adaptations[-1]
    assert again.n_seen == 12
    assert "12 of these trained or adapted the model before: both accuracies are too good" in str(again)
    assert rig_model.adapt(rig_data).adaptations[-1].n_seen == 60


def test_labelled_recordings_that_come_again_are_warned_of(rig_model, rig_data, elsewhere):
    few = elsewhere[[i for i in range(50) if i % 10 < 3]]
    own = rig_data[[i for i in range(60) if i % 12 < 2]]
    pipeline = make_pipeline(MultiBand(), BlockScaler(), ECOCClassifier()).fit(rig_data)
    taken_over = Identifier.from_classifier(pipeline).recalibrate(few, trained_on=rig_data)
    for model, again, n in (
        (rig_model, own, 10),
        (rig_model.recalibrate(few), few, 15),
        (taken_over, few[:4], 4),
    ):
        with pytest.warns(UserWarning, match=f"{n} of {n} recordings have trained or recalibrated the model"):
            model.recalibrate(again, allow_missing=True)
    rig_model.adapt(few).recalibrate(few)  # without labels they taught it nothing


def test_labelled_recordings_count_as_trained_on(rig_model, elsewhere):
    few = elsewhere[[i for i in range(50) if i % 10 < 2]]
    assert adapting.Metadata(rig_model.recalibrate(few).core).marks >= {
        adapting.stored_marks(few[[0]])["recording_marks"]
    }


def test_the_set_up_becomes_that_of_the_new_recordings():
    old = turned(make_data(4), 1, 0, tool="spoon", frame="flange")
    new = turned(make_data(4, seed=3), tool="cylinder", sensor="Mini45")
    model = Identifier.fit(old, "hfmh", estimate=False).adapt(new)
    assert model.trained["setup"] == {"tool": ["cylinder"], "sensor": ["Mini45"], "frame": ["flange"]}
    entry = model.adaptations[-1]
    assert entry.differences == ("tool 'cylinder', in training 'spoon'",)


def test_provisional_answers_know_the_range_of_the_new_set_up(of_spaces, moved):
    old, new = of_spaces["raw"].core, of_spaces["raw"].adapt(moved).core
    seen = moved.X.transpose(0, 2, 1).reshape(len(moved), -1)
    assert (new.raw_low <= np.minimum(seen.min(axis=0), old.raw_low)).all()
    assert (new.raw_high >= np.maximum(seen.max(axis=0), old.raw_high)).all()
    np.testing.assert_allclose(new.raw_mean, seen.mean(axis=0))


# What a model keeps of its training.


@pytest.mark.parametrize(
    "settings", [*({"space": space} for space in SPACES), {"block_weights": "unit"}], ids=str
)
def test_it_keeps_mean_and_spread_of_what_its_weights_are_for(data, settings):
    model = Identifier.fit(data, **{"space": "raw+hfmh", "estimate": False, **settings})
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


def test_an_old_model_says_what_is_missing_and_takes_the_recordings_of_its_training(
    rig_model, rig_data, elsewhere, tmp_path
):
    without_source(rig_model).save(tmp_path / "old.safetensors")
    old = Identifier.load(tmp_path / "old.safetensors")
    for refused in (old.adapt, old.recalibrate):
        with pytest.raises(ValueError, match="pass the recordings of its training, trained_on=data"):
            refused(elsewhere)
    for way in ("adapt", "recalibrate"):
        first = getattr(old, way)(elsewhere, trained_on=rig_data).core
        second = getattr(rig_model, way)(elsewhere).core
        assert first.coef.tobytes() == second.coef.tobytes()
        assert first.intercept.tobytes() == second.intercept.tobytes()
    for model in (old, rig_model, rig_model.adapt(elsewhere)):
        with pytest.raises(
            ValueError, match="trained_on must be the recordings that the model was trained on"
        ):
            model.adapt(elsewhere, trained_on=rig_data[::2])


def test_a_model_that_keeps_what_it_needs_goes_by_that(rig_model, rig_data, elsewhere):
    first = rig_model.adapt(elsewhere)
    for model in (rig_model, first):
        plain, given = model.adapt(elsewhere), model.adapt(elsewhere, trained_on=rig_data)
        assert plain.core.intercept.tobytes() == given.core.intercept.tobytes()


@pytest.fixture(scope="module")
def pipeline(rig_data):
    classifier = BestClassifier(shrinkages=[None], relative_costs=[1.0])
    return make_pipeline(MultiBand(), classifier).fit(rig_data)


def test_a_model_that_was_told_its_training_keeps_it(rig_model, rig_data, pipeline, elsewhere):
    for old in (without_source(rig_model), Identifier.from_classifier(pipeline)):
        first = old.adapt(elsewhere, trained_on=rig_data)
        again = first.recalibrate(elsewhere)
        assert np.mean(again.predict(elsewhere) == elsewhere.y) > 0.9
        with pytest.raises(ValueError, match="has been adapted since"):
            first.adapt(elsewhere, all_materials=True)
    wanted = rig_model.adapt(elsewhere).recalibrate(elsewhere).core
    made = without_source(rig_model).adapt(elsewhere, trained_on=rig_data).recalibrate(elsewhere).core
    assert made.coef.tobytes() == wanted.coef.tobytes()


def test_a_model_that_does_not_know_its_training_doubts_what_it_names_wrong(pipeline, elsewhere):
    model = Identifier.from_classifier(pipeline)
    with pytest.warns(UserWarning, match=r"names only [\d.]+ % of trained_on rightly: if these are not"):
        model.adapt(elsewhere, trained_on=elsewhere)


def test_a_classifier_that_was_adapted_is_not_adapted_again_as_a_model(pipeline, rig_data, elsewhere):
    space, classifier = pipeline[0], pipeline[1]
    new = classifier.adapt(space.transform(rig_data), rig_data.y, space.transform(elsewhere))
    model = Identifier.from_classifier(make_pipeline(space, new))
    assert "adapted: before it was taken over from a pipeline; how is not known" in describe_performance(
        model
    )
    for trained_on in (None, rig_data):
        with pytest.raises(ValueError, match="was adapted before: adapt the model that it was made from"):
            model.adapt(elsewhere, trained_on=trained_on)


def test_a_model_too_large_for_it_keeps_nothing(rig_data, elsewhere, monkeypatch):
    monkeypatch.setattr(adapting, "_MOST_SOURCE", 1000)
    model = Identifier.fit(rig_data, "multiband", estimate=False)
    assert "source" not in model.trained
    new = model.adapt(elsewhere, trained_on=rig_data)
    with pytest.raises(ValueError, match="was adapted before: adapt the model that it was made from"):
        new.recalibrate(elsewhere, trained_on=rig_data)


def test_a_file_near_its_limit_has_no_room_for_it(rig_data, monkeypatch):
    monkeypatch.setattr(adapting, "_FOR_HISTORY", 2**24)
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
        damaged.adapt(elsewhere)


def test_a_history_of_another_form_is_refused(rig_model, tmp_path):
    core = adapting._changed(rig_model.core, {**rig_model.trained, "adaptations": [{"method": 3}]})
    Identifier(core).save(tmp_path / "m.safetensors")
    with pytest.raises(ValueError, match=r"adaptations\[0\]\.method"):
        Identifier.load(tmp_path / "m.safetensors")


# Refused.


def test_too_few_recordings_to_be_all_materials(rig_model, elsewhere):
    with pytest.raises(
        ValueError, match="needs 3 recordings a material in the mean, 15 for 5 materials, got 14"
    ):
        rig_model.adapt(elsewhere[:14], all_materials=True)


def test_missing_materials_are_named_and_may_be_accepted(rig_model, elsewhere):
    some = elsewhere[[i for i, label in enumerate(elsewhere.y) if label not in ("rice", "macaroni")]]
    with pytest.raises(
        ValueError, match="macaroni, rice are missing: what the others show does not carry over"
    ):
        rig_model.recalibrate(some)
    entry = rig_model.recalibrate(some, allow_missing=True).adaptations[-1]
    assert entry.missing == ("macaroni", "rice")
    assert "gain nothing: macaroni, rice" in str(entry)


@pytest.mark.parametrize("way", [lambda m, d: m.adapt(d), lambda m, d: m.recalibrate(d, allow_missing=True)])
def test_a_set_up_is_not_told_from_fewer_than_three_recordings(rig_model, elsewhere, way):
    with pytest.raises(ValueError, match=r"needs at least 3 recordings, got 2"):
        way(rig_model, elsewhere[[0, 10]])


@pytest.mark.parametrize("way", [lambda m, d: m.adapt(d), lambda m, d: m.recalibrate(d, allow_missing=True)])
def test_recordings_of_one_material_are_warned_of(rig_model, elsewhere, way):
    with pytest.warns(
        UserWarning, match="all recordings are of one material, rice: the set-up cannot be told"
    ):
        way(rig_model, elsewhere[elsewhere.y == "rice"])


def test_a_statement_that_labels_contradict_is_warned_of(rig_model, elsewhere):
    some = elsewhere[np.isin(elsewhere.y, ["rice", "fine sugar", "oat flakes"])]
    with pytest.warns(
        UserWarning, match="all_materials=True states .* by the labels dry peas, macaroni are missing"
    ):
        rig_model.adapt(some, all_materials=True)
    unsaid = Dataset([dataclasses.replace(some[0], label=None), *some[1:]])
    rig_model.adapt(unsaid, all_materials=True)  # what has no label may be any


def test_accuracy_that_fell_by_more_than_a_recording_is_warned_of(rig_model, elsewhere):
    core, data = rig_model.core, elsewhere
    entry = rig_model.adapt(elsewhere).adaptations[-1]
    for after, n_warnings in ((0.48, 0), (0.46, 1)):
        fell = dataclasses.replace(entry, accuracy_before=0.5, accuracy_after=after)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            adapting._warn_of(fell, core, data)
        assert len(caught) == n_warnings
    assert str(caught[0].message).startswith(
        "balanced accuracy on the recordings with a label fell from 50.0 % to 46.0 %: keep the model as it was"
    )


def test_columns_of_an_adapted_model_are_no_longer_those_of_the_training(rig_model, elsewhere):
    for way in WAYS.values():
        with pytest.raises(ValueError, match="has been adapted since: adapt the model that it was made from"):
            way(rig_model, elsewhere).adapt(elsewhere, all_materials=True)


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
@pytest.mark.parametrize("way", ["adapt", "recalibrate"])
def test_what_identify_refuses_is_refused(rig_model, elsewhere, change, problem, way):
    with pytest.raises(ValueError, match=problem):
        getattr(rig_model, way)(Dataset([change(r) for r in elsewhere[:3]]))


def test_ways_out_are_those_that_there_are(rig_model, elsewhere):
    def lengths(*counts):
        return Dataset(
            [dataclasses.replace(elsewhere[k], wrench=np.ones((n, 6))) for k, n in enumerate(counts)]
        )

    with pytest.raises(ValueError, match=r"state lead_s or pass begin_at='first'$"):
        rig_model.adapt(lengths(600, 500, 500))
    with pytest.raises(
        ValueError, match=r"call .align\(500, on_short='skip'\) to leave such recordings out$"
    ):
        rig_model.adapt(lengths(500, 500, 400))
    with pytest.raises(ValueError, match=r"3 of 3 recordings are shorter$"):
        rig_model.adapt(lengths(400, 400, 400))


def test_labels_must_be_there_and_known(rig_model, elsewhere):
    for label, problem in ((None, "no label"), ("salt", "labels of the training, got 'salt'")):
        with pytest.raises(ValueError, match=problem):
            rig_model.recalibrate(Dataset([dataclasses.replace(r, label=label) for r in elsewhere]))


@pytest.mark.parametrize(("recordings", "problem"), [(None, "NoneType"), (np.zeros((3, 500, 6)), "ndarray")])
def test_recordings_are_a_dataset(rig_model, recordings, problem):
    for way in (rig_model.adapt, rig_model.recalibrate):
        with pytest.raises(TypeError, match=f"must be a granular_id.Dataset, got {problem}"):
            way(recordings)


@pytest.mark.parametrize(("rounds", "error"), [(-1, ValueError), (1.5, TypeError), (True, TypeError)])
def test_rounds_are_a_number_of_rounds(rig_model, elsewhere, rounds, error):
    with pytest.raises(error, match="rounds"):
        rig_model.adapt(elsewhere, rounds=rounds)


def test_real_recordings_of_a_turned_sensor(data_dir):
    data = load(data_dir / "sliding_wrench").resample(100, max_gap_s=1.0).align("shortest")
    some = data[[i for i, label in enumerate(data.y) if label in data.labels[:8]]]
    number = np.array([int(name[-6:-4]) for name in some.names])
    half, later = some[np.flatnonzero(number <= 12)], turned(some[np.flatnonzero(number > 40)], 1.2, 0.3)
    model = Identifier.fit(half, "multiband", estimate=False)
    before, after = (np.mean(m.predict(later) == later.y) for m in (model, model.adapt(later)))
    assert after > before


def test_what_was_done_to_samples_is_that_of_the_new_recordings():
    data = synthesize(["rice", "fine sugar"], 6, duration_s=0.6)
    model = Identifier.fit(data.tare(), "hfmh", estimate=False)
    assert model.trained["setup"]["tare"] == ["rest"]
    plain = synthesize(["rice", "fine sugar"], 6, duration_s=0.6, seed=1)
    adapted = model.adapt(plain)
    assert "tare" in " ".join(adapted.adaptations[-1].differences)
    assert "tare" not in adapted.trained["setup"]
