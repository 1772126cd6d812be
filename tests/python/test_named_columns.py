"""Tables with named columns: a name is an axis, wherever samples come in."""

import numpy as np
import pandas as pd
import pytest
from sklearn.base import clone
from sklearn.pipeline import make_pipeline

import granular_id as gid
from granular_id.identifier import StreamingIdentifier
from granular_id.recording import AXES, Recording, samples_of

RNG = np.random.default_rng(0)
WRENCH = RNG.normal(size=(40, 6))
GYRO = ["gx", "gy", "gz", "ax", "ay", "az"]
MIXED = [5, 0, 3, 1, 4, 2]


class Polars:
    """As a polars DataFrame shows itself: `columns` is a list, a column is no array but becomes one."""

    def __init__(self, frame):
        self._frame = frame
        self.columns = list(frame.columns)

    def __getitem__(self, name):
        return self._frame[name].to_list()


class Arrow(Polars):
    """As a pyarrow Table: `columns` holds arrays."""

    def __init__(self, frame):
        super().__init__(frame)
        self.column_names, self.columns = self.columns, [frame[name].to_numpy() for name in frame.columns]


TABLES = pytest.mark.parametrize(
    "table", [lambda frame: frame, Polars, Arrow], ids=["pandas", "polars", "arrow"]
)


def frame(values=WRENCH, names=AXES):
    return pd.DataFrame(values, columns=list(names))


def mixed(values=WRENCH):
    """The same samples with the columns in another order."""
    return frame(values).iloc[:, MIXED]


@TABLES
@pytest.mark.parametrize(
    ("given", "axes", "expected"),
    [
        (frame(), AXES, WRENCH),
        (mixed(), AXES, WRENCH),
        (frame(names=[name.capitalize() for name in AXES]), AXES, WRENCH),
        (frame(names=GYRO), tuple(GYRO), WRENCH),
        (frame(WRENCH[:, :2], ["tz", "fx"]), ("tz", "fx"), WRENCH[:, :2]),
        (frame(names=["fx", *GYRO[:5]]), ("fx", *GYRO[:5]), WRENCH),
    ],
)
def test_names_of_columns_are_the_axes_of_samples(table, given, axes, expected):
    samples, names = samples_of(table(given), "X", None)
    assert names == axes
    assert np.array_equal(samples, expected)
    assert samples_of(pd.DataFrame(WRENCH), "X", None)[1] is None
    with pytest.raises(TypeError, match=r"call Dataset\.from_frames"):
        Recording(table(given), rate_hz=500)


@TABLES
@pytest.mark.parametrize(
    ("given", "wanted", "named"),
    [
        (frame().assign(time=0.0), None, "time"),
        (frame().assign(**{"Time [s]": 0.0})[["Time [s]", "fx"]], None, "Time"),
        (frame(WRENCH[:, :3], ["Timestamp", "gx", "gy"]), None, "Timestamp"),
        (frame(names=GYRO), AXES, "gx"),
        (frame().assign(temperature=20.0), AXES, "temperature"),
        (frame(names=[axis.upper() for axis in AXES]).assign(temperature=20.0), None, "temperature"),
        (frame(names=[*AXES[:5], "Fx"]), None, "two columns"),
        (frame(names=GYRO).assign(material="rice"), None, "'material', which is of dtype"),
        (frame(names=pd.MultiIndex.from_product([["force", "torque"], list("xyz")])), None, "wrench"),
    ],
)
def test_what_is_no_axis_is_refused_by_name(table, given, wanted, named):
    with pytest.raises((ValueError, TypeError), match=named):
        samples_of(table(given), "wrench", wanted)


@TABLES
def test_features_of_a_table_are_those_of_its_axes(table):
    expected = gid.extract_features(WRENCH)
    assert np.array_equal(gid.extract_features(table(mixed())), expected)
    both = gid.extract_features([table(mixed()), table(frame())])
    assert np.array_equal(both, [expected, expected])
    for given in (frame(names=GYRO), frame().assign(time=0.0)):
        with pytest.raises(ValueError, match="wrench has"):
            gid.extract_features(table(given))
    with pytest.raises(ValueError, match="one shape"):
        gid.extract_features([table(frame()), table(frame()[:20])])


