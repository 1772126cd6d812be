"""explain in the multi-band space: exact sums, planted differences found and put in words."""

import json

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

import multiband_twin as twin
from granular_id.ecoc import ECOCClassifier
from granular_id.explanation import BandExplanation, explain
from granular_id.explanation.bands import moments, said
from granular_id.spaces import BlockScaler, MultiBand, RawSignal, Tare, WithinClassWhitening
from granular_id.spaces.best import BestClassifier
from granular_id.spaces.multiband import band_columns
from multiband_cases import ALL, as_wrench, coupled, louder, two_materials


def sizes_of(space):
    columns = band_columns(space)
    return {block: columns.of(block=block).size for block in columns.blocks}


def model_of(X, y, *, whitened=False):
    space = MultiBand(blocks=ALL).fit(X)
    after = [BlockScaler(sizes_of(space)), *([WithinClassWhitening(0.01)] if whitened else [])]
    return make_pipeline(clone(space), *after, ECOCClassifier()).fit(as_wrench(X), y)


@pytest.fixture(scope="module")
def seen():
    X, y = louder()
    return explain(model_of(X[:16], y[:16], whitened=True), "rice", "oat", X[16:], y[16:])


@pytest.fixture(scope="module")
def three():
    """Three materials, and a model of them."""
    X, y = louder()
    y = np.where(np.arange(len(y)) % 5 == 4, "peas", y)
    return X, y, model_of(X, y, whitened=True)


def test_every_account_adds_up_to_the_difference(three):
    X, y, model = three
    for first, second in (("rice", "oat"), ("oat", "peas")):
        found = explain(model, first, second, X, y)
        assert isinstance(found, BandExplanation)
        scores = model[-1].binary_scores(model[:-1].transform(X))
        classes = list(model[-1].classes_)
        codes = model[-1].coding_matrix_
        a, b = classes.index(first), classes.index(second)
        (learner,) = np.flatnonzero(codes[a] * codes[b] == -1)
        own = codes[a, learner] * scores[:, learner]
        wanted = own[y == first].mean() - own[y == second].mean()
        assert found.difference == pytest.approx(wanted, rel=1e-9)
        assert found.contributions.sum() == pytest.approx(wanted, rel=1e-9)
        for sums in (found.by_block(), found.by_band(), found.by_axis()):
            assert sum(sums.values()) == pytest.approx(wanted, rel=1e-9)
        for table in (found.by_block_and_axis(), found.by_band_and_axis()):
            assert sum(sum(row.values()) for row in table.values()) == pytest.approx(wanted, rel=1e-9)
        pairs = found.by_pair()
        assert sum(pairs.values()) == pytest.approx(found.by_block()["coupling"], rel=1e-9)
        by_band = [sum(found.by_pair(number).values()) for number in range(len(found.columns.bands))]
        assert sum(by_band) == pytest.approx(sum(pairs.values()), rel=1e-9)
        everything = found.findings(10**6)
        assert sum(one.contribution for one in everything) >= wanted


def test_accounts_equal_those_of_the_names(seen):
    """Written anew from the names of the features."""
    axes, bands, pairs = {}, {}, {}
    for name, value in zip(seen.columns.names, seen.contributions, strict=True):
        words = name.split("_")
        known = [word for word in words if word in ("fx", "fy", "fz", "tx", "ty", "tz")]
        for axis in known:
            axes[axis] = axes.get(axis, 0.0) + value / len(known)
        place = int(words[0][1:]) if words[0][0] == "b" else words[0]
        bands[place] = bands.get(place, 0.0) + value
        if "coupling" in words:
            key = (*known, next((int(word[3:]) for word in words if word.startswith("lag")), 0))
            pairs[key] = pairs.get(key, 0.0) + value
    assert seen.by_axis() == pytest.approx(axes)
    assert list(seen.by_band().values()) == pytest.approx(list(bands.values()))
    assert seen.by_pair() == pytest.approx(pairs)
    assert len(pairs) == 21 + 2 * 36  # octave 2 has a lag of its own


def test_planted_energy_is_found(seen):
    assert max(seen.by_axis(), key=seen.by_axis().get) == "fz"
    banded = {name: value for name, value in seen.by_band().items() if name.endswith("Hz")}
    assert max(banded, key=banded.get) == "15-31 Hz"
    best = seen.findings(1)[0]
    assert (str(best.band), best.axes, best.lag_s) == ("15-31 Hz", ("fz",), 0.0)
    assert best.words.startswith("more energy on fz")
    assert "in rice than in oat" in best.words
    assert best.feature in seen.columns.names
    assert best.words in str(seen)
    assert "of the difference between rice and oat: more energy on fz" in seen.top(1)[0]
    for both, n_axes in ((False, 1), (True, 2)):  # an axis that is alone is named, not coupled
        assert {len(finding.axes) for finding in seen.findings(50, coupled=both)} == {n_axes}
    assert seen.findings(0) == ()
    with pytest.raises(ValueError, match="n must be at least 0, got -1"):
        seen.findings(-1)


