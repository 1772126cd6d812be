"""Model files: what is written comes back, other libraries read it, and files that are no models are refused.

``GRANULAR_ID_CASES=1000000 pytest tests/python/core/test_model_file.py -k campaign -s`` damages that many files;
``tests/fuzz`` does the same to the reader alone. ``pytest ... -k costs -s`` prints what refusing costs at most.
"""

import json
import os
import random
import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from effort import cases
from granular_id._core import MAX_MODEL_FILE_BYTES, FeatureSpec, Model, ModelFileError
from granular_id.identifier import Identifier, describe_model
from model_bad_files import BAD, COSTLY, GOOD, METADATA, TENSORS, without_raw
from model_cases import (
    DTYPES,
    banded_model,
    framed,
    put_together,
    random_model,
    small_model,
    taken_apart,
    without_digest,
)
from model_twin import bits

HERE = Path(__file__).parent
MOST_MEGABYTES = 64

MODELS = {
    "everything": small_model(),
    "plain": random_model(1, 2, 3, 1, FeatureSpec(hfmh=False)),
    "histograms": random_model(2, 4, 9, 6, FeatureSpec(raw=False, density=True, initial="steady")),
    "odd numbers": random_model(
        3, 3, 4, 2, FeatureSpec(rate_hz=1 / 3, cutoff_hz=0.1, bin_range=(-0.1 - 0.2, 1e-7), outside="clip")
    ),
    "root of the scores": random_model(6, 4, 20, 6, loss="root"),
    "many learners": random_model(4, 12, 20, 6, loss="exponential", decoding="loss_based"),
    "labels": Model(
        FeatureSpec(hfmh=False),
        [[1.0]],
        [0.0],
        [[1], [-1]],
        ['sand "fine"', "Grieß \u2014 50 %"],
        n_samples=1,
        n_axes=1,
    ),
}


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_what_is_written_comes_back(model, tmp_path):
    data = model.to_bytes()
    again = Model.from_bytes(data)
    assert again == model
    assert again.to_bytes() == data
    assert again.spec == model.spec
    for name in ("coef", "intercept", "raw_mean", "early", "sigmoid"):
        if getattr(model, name) is not None:
            np.testing.assert_array_equal(bits(getattr(again, name)), bits(getattr(model, name)))
    path = tmp_path / "model.safetensors"
    path.write_bytes(data)
    assert Model.read(path) == Model.read(str(path)) == model


def test_bits_of_weights_come_back():
    values = np.array([[-0.0, 5e-324, 1.7976931348623157e308, 1 / 3]])
    model = Model(FeatureSpec(hfmh=False), values, [-0.0], [[1], [-1]], ["a", "b"], n_samples=4, n_axes=1)
    again = Model.from_bytes(model.to_bytes())
    np.testing.assert_array_equal(bits(again.coef), bits(values))
    np.testing.assert_array_equal(bits(again.intercept), bits([-0.0]))


def test_any_order_and_spacing_is_read():
    names = sorted(TENSORS, reverse=True)
    metadata = {key: METADATA[key] for key in sorted(METADATA, reverse=True)}
    data = put_together(metadata, {name: TENSORS[name] for name in names})
    assert Model.from_bytes(data) == small_model()
    length = int.from_bytes(data[:8], "little")
    spaced = json.dumps(json.loads(data[8 : 8 + length]), indent=3, ensure_ascii=False).encode()
    assert Model.from_bytes(framed(spaced, data[8 + length :])).to_bytes() == GOOD


def test_the_safetensors_library_reads_and_writes_models(tmp_path):
    library = pytest.importorskip("safetensors.numpy")
    safetensors = pytest.importorskip("safetensors")
    path = tmp_path / "ours.safetensors"
    path.write_bytes(GOOD)
    with safetensors.safe_open(path, framework="numpy") as file:
        metadata = file.metadata()
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118  # no mapping
    assert metadata == METADATA
    assert sorted(tensors) == sorted(TENSORS)
    for name, values in tensors.items():
        np.testing.assert_array_equal(bits(values), bits(TENSORS[name]))
    theirs = library.save(tensors, metadata=metadata)
    assert Model.from_bytes(theirs) == small_model()
    assert Model.from_bytes(theirs).to_bytes() == GOOD


