"""Small and large models for the tests, and model files taken apart and put together again."""

from __future__ import annotations

import contextlib
import hashlib
import json
import struct

import numpy as np

from granular_id._core import FeatureSpec, Model, MultiBandExtractor
from granular_id.confidence import CandidateRule, UnknownRule
from granular_id.ecoc import onevsone

DIGEST = "content_sha256"

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
    keywords = {
        "spec": FeatureSpec(n_bins=4, order=2, bin_range=[(-1.0, 1.0), (-0.5, 0.5)]),
        "raw_mean": np.zeros(N_SAMPLES * N_AXES),
        "early": [[2, 0.5], [4, 0.0]],
        "metadata": {
            "training_sha256": "ab" * 32,
            "lead_s": "0.25",
            "axes": '["fx", "fz"]',
            "units": '["N", "N"]',
            "trained": '{"C": 1.0, "note": "Gr\u00fc\u00dfe"}',
        },
    }
    return random_model(7, 3, N_SAMPLES, N_AXES, **{**keywords, **changes})


def banded_model(blocks=("quantiles", "level"), n_samples=8, n_axes=1, **keywords):
    """Return a model of multi-band features with random weights and scales."""
    rng = np.random.default_rng(22)
    n_bands = len(MultiBandExtractor(n_samples, n_axes).scales)
    extractor = MultiBandExtractor(
        n_samples,
        n_axes,
        blocks=blocks,
        scales=0.5 + rng.random((n_bands, n_axes)),
        level_scales=0.5 + rng.random(n_axes) if "level" in blocks else None,
    )
    coef, intercept = rng.normal(size=(3, len(extractor.names))), rng.normal(size=3)
    return Model(extractor, coef, intercept, onevsone(3), ["rice", "salt", "peas"], **keywords)


def with_rules(n_features, labels=("material 0", "material 1", "material 2")):
    """Return what a model of three classes needs to name candidates and refuse unknown materials: keywords."""
    rng = np.random.default_rng(3)
    rules = {
        "candidates": CandidateRule(labels, 0.9, 0.2, 9, 3, 0.91, 0.85).to_dict(),
        "unknown": UnknownRule(labels, (0.5, 0.25), 0.5 * n_features, 0.9, 9).to_dict(),
    }
    return {
        "metadata": {"trained": json.dumps({"confidence": rules})},
        "novelty": tuple(rng.normal(size=(n_rows, n_features)) for n_rows in (2, 2, 3)),
    }


def with_trained(core, trained):
    """Return a model that says something else of its training."""
    parts, options = core.__getnewargs_ex__()
    if "unknown" not in trained.get("confidence", ()):
        options["novelty"] = None
    metadata = {**core.metadata, "trained": json.dumps(trained)}
    return Model(*parts, **{**options, "metadata": metadata})


NUMBERS = {"F64": "<f8", "F32": "<f4"}


def taken_apart(data):
    """Return metadata and tensors (name to array, in the order of the file) of a model file."""
    (length,) = struct.unpack("<Q", data[:8])
    header = json.loads(data[8 : 8 + length])
    metadata = header.pop("__metadata__")
    tensors = {}
    for name, entry in header.items():
        start, end = entry["data_offsets"]
        values = np.frombuffer(data[8 + length + start : 8 + length + end], NUMBERS[entry["dtype"]])
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


def digest(header, data):
    """SHA-256 of what a header says and of the tensors behind it, as ``docs/reference/model_file.md`` defines it."""

    def text(value):
        return struct.pack("<Q", len(value)) + value

    metadata = {key: value for key, value in header["__metadata__"].items() if key != DIGEST}
    tensors = {name: entry for name, entry in header.items() if name != "__metadata__"}
    parts = [struct.pack("<Q", len(metadata))]
    for key in sorted(metadata):
        parts += text(key.encode()), text(metadata[key].encode())
    parts.append(struct.pack("<Q", len(tensors)))
    for name in sorted(tensors):
        shape = tensors[name]["shape"]
        parts += text(name.encode()), text(tensors[name]["dtype"].encode())
        parts.append(struct.pack(f"<{1 + len(shape)}Q", len(shape), *shape))
        parts.append(text(data[slice(*tensors[name]["data_offsets"])]))
    return hashlib.sha256(b"".join(parts)).hexdigest()


def sealed(header, data):
    """Return a file with the digest of its own, where it has one and one can be made."""
    with contextlib.suppress(AttributeError, KeyError, TypeError, ValueError, struct.error):
        if DIGEST in header["__metadata__"]:
            metadata = {**header["__metadata__"], DIGEST: digest(header, data)}
            return framed({**header, "__metadata__": metadata}, data)
    return framed(header, data)


def put_together(metadata, tensors):
    found, data = entries(tensors)
    return sealed({"__metadata__": metadata, **found}, data)
