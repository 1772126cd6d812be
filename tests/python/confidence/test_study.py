"""The study of confidence: its figures against loops, what is left out trains nowhere, its figure and command."""

import json
from dataclasses import replace

import numpy as np
import pytest
from sklearn.ensemble import RandomForestClassifier
from sklearn.metrics import log_loss

import granular_id as gid
from evaluation_cases import LABELS, changed, make_data
from granular_id.confidence import candidate_rule, fit_temperature, softmax
from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation import confidence_study
from granular_id.plotting import plot_confidence
from granular_id.recording import Dataset
from granular_id.score import fit_and_score, space_pipeline
from granular_id.spaces import feature_spaces
from granular_id.splits import hold_out


@pytest.fixture(scope="module")
def data():
    """Twelve pushes of each of four materials, in four sessions."""
    return changed(make_data(12, separation=0.25), session=lambda r: f"day {int(r.name.split('_')[1]) % 4}")


@pytest.fixture(scope="module")
def study(data):
    return confidence_study(data, "hfmh")


@pytest.fixture(scope="module")
def held(data):
    space = feature_spaces(rate_hz=data.rate_hz)["hfmh"]
    return fit_and_score(space_pipeline(space.transformer, ECOCClassifier()), data, hold_out(data))


def test_material_without_a_flaw_is_not_the_worst(study):
    one = study.unknown[0]
    shown = replace(study, unknown=(replace(one, auroc=1.0, refused=1.0), replace(one, auroc=0.9)))
    assert str(shown).count("worst: ") == 1


def test_a_forest_of_ones_own_space_is_the_classifier(data):
    forest = RandomForestClassifier(n_estimators=5, random_state=0)  # not fitted it has no length
    own = replace(feature_spaces(rate_hz=data.rate_hz)["hfmh"], name="own", classifier=forest)
    held = fit_and_score(space_pipeline(own.transformer, forest), data, hold_out(data))
    assert confidence_study(data, own).reliability.accuracy == pytest.approx(held.right.mean())


def test_probabilities_have_the_temperature_of_other_sessions(study, held):
    shares, off = np.empty_like(held.values), []
    for place in range(4):
        own = held.places == place
        temperature = fit_temperature(held.values[~own], held.truth[~own], held.places[~own])
        shares[own] = softmax(held.values[own], temperature)
        off.append((shares[own].max(axis=1) - held.right[own]).mean())
    seen = study.reliability
    assert seen.accuracy == held.right.mean()
    assert seen.probability == pytest.approx(shares.max(axis=1).mean())
    assert seen.too_sure == pytest.approx(np.mean(off))
    assert seen.log_loss == pytest.approx(log_loss(held.truth, shares, labels=range(4)))
    assert seen.brier == pytest.approx(((shares - np.eye(4)[held.truth]) ** 2).sum(axis=1).mean())
    gaps = [[] for _ in range(15)]
    for row, right in zip(shares, held.right, strict=True):
        gaps[int(np.ceil(15 * row.max())) - 1].append(right - row.max())
    assert seen.ece == pytest.approx(sum(abs(sum(gap)) for gap in gaps) / 48)
    assert sum(part.n for part in seen.bins) == study.n_rows == 48
    assert seen.interval[0] < seen.too_sure < seen.interval[1]


def test_unequal_sessions_weigh_alike_in_stated_and_right(data):
    few = Dataset([r for k, r in enumerate(data) if r.session != "day 0" or k % 3])
    seen = confidence_study(few, "hfmh").reliability
    assert seen.too_sure == pytest.approx(seen.probability - seen.accuracy)


def test_each_session_is_covered_by_the_rule_of_the_others(study, held):
    shares, sizes = [], []
    for place in range(4):
        own = held.places == place
        rule = candidate_rule(LABELS, held.values[~own], held.truth[~own], held.places[~own], 0.9)
        names = [rule.names(row) for row in held.values[own]]
        shares.append(np.mean([LABELS[k] in some for k, some in zip(held.truth[own], names, strict=True)]))
        sizes.append(np.mean([len(some) for some in names]))
    (found,) = (one for one in study.coverage if one.level == 0.9)
    assert (found.mean, found.worst) == pytest.approx((np.mean(shares), min(shares)))
    assert found.size == pytest.approx(np.mean(sizes))
    assert [one.size for one in study.coverage] == sorted(one.size for one in study.coverage)


def test_each_material_is_left_out_once(study, data):
    assert tuple(one.label for one in study.unknown) == LABELS
    known, unknown = study.novelty
    assert (len(known), len(unknown)) == (3 * 48, 48)
    assert np.mean(known > 1) == pytest.approx(0.05, abs=0.02)
    for place, one in enumerate(study.unknown):
        assert one.refused == np.mean(unknown[12 * place : 12 * place + 12] > 1)