@pytest.mark.parametrize("data", [data for data, _ in BAD.values()], ids=list(BAD))
def test_the_safetensors_library_reads_no_less_strictly(data):
    """What its reader refuses, ours does; it has no opinion on what makes a model."""
    library = pytest.importorskip("safetensors.numpy")
    error = pytest.importorskip("safetensors").SafetensorError
    try:
        library.load(data)
    except (error, KeyError, ValueError):  # a type that numpy has not is a KeyError
        with pytest.raises(ModelFileError):
            Model.from_bytes(data)


@pytest.mark.parametrize("name", BAD)
def test_no_model_is_refused_in_one_sentence(name):
    data, message = BAD[name]
    with pytest.raises(ModelFileError) as caught:
        Model.from_bytes(data)
    text = str(caught.value)
    assert message in text
    assert len(text) < 500
    assert text.isprintable()


def test_file_over_the_limit(tmp_path):
    path = tmp_path / "model.safetensors"
    path.write_bytes(GOOD)
    limit = len(GOOD) - 1
    message = f"the file has {len(GOOD)} bytes; at most {limit} are read"
    with pytest.raises(ModelFileError, match=message):
        Model.from_bytes(GOOD, max_file_bytes=limit)
    with pytest.raises(ModelFileError, match=message) as caught:
        Model.read(path, max_file_bytes=limit)
    assert str(caught.value).startswith(f"{path}: ")
    assert Model.read(path, max_file_bytes=len(GOOD)) == small_model()
    with path.open("r+b") as file:
        file.truncate(MAX_MODEL_FILE_BYTES + 1)
    with pytest.raises(ModelFileError, match="max_file_bytes raises the limit"):
        Model.read(path)


@pytest.mark.parametrize(("limit", "error"), [(0, ValueError), (-1, ValueError), (1.5, TypeError)])
def test_limits_that_are_none(limit, error):
    for read, argument in ((Model.from_bytes, GOOD), (Model.read, "model.safetensors")):
        with pytest.raises(error, match="max_file_bytes must be an integer"):
            read(argument, max_file_bytes=limit)


