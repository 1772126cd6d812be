"""Tables with named columns: `Dataset.from_frames` reads them, and nothing that wants an array takes them as one."""

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

import granular_id as gid
from array_kinds import Polars
from granular_id.identifier import StreamingIdentifier
from granular_id.recording import AXES, Recording

RNG = np.random.default_rng(0)
WRENCH = RNG.normal(size=(40, 6))


TABLES = pytest.mark.parametrize(
    "table", [lambda frame: frame, Polars, pa.table], ids=["pandas", "polars", "arrow"]
)


def mixed(values=WRENCH):
    """A table whose columns are in another order than the axes of a wrench."""
    return pd.DataFrame(values, columns=list(AXES)).iloc[:, [5, 0, 3, 1, 4, 2]]


PUSHES = RNG.normal(size=(8, 40, 6)) * np.repeat([1, 3], 4)[:, None, None]
MATERIALS = np.repeat(["oats", "rice"], 4)


@pytest.fixture(scope="module")
def model():
    return gid.Identifier.fit(
        gid.Dataset.from_arrays(PUSHES, MATERIALS, rate_hz=500), "raw+hfmh", estimate=False
    )


@TABLES
def test_tables_are_refused_where_arrays_are_wanted(model, table):
    one, several = table(mixed()), [WRENCH, table(mixed())]
    takes_one = (gid.extract_features, gid.RawHFMH().fit, model.identify, StreamingIdentifier(model).push)
    takes_several = (gid.extract_features, model.predict, gid.RawHFMH().fit, gid.MultiBand().fit)
    for takes, given in [(take, one) for take in takes_one] + [(take, several) for take in takes_several]:
        with pytest.raises(TypeError, match=r"with named columns; .* pass Dataset\.from_frames\("):
            takes(given)
    with pytest.raises(TypeError, match=r"call Dataset\.from_frames"):
        Recording(one, rate_hz=500)


@TABLES
def test_what_a_refusal_of_tables_offers_reads_them(model, table):
    data = gid.Dataset.from_frames([table(mixed(push)) for push in PUSHES], MATERIALS, rate_hz=500)
    assert np.array_equal(data.X, PUSHES)
    assert model.predict(data).tolist() == model.predict(PUSHES).tolist()
    plain = mixed().to_numpy()
    assert np.array_equal(gid.extract_features(plain), gid.extract_features(WRENCH[:, [5, 0, 3, 1, 4, 2]]))
    numbered = pd.DataFrame(WRENCH)
    assert np.array_equal(gid.extract_features(numbered), gid.extract_features(WRENCH))


def test_names_that_are_no_text_are_refused():
    levels = pd.MultiIndex.from_product([["force", "torque"], list("xyz")])
    with pytest.raises(TypeError, match="wrench has a column with the name"):
        gid.extract_features(pd.DataFrame(WRENCH, columns=levels))


RAGGED = [WRENCH, WRENCH[:30], WRENCH]


@pytest.mark.parametrize(
    "given",
    [RAGGED, [one.tolist() for one in RAGGED], np.array(RAGGED, dtype=object)],
    ids=["arrays", "lists", "objects"],
)
@pytest.mark.parametrize("takes", [gid.MultiBand().fit, gid.Tare().fit, gid.extract_features])
def test_recordings_of_several_lengths_are_refused_with_a_way(takes, given):
    with pytest.raises(
        ValueError, match=r"one shape, got \(30.*\) and \(40.*align\(.* and Dataset\.windows\("
    ):
        takes(given)