def test_material_left_out_trains_nowhere(data, study):
    """What is left out could be anything, and is refused when it is unlike; the known ones are answered alike."""
    other = Dataset([replace(r, wrench=0.2 * r.wrench) if r.label == "oat" else r for r in data])
    found = confidence_study(other, "hfmh")
    np.testing.assert_allclose(found.novelty[0][:36], study.novelty[0][:36], rtol=1e-6)
    assert found.unknown[0].auroc > 0.95


def test_numbers_do_not_depend_on_threads(data, study):
    assert confidence_study(data, "hfmh", n_jobs=2).to_dict() == study.to_dict()


def test_table_and_file_hold_every_figure(study, tmp_path):
    sure, text = study.reliability, str(study)
    for words in ("hfmh", "48 recordings, 4 sessions", f"{100 * sure.accuracy:.1f} %", "worst session"):
        assert words in text
    study.save(tmp_path / "c.json")
    stored = json.loads((tmp_path / "c.json").read_text())
    assert stored == json.loads(json.dumps(study.to_dict()))
    assert stored["coverage"][1]["mean"] == study.coverage[1].mean
    assert stored["unknown"][0]["auroc"] == study.unknown[0].auroc


def test_without_sessions_no_promise_is_made_for_new_ones(data):
    found = confidence_study(changed(data, session=lambda r: None), "hfmh")
    assert found.n_sessions == 0
    assert np.isnan(found.reliability.interval).all()
    assert found.to_dict()["reliability"]["interval"] == [None, None]
    assert "no sessions were held out: this holds within those of the recordings only" in str(found)
    assert "worst session" not in str(found)


def test_more_components_than_recordings_are_lowered(data):
    found = confidence_study(data, "pca")
    assert "pca: 35 components, as 36 recordings train" in found.notes


def test_two_synthetic_materials_are_marked_and_none_is_left_out():
    pytest.importorskip("matplotlib")
    two = gid.synthesize(["rice", "fine sugar"], n_per_class=6, sessions=3, duration_s=0.3)
    found = confidence_study(two, "hfmh")
    assert found.unknown == ()
    assert found.synthetic
    assert "two materials only: none can be left out" in found.notes[-1]
    assert str(found).startswith("SYNTHETIC recordings: ")
    figure = plot_confidence(found)
    assert len(figure.axes) == 2
    assert figure.get_suptitle().endswith(", SYNTHETIC recordings")


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"data": np.ones((4, 9, 6))}, r"data must be a granular_id\.Dataset, got ndarray"),
        ({"space": "paper"}, "space must be one of .*, got 'paper'"),
        ({"levels": [0.9, 1.0]}, "levels must lie between 0 and 1, got 1"),
        ({"share_known": 0}, "share_known must lie between 0 and 1, got 0"),
        ({"by": "speed"}, "speed"),
        ({"progress": 3}, "progress"),
    ],
)
def test_bad_arguments_are_refused(data, settings, message):
    with pytest.raises((TypeError, ValueError), match=message):
        confidence_study(**{"data": data, "space": "hfmh", **settings})


def test_figure_shows_the_figures(study):
    pytest.importorskip("matplotlib")
    figure = plot_confidence(study)
    reliable, coverage, unknown = figure.axes
    dots = reliable.collections[0].get_offsets()
    assert dots[:, 1].tolist() == [part.accuracy for part in study.reliability.bins]
    lines = {line.get_label(): line.get_ydata().tolist() for line in coverage.lines}
    assert lines["mean over sessions"] == [one.mean for one in study.coverage]
    assert lines["worst session"] == [one.worst for one in study.coverage]
    assert f"AUROC {np.mean([one.auroc for one in study.unknown]):.3f}" in unknown.get_xlabel()
    without = plot_confidence(replace(study, n_sessions=0)).axes[1]
    assert "worst session" not in {line.get_label() for line in without.lines}


@pytest.mark.parametrize(("more", "height"), [([50.0], 1 / 46), ([], 0.0)])
def test_what_lies_beyond_the_bars_has_a_bar_of_its_own(study, more, height):
    pytest.importorskip("matplotlib")
    novelty = np.linspace(0.0, 0.9, 50), np.append(np.linspace(0.5, 1.5, 45), more)
    panel = plot_confidence(replace(study, novelty=novelty)).axes[2]
    assert panel.get_xticklabels()[-1].get_text().endswith(" 2")
    across, up = panel.patches[1].get_xy().T
    assert up[across > 2.0].max(initial=0.0) == pytest.approx(height)