def test_files_that_cannot_be_read_are_errors_of_the_system(tmp_path):
    with pytest.raises(FileNotFoundError) as caught:
        Model.read(tmp_path / "none")
    assert caught.value.filename == str(tmp_path / "none")
    with pytest.raises(IsADirectoryError):
        Model.read(tmp_path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with a name on this system")
def test_a_pipe_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(ModelFileError, match="this is no regular file"):
        Model.read(tmp_path / "pipe")


def test_the_largest_window_is_read():
    assert Model.from_bytes(without_raw(1 << 20)).n_samples == 1 << 20


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
@pytest.mark.thread_unsafe(reason="starts a process")
def test_refusing_costs_little(tmp_path):
    files = {**BAD, **COSTLY}
    for i, (data, _) in enumerate(files.values()):
        (tmp_path / f"{i:03d}").write_bytes(data)
    command = [sys.executable, str(HERE / "model_file_work.py"), str(tmp_path)]
    run = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
    answers = [json.loads(line) for line in run.stdout.splitlines()]
    assert len(answers) == len(files)
    for (name, (_, message)), answer in zip(files.items(), answers, strict=True):
        assert (answer["error"] is None) == (message is None), name
        assert message is None or message in answer["error"], name
        assert answer["megabytes"] < MOST_MEGABYTES, name
    slowest = max(answers, key=lambda answer: answer["ms"])
    largest = max(answers, key=lambda answer: answer["megabytes"])
    label = list(files)
    print(
        f"{len(files)} files: at most {slowest['ms']:.1f} ms ({label[int(slowest['name'])]}), "
        f"{largest['megabytes']:.1f} MB ({label[int(largest['name'])]})"
    )


def damaged(rng, good):
    data = bytearray(good)
    for _ in range(rng.randint(1, 4)):
        start = rng.randrange(len(data) + 1)
        end = min(len(data), start + rng.randint(0, 8))
        kind = rng.randrange(4)
        if kind == 0:
            data[start:end] = rng.randbytes(rng.randint(0, 8))
        elif kind == 1 and start < len(data):
            data[start] ^= 1 << rng.randrange(8)
        elif kind == 2:
            other = rng.randrange(len(data) + 1)
            data[start:end] = data[other : other + end - start]
        else:
            data[start:end] = rng.choice([b'"', b"}", b"{", b"[", b",", b"1e999", b"-1", b"null", b"\0" * 8])
    return bytes(data)


def outcome(function, *arguments):
    """Return what a function gives and None, or None and the message of its ValueError."""
    try:
        return function(*arguments), None
    except ValueError as error:
        return None, str(error)


def answer(model):
    shape = (1, model.n_samples, model.n_axes)
    wrench = np.linspace(-1.0, 1.0, model.n_samples * model.n_axes).reshape(shape)
    return model.losses(model.scores(wrench))


def test_campaign_of_damaged_files():
    """A damaged file is refused, one without a digest may be a model that answers and can be written again."""
    rng = random.Random(11)
    good = [model.to_bytes() for name, model in MODELS.items() if name != "many learners"]
    files = good + [without_digest(data) for data in good]
    came = Counter()
    n = cases(3000)
    for _ in range(n):
        file = rng.choice(files)
        model, problem = outcome(Model.from_bytes, damaged(rng, file))
        if problem is not None:
            came["refused"] += 1
            assert problem.isprintable()
            continue
        if not model.lacks_digest:
            came["read, nothing in it is another"] += 1
            assert model.to_bytes() == file
            continue
        came["read"] += 1
        assert Model.from_bytes(model.to_bytes()) == model
        losses, problem = outcome(answer, model)
        if problem is not None:
            came["read, its answer too large"] += 1
            assert "must be finite" in problem or "too large to filter" in problem
        else:
            assert not np.isnan(losses).any()
    assert came["read"] > 0
    assert came["refused"] > n // 2
    assert came["read, nothing in it is another"] < n // 20
    if "GRANULAR_ID_CASES" in os.environ:
        print(dict(came))


@pytest.mark.parametrize("model", [small_model(), banded_model()], ids=["additive", "multi-band"])
def test_a_flipped_bit_is_noticed(model):
    """1,000 of them in a file; ``tests/model.rs`` and ``tests/model_multiband.rs`` flip every one of smaller files."""
    good, rng = model.to_bytes(), random.Random(12)
    for _ in range(1000):
        data = bytearray(good)
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        with pytest.raises(ModelFileError):
            Model.from_bytes(bytes(data))


@pytest.mark.parametrize("name", ["model_1", "model_2"])
def test_a_file_of_an_earlier_version_is_read_and_says_so(name, tmp_path):
    file = HERE.parents[1] / "data" / "model" / f"{name}.safetensors"
    with pytest.warns(UserWarning, match=f"{name}.safetensors: this file has no digest") as caught:
        old = Identifier.load(file)
    assert caught[0].filename == __file__
    assert old.lacks_digest
    assert "no digest" in " ".join(describe_model(old))
    old.save(tmp_path / "new.safetensors")
    new = Identifier.load(tmp_path / "new.safetensors")
    assert new.core == old.core
    assert not new.lacks_digest
    assert "digest" not in " ".join(describe_model(new))


@pytest.mark.thread_unsafe(reason="starts a process")
def test_the_command_line_warns_in_one_line():
    file = str(HERE.parents[1] / "data" / "model" / "model_1.safetensors")
    command = [sys.executable, "-m", "granular_id", "model", "info", file]
    run = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
    (line,) = run.stderr.splitlines()
    assert line.startswith(f"warning: {file}: this file has no digest")


def test_taking_apart_and_putting_together_loses_nothing():
    metadata, tensors = taken_apart(GOOD)
    assert Model.from_bytes(put_together(metadata, tensors)).to_bytes() == GOOD
    assert set(DTYPES) >= {values.dtype.str[1:] for values in tensors.values()}