@pytest.mark.parametrize(
    ("sign", "lag", "words"),
    [
        (1.0, 0, "fx and tz move together more in rice than in oat (correlation"),
        (-1.0, 0, "fx and tz move against each other more in rice than in oat (correlation"),
        (1.0, 2, "fx and tz 4 ms earlier move together more in rice than in oat"),
    ],
)
def test_planted_coupling_is_found(sign, lag, words):
    X, y = coupled(sign, lag)
    found = explain(model_of(X[:16], y[:16]), "rice", "oat", X[16:], y[16:])
    best = next(one for one in found.findings(50, coupled=True) if bool(one.lag_s) == bool(lag))
    assert (str(best.band), best.axes, best.lag_s) == ("61-122 Hz", ("fx", "tz"), pytest.approx(0.002 * lag))
    assert best.words.startswith(f"in 61-122 Hz, {words}")
    lag //= 2  # octave 2 has half the rate
    pairs = {key: value for key, value in found.by_pair(2).items() if key[2] == lag}
    assert max(pairs, key=pairs.get) == ("fx", "tz", lag)
    assert "Strongest couplings:" in str(found)


def test_moments_have_the_features_that_they_come_from():
    X, _, _ = two_materials(n_each=2)
    X[..., 1] = 0.0
    space = MultiBand(blocks=("coupling",)).fit(X)
    columns = band_columns(space)
    row = space.transform(X[:1])[0]
    now, one = np.triu_indices(6), np.eye(12)
    for band, signal in enumerate(twin.band_signals(X[0])):
        own = row[columns.of(block="coupling", band=band)]
        if not own.size:
            continue
        made = moments(columns, row, band)
        level = sum(one - 2 * c * np.linalg.inv(made + c * one) for c in twin.SHIFTS)
        features = np.concatenate([level[:6, :6][now], level[:6, 6:].ravel()])
        np.testing.assert_allclose(features, own, atol=1e-8)
        wanted = twin.moments_of(signal / space.scales_[band], twin.lag(band, 512))
        np.testing.assert_allclose(made, wanted, atol=0.1 * np.abs(wanted).max())
        assert 0 < made[1, 1] < 1e-3


@pytest.mark.parametrize(
    ("n_samples", "level", "envelope"),
    [
        (80, "from 0.040 to 0.050 s", "from 0.04 to 0.08 s"),
        (16, "from 0.008 to 0.010 s", "from 0.008 to 0.016 s"),
    ],
)
def test_stretches_of_short_recordings_have_two_different_ends(n_samples, level, envelope):
    X, _, _ = two_materials(n_each=2)
    columns = band_columns(MultiBand(blocks=("level", "envelope")).fit(as_wrench(X[:, :n_samples])))
    means = np.ones((2, len(columns.names)))
    for name, stretch in (("level_fz_04", level), ("b0_envelope_fz_1", envelope)):
        assert stretch in said(columns, means, ("oat", "rice"), columns.names.index(name))


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ((1, 1), "This rests on one recording of rice and one of oat: it may hold for no other recording."),
        ((1, 3), "This rests on one recording of rice: it may hold for no other recording."),
        ((2, 2), ""),
    ],
)
@pytest.mark.parametrize("space", [MultiBand(blocks=ALL), RawSignal()], ids=["multi-band", "raw"])
def test_one_recording_of_a_material_is_told(space, rows, said):
    X, y = louder()
    model = make_pipeline(space, ECOCClassifier()).fit(X, y)
    few = np.concatenate([np.flatnonzero(y == k)[:n] for k, n in zip(("rice", "oat"), rows, strict=True)])
    lines = str(explain(model, "rice", "oat", X[few], y[few])).splitlines()
    each = "1 recording each" if rows == (1, 1) else f"{rows[0]} and {rows[1]} recordings"
    assert lines[0].startswith(f"rice against oat, {each}: mean scores ")
    assert [line for line in lines if "rests on" in line] == [said] * bool(said)