RAGGED = [WRENCH, WRENCH[:30], WRENCH]


@pytest.mark.parametrize(
    "given",
    [
        RAGGED,
        [one.tolist() for one in RAGGED],
        np.array(RAGGED, dtype=object),
        [frame(one) for one in RAGGED],
    ],
    ids=["arrays", "lists", "objects", "tables"],
)
@pytest.mark.parametrize("takes", [gid.MultiBand().fit, gid.Tare().fit, gid.extract_features])
def test_recordings_of_several_lengths_are_refused_with_a_remedy(takes, given):
    with pytest.raises(
        ValueError, match=r"one shape, got \(30.*\) and \(40.*align\(.* and Dataset\.windows\("
    ):
        takes(given)


PUSHES = RNG.normal(size=(8, 40, 6)) * np.repeat([1, 3], 4)[:, None, None]
MATERIALS = np.repeat(["oats", "rice"], 4)


@TABLES
@pytest.mark.parametrize("space", [gid.RawHFMH(), gid.MultiBand()], ids=["RawHFMH", "MultiBand"])
def test_estimators_take_lists_of_tables_by_name(table, space):
    model = make_pipeline(space, gid.ECOCClassifier()).fit([table(mixed(push)) for push in PUSHES], MATERIALS)
    plain = make_pipeline(clone(space), gid.ECOCClassifier()).fit(PUSHES, MATERIALS)
    expected = plain.decision_function(PUSHES)
    for given in (PUSHES, [table(frame(push)) for push in PUSHES]):
        assert np.array_equal(model.decision_function(given), expected)
        assert np.array_equal(plain.decision_function(given), expected)
    with pytest.raises(ValueError, match="gx"):
        model.predict([table(frame(push, GYRO)) for push in PUSHES])
    with pytest.raises(ValueError, match=r"\[X\]"):
        model.predict(table(frame(PUSHES[0])))


def test_an_estimator_wants_the_names_it_was_fitted_on():
    two_axes = [frame(push[:, :2], ["gx", "gy"]) for push in PUSHES]
    space = gid.HFMH(n_bins=4).fit(two_axes)
    turned = [frame(push[:, 1::-1], ["gy", "gx"]) for push in PUSHES]
    assert np.array_equal(space.transform(turned), space.transform(PUSHES[:, :, :2]))
    with pytest.raises(ValueError, match="gx gy"):
        space.transform([frame(push[:, :2], ["gx", "gz"]) for push in PUSHES])
    space.fit(PUSHES[:, :, :2])
    space.transform([frame(push[:, :2], ["gx", "gz"]) for push in PUSHES])
    named = gid.HFMH(n_bins=4).fit([frame(push, GYRO) for push in PUSHES])
    assert named.get_feature_names_out()[::4].tolist() == [f"hfmh_{axis}_00" for axis in GYRO]


@pytest.fixture(scope="module")
def model():
    pushes = zip(PUSHES, MATERIALS, strict=True)
    data = gid.Dataset([gid.Recording(push, rate_hz=500.0, label=str(label)) for push, label in pushes])
    return gid.Identifier.fit(data, "raw+hfmh", estimate=False)


@TABLES
def test_model_orders_columns_and_refuses_other_names(model, table):
    assert np.array_equal(model.scores([table(mixed(push)) for push in PUSHES]), model.scores(PUSHES))
    assert np.array_equal(model.scores(table(mixed(PUSHES[0]))), model.scores(PUSHES[0]))
    assert model.identify(table(mixed(PUSHES[0]))) == model.identify(PUSHES[0])
    stream = StreamingIdentifier(model)
    stream.push(table(mixed(PUSHES[0])))
    assert stream.decision() == model.identify(PUSHES[0])
    for given in (frame(PUSHES[0], GYRO), frame(PUSHES[0]).assign(time=0.0)):
        for refuses in (model.predict, model.identify, stream.push):
            with pytest.raises(ValueError, match=f"{given.columns[-1]}.* {' '.join(AXES)}"):
                refuses(table(given))
