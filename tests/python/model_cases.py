"""Small and large models for the tests, and model files taken apart and put together again."""

from __future__ import annotations

import json
import struct

import numpy as np

from granular_id._core import FeatureSpec, Model
from granular_id.ecoc.codings import onevsone

N_SAMPLES, N_AXES = 5, 2
"""Size of the recordings of `small_model`."""


def random_model(seed, n_classes, n_samples, n_axes, spec=None, scale=1.0, **keywords):
    """Return a model with random weights, one-vs-one unless a coding matrix is given."""
    rng = np.random.default_rng(seed)
    spec = FeatureSpec() if spec is None else spec
    matrix = keywords.pop("coding_matrix", None)
    matrix = onevsone(n_classes) if matrix is None else matrix
    n_learners = matrix.shape[1]
    coef = scale * rng.normal(size=(n_learners, spec.n_features(n_samples, n_axes)))
    labels = [f"material {k}" for k in range(n_classes)]
    intercept = rng.normal(size=n_learners)
    return Model(spec, coef, intercept, matrix, labels, n_samples=n_samples, n_axes=n_axes, **keywords)


def small_model(**changes):
    """Return a model of three classes with everything that a model may have."""
    n_raw, n_learners = N_SAMPLES * N_AXES, 3
    keywords = {
        "spec": FeatureSpec(n_bins=4, order=2, bin_range=[(-1.0, 1.0), (-0.5, 0.5)]),
        "raw_mean": np.zeros(n_raw),
        "raw_low": np.full(n_raw, -2.0),
        "raw_high": np.full(n_raw, 2.0),
        "early": [[2, 0.5], [4, 0.0]],
        "sigmoid": np.tile([-1.0, 0.25], (n_learners, 1)),
        "posterior_weights": np.full(n_learners, 8.0),
        "metadata": {
            "posterior": "kullback_leibler",
            "coding": "onevsone",
            "training_sha256": "ab" * 32,
            "lead_s": "0.25",
            "axes": '["fx", "fz"]',
            "units": '["N", "N"]',
            "trained": '{"C": 1.0, "note": "Gr\u00fc\u00dfe"}',
        },
    }
    return random_model(7, 3, N_SAMPLES, N_AXES, **{**keywords, **changes})


def taken_apart(data):
    """Return metadata and tensors (name to array, in the order of the file) of a model file."""
    (length,) = struct.unpack("<Q", data[:8])
    header = json.loads(data[8 : 8 + length])
    metadata = header.pop("__metadata__")
    tensors = {}
    for name, entry in header.items():
        start, end = entry["data_offsets"]
        values = np.frombuffer(data[8 + length + start : 8 + length + end], "<f8")
        tensors[name] = values.reshape(entry["shape"])
    return metadata, tensors


DTYPES = {"f8": "F64", "f4": "F32", "i8": "I64", "u1": "U8", "b1": "BOOL"}


def entries(tensors):
    """Return the header's entries of tensors that lie side by side, and their bytes."""
    found, data = {}, b""
    for name, given in tensors.items():
        values = np.asarray(given)
        raw = values.tobytes()
        found[name] = {
            "dtype": DTYPES[values.dtype.str[1:]],
            "shape": list(values.shape),
            "data_offsets": [len(data), len(data) + len(raw)],
        }
        data += raw
    return found, data


def framed(header, data=b"", length=None):
    """Return a safetensors file of a header (bytes, or what becomes JSON) and the bytes behind it."""
    text = header if isinstance(header, bytes) else json.dumps(header).encode()
    return struct.pack("<Q", len(text) if length is None else length) + text + data


def put_together(metadata, tensors):
    found, data = entries(tensors)
    return framed({"__metadata__": metadata, **found}, data)