@pytest.mark.parametrize(
    ("name", "oat", "rice", "words"),
    [
        (
            "b3_logrms_fz",
            np.log(3.0),
            0,
            "more energy on fz in 31-61 Hz in oat than in rice (9 times as much)",
        ),
        ("b0_logrms_tx", 0, 0.05, "more energy on tx in the whole signal in rice than in oat (11 % more)"),
        ("b3_logrms_fz", 0, 0, "as much energy on fz in 31-61 Hz in oat as in rice"),
        ("b1_logrms_fz", 800, 0, "(10,000 times as much, or more)"),
        (
            "b4_envelope_fy_3",
            np.log(2.5),
            0,
            "in 15-31 Hz from 0.77 to 1.02 s in oat than in rice (2.5 times",
        ),
        ("b2_q98_tx", 1, 0, "98th percentile of tx in 61-122 Hz: {value:+.3g} N m in oat, +0 N m in rice"),
        ("b2_q02_fx", 0, 0, "2nd percentile of fx"),
        ("level_fz_00", 0, 0, "mean of fz from 0.00 to 0.06 s: +0 N"),
        ("spectrum_fz_10", np.log(2.0), 0, "more energy on fz near "),
        (
            "b2_coupling_fx_fx",
            sum((1.2 - c) / (1.2 + c) for c in twin.SHIFTS),  # of a moment of 1.2; that of 0 is 0.3
            0,
            "more energy on fx in 61-122 Hz in oat than in rice (4 times as",
        ),
        (
            "b2_coupling_fx_tz_lag1",
            0.5,
            0.1,
            "in 61-122 Hz, fx and tz 4 ms earlier move together more in oat",
        ),
        ("b2_coupling_fx_tz_lag1", 0.5, 0.1, "than in rice (correlation +0.87, +0.29)"),
        ("b2_coupling_fx_tz", 0.9, -0.5, "move together in oat, against each other in rice (correlation"),
        ("b2_coupling_fx_tz", 0, 0, "move as alike in oat as in rice"),
    ],
)
def test_words_are_those_of_the_means(name, oat, rice, words):
    X, _, _ = two_materials(n_each=2)
    space = MultiBand(blocks=ALL).fit(as_wrench(X))
    columns = band_columns(space)
    means = np.zeros((2, len(columns.names)))
    means[:, columns.names.index(name)] = oat, rice
    value = np.sinh(1.0) * space.scales_[2, 3]
    assert words.format(value=value) in said(columns, means, ("oat", "rice"), columns.names.index(name))


def test_a_model_that_does_not_tell_them_apart_is_told_in_scores():
    X, y = louder()
    model = make_pipeline(Tare(0.1), MultiBand(), StandardScaler(), ECOCClassifier()).fit(as_wrench(X), y)
    assert explain(model, "rice", "oat", X, y).findings(1)[0].axes == ("fz",)
    found = explain(model, "oat", "rice", X, np.where(y == "oat", "rice", "oat"))
    assert found.difference < 0
    assert "does not score oat above rice" in str(found)
    assert "%" not in str(found).split("Strongest of all")[0]


def test_to_dict_is_json(seen):
    read = json.loads(json.dumps(seen.to_dict(), allow_nan=False))
    assert sum(read["features"]["contributions"]) == pytest.approx(read["difference"])
    assert sum(one["contribution"] for one in read["by_pair"]) == pytest.approx(read["by_block"]["coupling"])
    assert read["bands"][1]["high_hz"] == pytest.approx(245.0)
    assert read["top"] == list(seen.top())
    assert [block["name"] for block in read["blocks"]] == ["spectrum", "level"]


def test_the_best_classifier_is_explained():
    X, y = louder()
    space = MultiBand().fit(as_wrench(X))
    features = space.transform(X)
    best = BestClassifier(blocks=sizes_of(space)).fit(features, y)
    found = explain(make_pipeline(space, best), "rice", "oat", X, y)
    scores = best.binary_scores(features)[:, 0] * found.factors[0]
    assert found.difference == pytest.approx(scores[y == "rice"].mean() - scores[y == "oat"].mean())
    assert found.contributions.sum() == pytest.approx(found.difference)
    assert max(found.by_axis(), key=found.by_axis().get) == "fz"


@pytest.mark.parametrize("n_axes", [1, 2, 13])
def test_other_numbers_of_axes(n_axes):
    X, y, _ = two_materials(n_each=4, n_samples=64, n_axes=n_axes)
    X[y == "rice", :, -1] *= 3
    model = make_pipeline(MultiBand(blocks=ALL), StandardScaler(), ECOCClassifier()).fit(X, y)
    found = explain(model, "rice", "oat", X, y)
    assert len(found.by_axis()) == n_axes
    assert sum(found.by_axis().values()) == pytest.approx(found.difference)
    assert f"axis{n_axes - 1}" in str(found)
