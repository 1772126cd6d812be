"""Estimators take a ``Dataset``: axes, units, rate, labels, sessions and order come from it."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.decomposition import PCA
from sklearn.model_selection import GroupKFold, cross_val_score
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
    RawHFMH,
    RawSignal,
    Tare,
    WithinClassWhitening,
    band_columns,
    feature_blocks,
    fit_pipeline,
)
from granular_id.splits import groups_of
from spaces_cases import FILTERS, IMU, IMU_UNITS, SPACES, STATISTICS, data_set, recordings

WRENCH = data_set()
DRIVES = data_set(axes=IMU, units=IMU_UNITS, rate_hz=100.0)
FAST = data_set(axes=IMU, units=IMU_UNITS, rate_hz=1000.0)
EVERY = SPACES | STATISTICS | FILTERS


def with_rate(space, rate_hz):
    space = clone(space)
    return space.set_params(rate_hz=rate_hz) if "rate_hz" in space.get_params() else space


@pytest.mark.parametrize("name", EVERY)
def test_features_of_a_dataset_are_those_of_its_array(name):
    space = with_rate(EVERY[name], None)
    own = space.fit_transform(FAST)
    values = own.X if isinstance(own, Dataset) else own
    np.testing.assert_array_equal(values, with_rate(EVERY[name], 1000.0).fit_transform(FAST.X))
    if name in FILTERS:
        assert (own.rate_hz, own.axes, own.y.tolist()) == (1000.0, IMU, FAST.y.tolist())
    else:
        np.testing.assert_array_equal(values, space.transform(list(FAST)))
        np.testing.assert_array_equal(values, space.transform(FAST.X))


@pytest.mark.parametrize("name", SPACES | STATISTICS)
def test_features_are_named_after_the_known_axes(name):
    space = with_rate(EVERY[name], None)
    neutral = space.fit(FAST.X).get_feature_names_out().tolist()
    assert not any(axis in column.split("_") for column in neutral for axis in AXES)
    own = {f"axis{k}": axis for k, axis in enumerate(IMU)}
    expected = ["_".join(own.get(part, part) for part in column.split("_")) for column in neutral]
    assert space.fit(FAST).get_feature_names_out().tolist() == expected


@pytest.mark.parametrize(
    ("data", "unit", "units"),
    [
        (WRENCH, "N, N m", ("N",) * 3 + ("N m",) * 3),
        (DRIVES, "rad/s, m/s2", IMU_UNITS),
        (data_set(axes=IMU, rate_hz=100.0), "", ("",) * 6),
        (recordings(n_axes=2), "", ("",) * 2),
    ],
)
def test_bins_are_in_the_known_units(data, unit, units):
    (block,) = HFMH().fit(data).feature_blocks()
    assert (block.unit, block.units) == (unit, units)
    assert tuple(own.unit for own in HFMH(bin_range="auto").fit(data).feature_blocks()) == units


def test_axes_units_and_rate_pass_filters_and_unions():
    pipeline = make_pipeline(Tare(), FeatureUnion([("raw", RawSignal()), ("dft", DFT())])).fit(DRIVES)
    raw, *_, last = feature_blocks(pipeline)
    assert (raw.axes, raw.unit, last.unit) == (IMU, "s", "Hz")
    assert last.coordinates[-1] == pytest.approx(50 - 100 / 300)
    columns = band_columns(make_pipeline(Tare(), MultiBand()).fit(DRIVES))
    assert (columns.axes, columns.units, columns.duration_s) == (IMU, IMU_UNITS, 3.0)


@pytest.mark.parametrize(
    ("space", "default"),
    [(RawHFMH(), 500.0), (MultiBand(), 500.0), (Tare(), 500.0), (RawSignal(), None), (DFT(), None)],
)
def test_rate_is_stated_or_that_of_the_dataset(space, default):
    assert space.fit(DRIVES).rate_hz_ == 100.0
    assert space.fit(DRIVES.X).rate_hz_ == default
    assert with_rate(space, 100).fit(DRIVES).rate_hz_ == 100.0
    with pytest.raises(ValueError, match="rate_hz=500, but the recordings have 100 Hz: leave it out"):
        with_rate(space, 500).fit(DRIVES)


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (data_set(axes=IMU, units=IMU_UNITS, rate_hz=50.0), r"X has 50 Hz, in fit it was 100: call \.resample\(100\)"),
        (DRIVES.select(axes=IMU[::-1]), r"X has the axes az .*, in fit they were wx .*: call \.select\(axes"),
        (data_set(axes=IMU, units=("deg/s",) * 6, rate_hz=100.0), "unit wx: deg/s, in fit it was wx: rad/s: convert"),
        (Dataset([DRIVES[0], replace(DRIVES[1], wrench=DRIVES[1].wrench[:9])]), r"length .*\.align\(n_samples"),
        (DRIVES[0], r"got one Recording: pass \[X\]"),
    ],
)  # fmt: skip
def test_recordings_of_another_kind_are_refused(other, message):
    for space in (MultiBand().fit(DRIVES), Tare().fit(DRIVES)):
        with pytest.raises((ValueError, TypeError), match=message):
            space.transform(other)


def test_recordings_without_known_units_are_taken():
    space = RawSignal().fit(DRIVES)
    unknown = data_set(axes=IMU, rate_hz=100.0)
    np.testing.assert_array_equal(space.transform(unknown), space.transform(DRIVES))


def test_cutoff_near_half_the_rate_warns():
    with pytest.warns(UserWarning, match=r"cutoff_hz=23 leaves nearly nothing .* such as cutoff_hz=12"):
        HFMH().fit(data_set(rate_hz=50))
    HFMH(cutoff_hz=12).fit(data_set(rate_hz=50))  # pytest makes errors of warnings
    HFMH().fit(data_set(rate_hz=100))


@pytest.mark.parametrize(
    "steps",
    [
        (RawHFMH(),),
        (Tare(), RawHFMH()),
        (RawHFMH(), BlockScaler(), WithinClassWhitening()),
        (RawHFMH(), PCA(3), RICA(2, random_state=0)),
    ],
)
def test_pipeline_takes_a_dataset_and_its_labels(steps):
    pipeline = make_pipeline(*steps, ECOCClassifier())
    expected = clone(pipeline).fit(DRIVES.X, DRIVES.y)  # rates differ, the raw samples decide
    pipeline.fit(DRIVES, DRIVES.y)
    assert pipeline.named_steps["rawhfmh"].rate_hz_ == 100.0
    assert pipeline.predict(DRIVES).tolist() == expected.predict(DRIVES.X).tolist()
    assert pipeline.predict([DRIVES[0]]).shape == (1,)
    stored = pickle.dumps(pipeline)
    assert pickle.loads(stored).predict(DRIVES).tolist() == pipeline.predict(DRIVES).tolist()
    assert b"Recording" not in stored


@pytest.mark.parametrize("front", [(), (Tare(),)])
def test_fit_pipeline_hands_blocks_and_sessions_on(front):
    data = data_set(n=18)
    best = BestClassifier(optional_blocks=["level"])
    own = make_pipeline(*front, MultiBand(blocks=["quantiles", "level"]), best)
    fit_pipeline(own, data, data.y, groups_of(data))
    assert own[-1].choice_.held_out == "sessions"
    assert own[-1].blocks == own[-2].block_sizes_
    expected = clone(own[-1]).fit(own[:-1].transform(data), data.y, sessions=data.sessions)
    np.testing.assert_array_equal(own[-1].coef_, expected.coef_)


def test_dataset_is_cross_validated_as_its_array():
    data = data_set(n=18)
    pipeline = make_pipeline(RawSignal(), BlockScaler(), ECOCClassifier())
    options = {"groups": data.sessions, "cv": GroupKFold(3)}
    scores = cross_val_score(pipeline, data, data.y, **options)
    np.testing.assert_array_equal(scores, cross_val_score(pipeline, data.X, data.y, **options))
