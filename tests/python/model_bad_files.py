"""Files that are no models, each with a piece of the message that refuses it; and what their work may cost.

One of each kind: the fuzzer of ``tests/fuzz`` makes the others.
"""

from __future__ import annotations

import json
import pickle

import numpy as np

from model_cases import DIGEST, N_AXES, entries, framed, put_together, sealed, small_model, taken_apart

GOOD = small_model().to_bytes()
METADATA, TENSORS = taken_apart(GOOD)
SPEC = json.loads(METADATA["feature_spec"])
COEF, MATRIX = TENSORS["coef"], TENSORS["coding_matrix"]


def changed(found, changes):
    """Return entries with some replaced, or left out where None."""
    return {key: value for key, value in {**found, **changes}.items() if value is not None}


def with_metadata(**changes):
    """Return the good file with entries of its metadata replaced."""
    return put_together(changed(METADATA, changes), TENSORS)


def with_tensors(**changes):
    return put_together(METADATA, changed(TENSORS, changes))


def with_spec(**changes):
    """Return the good file with another feature specification."""
    return with_metadata(feature_spec=json.dumps(changed(SPEC, changes)))


def with_header(**changes):
    """Return the good file with entries of its header replaced, the bytes behind it as they are."""
    found, data = entries(TENSORS)
    return sealed(changed({"__metadata__": METADATA, **found}, changes), data)


def with_value(name, index, value):
    values = TENSORS[name].copy()
    values[index] = value
    return with_tensors(**{name: values})


def entry(*names, **changes):
    """Return the good file with another entry of some tensors in its header."""
    found, _ = entries(TENSORS)
    return with_header(**{name: changed(found[name], changes) for name in names})


def twice(text, more):
    """Return the good file with a piece of its header written out once more."""
    found, data = entries(TENSORS)
    return framed(json.dumps({"__metadata__": METADATA, **found}).replace(text, more, 1).encode(), data)


def without_raw(n_samples):
    """Return a small file of a model without raw features, whose size says nothing about n_samples."""
    metadata = {**METADATA, "feature_spec": json.dumps({**SPEC, "raw": False}), "n_samples": str(n_samples)}
    tensors = {name: values for name, values in TENSORS.items() if not name.startswith(("raw", "early"))}
    return put_together(metadata, {**tensors, "coef": TENSORS["coef"][:, -8:].copy()})


def large(n_learners, last):
    """Return a file of almost 16 MiB whose last weight is given."""
    n_samples = (15 << 20) // (8 * n_learners * N_AXES)
    coef = np.zeros((n_learners, n_samples * N_AXES))
    coef[-1, -1] = last
    matrix = np.ones((2, n_learners))
    matrix[1] = -1.0
    spec = json.dumps({**SPEC, "hfmh": False})
    metadata = {**METADATA, "feature_spec": spec, "n_samples": str(n_samples), "classes": '["a", "b"]'}
    return put_together(metadata, {"coef": coef, "intercept": np.zeros(n_learners), "coding_matrix": matrix})


