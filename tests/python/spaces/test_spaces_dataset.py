"""Estimators take a ``Dataset``: axes, units, rate, labels, sessions and order come from it."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.decomposition import PCA
from sklearn.linear_model import LogisticRegression
from sklearn.model_selection import GroupKFold, cross_val_predict, cross_val_score
from sklearn.pipeline import FeatureUnion, make_pipeline

from granular_id import ECOCClassifier
from granular_id.recording import AXES, Dataset
from granular_id.rica import RICA
from granular_id.spaces import (
    DFT,
    HFMH,
    BestClassifier,
    BlockScaler,
    MultiBand,
    RangeNormalizer,
    RawHFMH,
    RawHistogram,
    RawSignal,
    Tare,
    WithinClassWhitening,
    feature_blocks,
)
from granular_id.spaces.multiband import band_columns
from granular_id.spaces.presets import fit_pipeline
from granular_id.splits import groups_of
from spaces_cases import FILTERS, IMU, IMU_UNITS, SPACES, STATISTICS, data_set, recordings

WRENCH = data_set()
DRIVES = data_set(axes=IMU, units=IMU_UNITS, rate_hz=100.0)
FAST = data_set(axes=IMU, units=IMU_UNITS, rate_hz=1000.0)
EVERY = SPACES | STATISTICS | FILTERS


def plain(space):
    """A copy that has the rate of FAST, for arrays."""
    rates = [name for name in space.get_params() if name.rpartition("__")[2] == "rate_hz"]
    return clone(space).set_params(**dict.fromkeys(rates, 1000.0))


# -- features


@pytest.mark.parametrize("name", EVERY)
def test_features_of_a_data_set_are_those_of_its_array(name):
    space = clone(EVERY[name])
    if "rate_hz" in space.get_params():
        space.set_params(rate_hz=None)
    own = space.fit_transform(FAST)
    own = own.X if isinstance(own, Dataset) else own
    np.testing.assert_array_equal(own, plain(EVERY[name]).fit_transform(FAST.X))
    if name in FILTERS:
        return
    np.testing.assert_array_equal(own, space.fit(FAST).transform(list(FAST)))
    np.testing.assert_array_equal(own, space.transform(FAST.X))


@pytest.mark.parametrize("name", SPACES | STATISTICS)
def test_features_are_named_after_the_axes_that_are_known(name):
    space = clone(EVERY[name])
    if "rate_hz" in space.get_params():
        space.set_params(rate_hz=None)
    neutral = space.fit(FAST.X).get_feature_names_out().tolist()
    assert not any(axis in column.split("_") for column in neutral for axis in AXES)
    known = space.fit(FAST).get_feature_names_out().tolist()
    own = {f"axis{k}": axis for k, axis in enumerate(IMU)}
    assert known == ["_".join(own.get(part, part) for part in column.split("_")) for column in neutral]


def test_axes_of_a_wrench_in_another_order_keep_their_names():
    turned = WRENCH.select(axes=["tz", "fx", "fy", "fz", "tx", "ty"])
    union = FeatureUnion([("raw", RawSignal()), ("hist", RawHistogram(n_bins=2))])
    union.set_params(verbose_feature_names_out=False).fit(turned)
    assert union.get_feature_names_out()[[0, 300, -2]].tolist() == ["tz_0000", "fx_0000", "hist_ty_00"]


@pytest.mark.parametrize(
    ("data", "unit", "units"),
    [
        (WRENCH, "N, N m", ("N",) * 3 + ("N m",) * 3),
        (DRIVES, "rad/s, m/s2", IMU_UNITS),
        (data_set(axes=IMU, rate_hz=100.0), "", ("",) * 6),
        (recordings(), "", ("",) * 6),
        (recordings(n_axes=2), "", ("",) * 2),
    ],
)
def test_bins_are_in_the_units_that_are_known(data, unit, units):
    (block,) = HFMH().fit(data).feature_blocks()
    assert (block.unit, block.units) == (unit, units)
    blocks = HFMH(bin_range="auto").fit(data).feature_blocks()
    assert tuple(block.unit for block in blocks) == units


def test_axes_units_and_rate_pass_filters_and_unions():
    pipeline = make_pipeline(Tare(), FeatureUnion([("raw", RawSignal()), ("dft", DFT())])).fit(DRIVES)
    raw, *_, last = feature_blocks(pipeline)
    assert (raw.axes, raw.unit, last.unit) == (IMU, "s", "Hz")
    assert last.coordinates[-1] == pytest.approx(50 - 100 / 300)
    columns = band_columns(make_pipeline(Tare(), MultiBand()).fit(DRIVES))
    assert (columns.axes, columns.units, columns.duration_s) == (IMU, IMU_UNITS, 3.0)
    assert columns.names[0] == "b0_coupling_wx_wx"


# -- rate


@pytest.mark.parametrize("space", [HFMH, RawHFMH, MultiBand, Tare, RawSignal, DFT, RangeNormalizer])
def test_the_rate_is_stated_or_that_of_the_data_set(space):
    default = None if space in (RawSignal, DFT, RangeNormalizer) else 500.0
    assert space().fit(DRIVES).rate_hz_ == 100.0
    assert space().fit(DRIVES.X).rate_hz_ == default
    assert space(rate_hz=100).fit(DRIVES).rate_hz_ == 100.0
    with pytest.raises(
        ValueError, match=r"rate_hz=500, but the recordings have 100 Hz: leave it out, or resample"
    ):
        space(rate_hz=500).fit(DRIVES)


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (data_set(axes=IMU, units=IMU_UNITS, rate_hz=50.0), r"X has 50 Hz, in fit it was 100: call \.resample\(100\)"),
        (DRIVES.select(axes=IMU[::-1]), r"X has the axes az .*, in fit they were wx .*: call \.select\(axes"),
        (data_set(axes=IMU, units=("deg/s",) * 6, rate_hz=100.0), "unit wx: deg/s, in fit it was wx: rad/s: convert"),
        (data_set(axes=IMU, units=IMU_UNITS, rate_hz=100.0, n_samples=200), r"shape \(n, 300, 6\) as in fit"),
        (Dataset([DRIVES[0], replace(DRIVES[1], wrench=DRIVES[1].wrench[:9])]), r"length .*\.align\(n_samples"),
        (DRIVES[0], r"got one Recording: pass \[X\]"),
    ],
)  # fmt: skip
def test_recordings_of_another_kind_than_in_fit_are_refused(other, message):
    for space in (MultiBand().fit(DRIVES), Tare().fit(DRIVES)):
        with pytest.raises((ValueError, TypeError), match=message):
            space.transform(other)


def test_recordings_whose_units_are_not_known_are_taken():
    space = RawSignal().fit(DRIVES)
    unknown = data_set(axes=IMU, rate_hz=100.0)
    np.testing.assert_array_equal(space.transform(unknown), space.transform(DRIVES))


@pytest.mark.parametrize(
    ("rate_hz", "keywords", "told"),
    [
        (50, {}, r"cutoff_hz=23 leaves nearly nothing of a signal at 50 Hz, .* 25 Hz: .* cutoff_hz=12, or MultiBand"),
        (500, {"cutoff_hz": 249}, "such as cutoff_hz=1.2e"),
        (100, {}, None),
        (50, {"cutoff_hz": 12}, None),
    ],
)  # fmt: skip
def test_a_cutoff_near_half_the_rate_is_told(rate_hz, keywords, told):
    data = data_set(rate_hz=rate_hz)
    if told is None:
        HFMH(**keywords).fit(data)  # pytest makes errors of warnings
        return
    with pytest.warns(UserWarning, match=told) as heard:
        HFMH(**keywords).fit(data)
    assert [warning.filename for warning in heard] == [__file__]


# -- labels, sessions, order


LINEAR = {
    "features alone": (),
    "a filter": (Tare(),),
    "scaled": (BlockScaler(),),
    "whitened": (BlockScaler(), WithinClassWhitening()),
    "components": (PCA(3), RICA(2, random_state=0)),
}


@pytest.mark.parametrize("between", LINEAR)
def test_a_pipeline_takes_a_data_set_and_its_labels(between):
    steps = LINEAR[between]
    front = steps if between == "a filter" else ()
    pipeline = make_pipeline(*front, RawHFMH(), *(() if front else steps), ECOCClassifier())
    expected = clone(pipeline).fit(DRIVES.X, DRIVES.y)  # rates differ, the raw samples decide
    pipeline.fit(DRIVES, DRIVES.y)
    assert pipeline[-1].n_features_in_ == expected[-1].n_features_in_
    assert pipeline.named_steps["rawhfmh"].rate_hz_ == 100.0
    assert pipeline.predict(DRIVES).tolist() == expected.predict(DRIVES.X).tolist()
    assert pipeline.score(DRIVES, DRIVES.y) == pipeline.score(DRIVES.X, DRIVES.y)
    assert pipeline.predict([DRIVES[0]]).shape == (1,)


def test_a_filter_gives_back_a_data_set_with_all_that_it_knows():
    tared = Tare().fit_transform(DRIVES)
    assert isinstance(tared, Dataset)
    assert (tared.rate_hz, tared.axes, tared.y.tolist()) == (100.0, IMU, DRIVES.y.tolist())
    np.testing.assert_array_equal(tared.X, Tare(rate_hz=100.0).fit_transform(DRIVES.X))


@pytest.mark.parametrize("front", [(), (Tare(),)])
def test_fit_pipeline_hands_blocks_and_sessions_to_the_steps(front):
    data = data_set(n=18)
    best = BestClassifier(optional_blocks=["level"])
    own = make_pipeline(*front, MultiBand(blocks=["quantiles", "level"]), best)
    fit_pipeline(own, data, data.y, groups_of(data))
    assert own[-1].choice_.held_out == "sessions"
    assert own[-1].blocks == own[-2].block_sizes_
    features = own[:-1].transform(data)
    expected = clone(own[-1]).fit(features, data.y, sessions=data.sessions)
    np.testing.assert_array_equal(own[-1].coef_, expected.coef_)


def test_best_holds_out_what_is_passed():
    features = MultiBand().fit_transform(data_set(n=12))
    turned = ["rice", "oat"] * 6
    alone = BestClassifier().fit(features, turned, sessions=list("abc") * 4)
    assert alone.predict(features).tolist() == turned
    assert alone.choice_.held_out == "sessions"
    ordered = BestClassifier().fit(features, turned, order=np.arange(12))
    assert ordered.choice_.held_out == "blocks in time"


@pytest.mark.parametrize("last", [ECOCClassifier(), BestClassifier(), LogisticRegression()])
def test_a_data_set_is_cross_validated(last):
    data = data_set(n=18)
    pipeline = make_pipeline(MultiBand(), BlockScaler(), last)
    scores = cross_val_score(pipeline, data, data.y, groups=data.sessions, cv=GroupKFold(3))
    plain_scores = cross_val_score(
        make_pipeline(MultiBand(), BlockScaler(), clone(last)),
        data.X,
        data.y,
        groups=data.sessions,
        cv=GroupKFold(3),
    )
    assert scores.shape == plain_scores.shape == (3,)
    assert min(scores) > 0.8
    assert len(cross_val_predict(pipeline, data, data.y, cv=3)) == 18


def test_a_fitted_pipeline_pickles_without_the_recordings():
    pipeline = make_pipeline(Tare(), MultiBand(), BlockScaler(), ECOCClassifier()).fit(DRIVES, DRIVES.y)
    stored = pickle.dumps(pipeline)
    assert pickle.loads(stored).predict(DRIVES).tolist() == pipeline.predict(DRIVES).tolist()
    assert b"Recording" not in stored


def test_a_union_of_arrays_refuses_a_data_set_of_another_rate():
    union = FeatureUnion([("hfmh", HFMH()), ("raw", RawSignal())]).fit(DRIVES.X)
    with pytest.raises(ValueError, match="500"):
        union.transform(DRIVES)
