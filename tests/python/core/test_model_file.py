"""Model files: what is written comes back, other libraries read it, and files that are no models are refused.

``GRANULAR_ID_CASES=1000000 pytest tests/python/core/test_model_file.py -k damaged`` damages that many files;
``tests/fuzz`` does the same to the reader alone.
"""

import json
import os
import sys

import numpy as np
import pytest

from core_cases import printed_by
from granular_id._core import MAX_MODEL_FILE_BYTES, FeatureSpec, Model, ModelFileError
from model_bad_files import BAD, COSTLY, GOOD, LARGE_TEXTS, METADATA, TENSORS, without_raw
from model_cases import banded_model, framed, put_together, random_model, small_model
from model_twin import bits

MOST_MEGABYTES = 64

MEASURE = """
import json, re, sys
from pathlib import Path
from granular_id._core import Model, ModelFileError

def kilobytes(field):
    return int(re.search(field + r":\\s*(\\d+)", Path("/proc/self/status").read_text()).group(1))

found = []
for path in sorted(Path(sys.argv[1]).iterdir()):
    Path("/proc/self/clear_refs").write_text("5")  # the high-water mark begins anew
    before = kilobytes("VmRSS")
    try:
        is_model = bool(Model.read(path))
    except ModelFileError:
        is_model = False
    found.append((is_model, (kilobytes("VmHWM") - before) / 1024))
print(json.dumps(found))
"""

MODELS = {
    "everything": small_model(),
    "plain": random_model(1, 2, 3, 1, FeatureSpec(hfmh=False)),
    "histograms": random_model(2, 4, 9, 6, FeatureSpec(raw=False, density=True, initial="steady")),
    "odd numbers": random_model(
        3, 3, 4, 2, FeatureSpec(rate_hz=1 / 3, cutoff_hz=0.1, bin_range=(-0.1 - 0.2, 1e-7), outside="clip")
    ),
    "bands": banded_model(),
    "root of the scores": random_model(6, 4, 20, 6, loss="root"),
    "many learners": random_model(4, 12, 20, 6),
    "odd labels and weights": Model(
        FeatureSpec(hfmh=False),
        [[-0.0, 5e-324, 1.7976931348623157e308, 1 / 3]],
        [-0.0],
        [[1], [-1]],
        ['sand "fine"', "Grieß \u2014 50 %"],
        n_samples=4,
        n_axes=1,
    ),
}


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_what_is_written_comes_back(model, tmp_path):
    data = model.to_bytes()
    again = Model.from_bytes(data)
    assert again == model
    assert again.to_bytes() == data
    for name in ("coef", "intercept", "raw_mean", "early"):
        if getattr(model, name) is not None:
            np.testing.assert_array_equal(bits(getattr(again, name)), bits(getattr(model, name)))
    path = tmp_path / "model.safetensors"
    path.write_bytes(data)
    assert Model.read(path) == Model.read(str(path)) == model


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
def test_no_file_takes_much_memory(tmp_path):
    files = {**{name: data for name, (data, _) in BAD.items()}, **COSTLY, **LARGE_TEXTS}
    for i, data in enumerate(files.values()):
        (tmp_path / f"{i:03d}").write_bytes(data)
    megabytes = json.loads(printed_by(MEASURE, str(tmp_path)))
    for (name, _), (is_model, taken) in zip(files.items(), megabytes, strict=True):
        assert is_model == (name in LARGE_TEXTS), name
        assert taken < MOST_MEGABYTES, name