def filled(start, middle, end, n_bytes=(1 << 20) - 4096):
    """Return text of about a mebibyte."""
    return start + middle * ((n_bytes - len(start) - len(end)) // len(middle)) + end


class Trap:
    def __reduce__(self):
        return print, ("a pickle was loaded",)


BAD: dict[str, tuple[bytes, str]] = {
    # no safetensors file
    "empty": (b"", "the file is empty"),
    "pickle": (pickle.dumps(Trap()), "a pickle, which may run code"),
    "hdf5": (b"\x89HDF\r\n\x1a\n" + bytes(100), "an HDF5 file"),
    "csv": (b"time,fx,fy,fz\n0,1,2,3\n", "no safetensors file"),
    "one byte more": (GOOD + b"\0", "do not fill the file"),
    "header length 2^64 - 1": (framed(GOOD[8:], length=(1 << 64) - 1), "cut off"),
    "header over 1 MiB": (framed(b"{" + b" " * (1 << 20) + b"}"), "at most 1048576 are allowed"),
    "no UTF-8": (framed(b'{"a\xff": 1}'), "header is no UTF-8 text"),
    "NaN in JSON": (framed(b'{"a": NaN}'), "header: is no such JSON"),
    "deep JSON": (framed(b'{"a": ' + b"[" * 100_000), "header: is no such JSON"),
    # of something else, or damaged
    "no metadata": (with_header(__metadata__=None), "a safetensors file without metadata"),
    "somebody else's": (with_metadata(format="pt"), "a safetensors file of something else"),
    "future version": (with_metadata(format_version="2"), "update granular_id"),
    "another weight": (GOOD[:-1] + bytes([GOOD[-1] ^ 1]), f"the hash that {DIGEST} names"),
    # entries
    "missing entry": (with_metadata(classes=None), "must have an entry 'classes'"),
    "odd entry": (with_metadata(**{"\x1b[2J": ""}), r"metadata has an unknown entry '\u{1b}[2J'"),
    "entry of a number": (
        with_metadata(n_samples=5),
        "metadata: is no such JSON: invalid type: integer `5`, expected a string",
    ),
    "entry twice": (twice('"loss": "hinge"', '"loss": "hinge", "loss": "root"'), "'loss' is there twice"),
    "labels alike": (
        with_metadata(classes='["rice", "salt", "rice"]'),
        "classes[0] and classes[2] are both 'rice'",
    ),
    "label with escapes": (
        with_metadata(classes=r'["rice", "\u0007", "salt"]'),
        r"printable text, got '\u{7}'",
    ),
    "a million classes": (with_metadata(classes=filled("[", '"",', '""]', 500_000)), "from 2 to 1024"),
    "n_samples with a sign": (with_metadata(n_samples="+5"), "n_samples must be a whole number"),
    "n_samples 2^40": (without_raw(1 << 40), "n_samples must be from 1 to 1048576"),
    "lead_s nan": (with_metadata(lead_s="nan"), "lead_s must be seconds, at least 0, or empty"),
    "training hash": (with_metadata(training_sha256="AB" * 32), "must be 64 hexadecimal digits"),
    "trained deep": (with_metadata(trained='{"a": ' + "[" * 100_000), "recursion limit"),
    "spec with a text": (with_spec(rate_hz="500"), "feature_spec: is no such JSON: invalid type: string"),
    "spec of 10^9 bins": (with_spec(n_bins=10**9), "n_bins of all axes together must be from 1 to"),
    "spec of other bins": (with_spec(n_bins=5), "coef must have shape (3, 20)"),
    # tensors
    "all at the same place": (entry(*TENSORS, data_offsets=[0, 24]), "do not fill the file"),
    "reversed offsets": (entry("coef", data_offsets=[100, 50]), "do not fill the file"),
    "shape over 2^64": (entry("coef", shape=[1 << 33, 1 << 33]), "do not fill the file"),
    "float32": (with_tensors(coef=COEF.astype("f4")), "tensor 'coef' must be float64 (F64), got 'F32'"),
    "without coef": (with_tensors(coef=None), "tensor 'coef' is missing"),
    "unknown tensor": (with_tensors(**{"../x\n": np.zeros(3)}), r"tensor '../x\n' is unknown"),
    "coef of rank 3": (with_tensors(coef=COEF[None]), "coef must have shape"),
    "NaN": (with_value("coef", (1, 3), np.nan), "coef[1, 3] must be finite, got NaN"),
    "code 1/2": (with_value("coding_matrix", (2, 2), 0.5), "coding_matrix[2, 2] must be -1, 0 or 1, got 0.5"),
    "one side": (with_tensors(coding_matrix=np.abs(MATRIX)), "column 0 must hold both 1 and -1"),
    "early after the end": (with_value("early", (1, 0), 6.0), "early[1] must be"),
}
"""Name to the bytes and a piece of the message."""

NOTHING = {"dtype": "F64", "shape": [0], "data_offsets": [0, 0]}
MANY_DIMENSIONS = {"dtype": "F64", "shape": [1] * 300_000, "data_offsets": [0, 8]}

COSTLY: dict[str, bytes] = {
    "15 MiB, NaN at the end": large(60, np.nan),
    "a header of lists": framed(filled('{"a":[', "[],", "[]]}").encode()),
    "a header of digits": framed(filled('{"a":', "9", "}").encode()),
    "tensors without end": framed({"__metadata__": METADATA, **{f"{i}": NOTHING for i in range(14_000)}}),
    "a tensor of 300000 dimensions": sealed({"__metadata__": METADATA, "coef": MANY_DIMENSIONS}, bytes(8)),
    "entries without end": with_metadata(**{f"{i}": "" for i in range(70_000)}),
    "a spec of ranges": with_spec(bin_range=[[-1, 1]] * 100_000),
}
"""As large as the limits allow, and no models."""

LARGE_TEXTS: dict[str, bytes] = {
    "trained of zeros": with_metadata(trained=filled('{"a":[', "0,", "0]}", 1_000_000)),
    "escapes": with_metadata(trained=filled('{"a":"', "\\u0001", '"}', 800_000)),
}
"""As large as the limits allow, and models after all."""
