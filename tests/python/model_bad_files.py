"""Files that are no models, each with a piece of the message that refuses it; and what their work may cost."""

from __future__ import annotations

import io
import json
import pickle
import zipfile

import numpy as np

from model_cases import (
    DIGEST,
    N_AXES,
    N_SAMPLES,
    entries,
    framed,
    put_together,
    sealed,
    small_model,
    taken_apart,
)

GOOD = small_model().to_bytes()
METADATA, TENSORS = taken_apart(GOOD)
HEADER_END = 8 + int.from_bytes(GOOD[:8], "little")
SPEC = json.loads(METADATA["feature_spec"])


def changed(entries, changes):
    """Return entries with some replaced, or left out where None."""
    return {key: value for key, value in {**entries, **changes}.items() if value is not None}


def with_metadata(**changes):
    """Return the good file with entries of its metadata replaced."""
    return put_together(changed(METADATA, changes), TENSORS)


def with_tensors(**changes):
    return put_together(METADATA, changed(TENSORS, changes))


def with_spec(text=None, **changes):
    """Return the good file with another feature specification."""
    return with_metadata(feature_spec=json.dumps(changed(SPEC, changes)) if text is None else text)


def with_header(**changes):
    """Return the good file with entries of its header replaced, the bytes behind it as they are."""
    found, data = entries(TENSORS)
    return sealed(changed({"__metadata__": METADATA, **found}, changes), data)


def with_value(name, index, value):
    values = TENSORS[name].copy()
    values[index] = value
    return with_tensors(**{name: values})


def twice(what):
    """Return the good header with one of its entries written out once more."""
    found, data = entries(TENSORS)
    text = json.dumps({"__metadata__": METADATA, **found})
    if what == "tensor":
        text = text[:-1] + ', "intercept": ' + json.dumps(found["intercept"]) + "}"
    elif what == "tensor key":
        text = text.replace('"dtype"', '"dtype": "F64", "dtype"', 1)
    elif what == "metadata":
        text = text[:-1] + ', "__metadata__": ' + json.dumps(METADATA) + "}"
    else:
        text = text.replace('"loss": "hinge"', '"loss": "hinge", "loss": "root"')
    return framed(text.encode(), data)


def entry(*names, **changes):
    """Return the good file with another entry of some tensors in its header."""
    found, _ = entries(TENSORS)
    return with_header(**{name: changed(found[name], changes) for name in names})


def offsets(name, start, end):
    """Return the good file with the place of a tensor moved."""
    first, last = entries(TENSORS)[0][name]["data_offsets"]
    return entry(name, data_offsets=[first + start, last + end])


def exchanged(one, other):
    """Return the good file with two tensors in each other's place."""
    found, data = entries(TENSORS)
    return framed({"__metadata__": METADATA, **found, one: found[other], other: found[one]}, data)


def zipped():
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("data.pkl", b"")
    return buffer.getvalue()


def many_classes(n):
    """Return a file with n classes, one learner that tells the first from all others."""
    matrix = np.full((n, 3), -1.0)
    matrix[0] = 1.0
    labels = json.dumps([f"m{k}" for k in range(n)])
    return put_together({**METADATA, "classes": labels}, {**TENSORS, "coding_matrix": matrix})


def labels(*names):
    return with_metadata(classes=json.dumps(names))


def large(n_learners, last):
    """Return a file of almost 16 MiB whose last weight is given."""
    n_samples = (15 << 20) // (8 * n_learners * N_AXES)
    coef = np.zeros((n_learners, n_samples * N_AXES))
    coef[-1, -1] = last
    matrix = np.ones((2, n_learners))
    matrix[1] = -1.0
    metadata = {
        **METADATA,
        "feature_spec": json.dumps({**SPEC, "hfmh": False}),
        "n_samples": str(n_samples),
        "classes": '["a", "b"]',
    }
    tensors = {"coef": coef, "intercept": np.zeros(n_learners), "coding_matrix": matrix}
    return put_together(metadata, tensors)


def without_raw(n_samples):
    """Return a small file of a model without raw features, whose size says nothing about n_samples."""
    metadata = {**METADATA, "feature_spec": json.dumps({**SPEC, "raw": False}), "n_samples": str(n_samples)}
    tensors = {name: values for name, values in TENSORS.items() if not name.startswith(("raw", "early"))}
    return put_together(metadata, {**tensors, "coef": TENSORS["coef"][:, -8:].copy()})


def filled(start, middle, end, n_bytes=(1 << 20) - 4096):
    """Return text of about a mebibyte."""
    return start + middle * ((n_bytes - len(start) - len(end)) // len(middle)) + end


def without_learners():
    return with_tensors(coef=np.zeros((0, 18)), intercept=np.zeros(0), coding_matrix=np.zeros((3, 0)))


class Trap:
    def __reduce__(self):
        return print, ("a pickle was loaded",)


DEEP = "[" * 100_000
COEF = TENSORS["coef"]
MATRIX = TENSORS["coding_matrix"]
TWO_OF_THREE = np.array([[1.0] * 3, [-1.0] * 3, [0.0] * 3])
N_FEATURES = COEF.shape[1]
NOTHING = {"dtype": "F64", "shape": [0], "data_offsets": [0, 0]}
MANY_DIMENSIONS = {"dtype": "F64", "shape": [1] * 300_000, "data_offsets": [0, 8]}

BAD: dict[str, tuple[bytes, str]] = {
    "empty": (b"", "the file is empty"),
    "first 7 bytes": (GOOD[:7], "no safetensors file"),
    "first 8 bytes": (GOOD[:8], "no safetensors file"),
    "first 9 bytes": (GOOD[:9], "cut off"),
    "all but the end of the header": (GOOD[: HEADER_END - 1], "cut off"),
    "the header": (GOOD[:HEADER_END], "do not fill the file"),
    "all but a byte": (GOOD[:-1], "do not fill the file"),
    "one byte more": (GOOD + b"\0", "do not fill the file"),
    "header length 0": (framed(GOOD[8:], length=0), "header: is no valid JSON"),
    "header length 2^63": (framed(GOOD[8:], length=1 << 63), "cut off"),
    "header length 2^64 - 1": (framed(GOOD[8:], length=(1 << 64) - 1), "cut off"),
    "header length one less": (framed(GOOD[8:], length=HEADER_END - 8 - 1 - 8), "header: is no valid JSON"),
    "header to the end": (framed(GOOD[8:], length=len(GOOD) - 8), "header: is no"),
    "header over 1 MiB": (framed(b"{" + b" " * (1 << 20) + b"}"), "at most 1048576 are allowed"),
    "pickle": (pickle.dumps(Trap()), "a pickle, which may run code"),
    "pickle of a model": (pickle.dumps({"coef": COEF.tolist()}, protocol=2), "a pickle, which may run code"),
    "zip": (zipped(), "a zip archive"),
    "hdf5": (b"\x89HDF\r\n\x1a\n" + bytes(100), "an HDF5 file"),
    "csv": (b"time,fx,fy,fz\n0,1,2,3\n", "no safetensors file"),
    "zeros": (bytes(4096), "no safetensors file"),
    "no UTF-8": (framed(b'{"a\xff": 1}'), "header: is no UTF-8 text"),
    "lone surrogate": (framed(rb'{"\ud800": 1}'), "header: is no valid JSON"),
    "no JSON": (framed(b"{coef}"), "header: is no valid JSON"),
    "half a JSON": (framed(b'{"coef": {"dtype": "F64"'), "header: is no valid JSON"),
    "NaN in JSON": (framed(b'{"a": NaN}'), "header: is no valid JSON"),
    "number over float64": (framed(b'{"a": 1e999}'), "header: is no valid JSON"),
    "deep JSON": (framed(b'{"a": ' + DEEP.encode()), "recursion limit"),
    "deep objects": (framed(b'{"a": ' * 100_000), "recursion limit"),
    "no metadata": (with_header(__metadata__=None), "'__metadata__' is missing"),
    "metadata a list": (with_header(__metadata__=[]), "must be an object of texts, got a list"),
    "metadata a number": (with_metadata(n_samples=5), "metadata 'n_samples' must be a text, got a number"),
    "somebody else's": (with_metadata(format="pt"), "a safetensors file of something else"),
    "no format": (with_metadata(format=None), "a safetensors file of something else"),
    "future version": (with_metadata(format_version="2"), "update granular_id"),
    "version 1.0": (with_metadata(format_version="1.0"), "format_version is '1.0'"),
    "no version": (with_metadata(format_version=None), "must have an entry 'format_version'"),
    "another label": (GOOD.replace(b"material 1", b"material 3"), f"the hash that {DIGEST} names"),
    "another weight": (GOOD[:-1] + bytes([GOOD[-1] ^ 1]), f"the hash that {DIGEST} names"),
    "weights exchanged": (exchanged("coef", "coding_matrix"), f"the hash that {DIGEST} names"),
    **{
        f"no {key}": (with_metadata(**{key: None}), f"must have an entry '{key}'")
        for key in sorted(METADATA)
        if not key.startswith("format")
    },
    "unknown entry": (with_metadata(code="import os"), "metadata has an unknown entry 'code'"),
    "entry with escapes": (with_metadata(**{"\x1b[2J": ""}), r"metadata has an unknown entry '\u{1b}[2J'"),
    "metadata twice": (twice("metadata"), "'__metadata__' is there twice"),
    "entry twice": (twice("entry"), "'loss' is there twice"),
    "tensor twice": (twice("tensor"), "'intercept' is there twice"),
    "tensor key twice": (twice("tensor key"), "'dtype' is there twice"),
    "more said of a tensor": (entry("coef", extra=1), "tensor 'coef' has an unknown key 'extra'"),
    "overlap": (offsets("intercept", -8, 0), "do not fill the file"),
    "gap": (offsets("intercept", 8, 0), "do not fill the file"),
    "past the end": (offsets("raw_mean", 0, 8), "do not fill the file"),
    "reversed offsets": (entry("coef", data_offsets=[100, 50]), "do not fill the file"),
    "negative offset": (entry("coef", data_offsets=[-8, 50]), "do not fill the file"),
    "offset 2^64 - 1": (entry("coef", data_offsets=[0, (1 << 64) - 1]), "do not fill the file"),
    "one offset": (entry("coef", data_offsets=[0]), "do not fill the file"),
    "all at the same place": (entry(*TENSORS, data_offsets=[0, 24]), "do not fill the file"),
    "shape over 2^64": (entry("coef", shape=[1 << 33, 1 << 33]), "do not fill the file"),
    "shape negative": (entry("coef", shape=[-1, 3]), "do not fill the file"),
    "shape of half a number": (entry("intercept", shape=[2.5]), "do not fill the file"),
    "no shape": (entry("coef", shape=None), "do not fill the file"),
    "unknown dtype": (entry("coef", dtype="OBJECT"), "do not fill the file"),
    "float32": (with_tensors(coef=COEF.astype("f4")), "tensor 'coef' must be float64 (F64), got F32"),
    "int64": (with_tensors(coding_matrix=MATRIX.astype("i8")), "must be float64 (F64), got I64"),
    "bool": (with_tensors(early=np.ones((1, 2), bool)), "'early' must be float64 (F64), got BOOL"),
    "without coef": (with_tensors(coef=None), "tensor 'coef' is missing"),
    "without intercept": (with_tensors(intercept=None), "tensor 'intercept' is missing"),
    "without coding_matrix": (with_tensors(coding_matrix=None), "tensor 'coding_matrix' is missing"),
    "no tensors": (put_together(METADATA, {}), "tensor 'coef' is missing"),
    "unknown tensor": (with_tensors(payload=np.zeros(3)), "tensor 'payload' is unknown"),
    "unknown tensor, odd name": (with_tensors(**{"../x\n": np.zeros(3)}), r"tensor '../x\n' is unknown"),
    "zero-size coef": (with_tensors(coef=np.zeros((0, N_FEATURES))), f"shape (3, {N_FEATURES})"),
    "zero-size everything": (without_learners(), "intercept must have shape (L,)"),
    "zero-size early": (with_tensors(early=np.zeros((0, 2))), "early must have shape (M, 2)"),
    "coef of rank 1": (with_tensors(coef=COEF.ravel()), "coef must have shape"),
    "coef of rank 3": (with_tensors(coef=COEF[None]), "coef must have shape"),
    "coef transposed": (with_tensors(coef=COEF.T.copy()), "coef must have shape"),
    "coef short": (with_tensors(coef=COEF[:, 1:].copy()), f"{N_FEATURES} features for n_samples = 5"),
    "coef of fewer learners": (with_tensors(coef=COEF[1:].copy()), "as many rows as intercept"),
    "intercept of rank 2": (with_tensors(intercept=np.zeros((3, 1))), "intercept must have shape (L,)"),
    "intercept a number": (with_tensors(intercept=np.float64(1.0)), "intercept must have shape (L,)"),
    "codes of another shape": (with_tensors(coding_matrix=MATRIX[:2].copy()), "must have shape (3, 3)"),
    "NaN": (with_value("coef", (1, 3), np.nan), "coef[1, 3] must be finite, got NaN"),
    "infinity": (with_value("intercept", 2, -np.inf), "intercept[2] must be finite, got -inf"),
    "NaN in raw_mean": (with_value("raw_mean", 0, np.nan), "raw_mean[0] must be finite"),
    "infinite margin": (with_value("early", (0, 1), np.inf), "early[0, 1] must be finite"),
    "code 2": (with_value("coding_matrix", (0, 1), 2.0), "coding_matrix[0, 1] must be -1, 0 or 1, got 2"),
    "code 1/2": (with_value("coding_matrix", (2, 2), 0.5), "coding_matrix[2, 2] must be -1, 0 or 1, got 0.5"),
    "code NaN": (with_value("coding_matrix", (0, 0), np.nan), "must be -1, 0 or 1, got NaN"),
    "one side": (with_tensors(coding_matrix=np.abs(MATRIX)), "column 0 must hold both 1 and -1"),
    "a class that nobody sees": (with_tensors(coding_matrix=TWO_OF_THREE), "row 2 is all 0"),
    "one class": (many_classes(1), "classes must be from 2 to 1024, got 1"),
    "1025 classes": (many_classes(1025), "classes must be from 2 to 1024, got 1025"),
    "a million classes": (with_metadata(classes=filled("[", '"",', '""]', 500_000)), "from 2 to 1024"),
    "doubled label": (labels("rice", "salt", "rice"), "classes[0] and classes[2] are both 'rice'"),
    "empty label": (labels("rice", "", "salt"), "classes[1] must be 1 to 256 bytes of printable text"),
    "label with escapes": (labels("rice", "a\x1b[31m", "salt"), r"printable text, got 'a\u{1b}[31m'"),
    "long label": (labels("rice", "x" * 257, "salt"), "classes[1] must be 1 to 256 bytes"),
    "labels of numbers": (with_metadata(classes="[1, 2, 3]"), "classes: must be a JSON list of texts"),
    "labels an object": (with_metadata(classes='{"a": 1}'), "classes: must be a JSON list of texts"),
    "labels no JSON": (with_metadata(classes="rice, salt"), "classes: is no valid JSON"),
    "unknown loss": (with_metadata(loss="quadratic"), "loss must be 'hinge' or 'root'"),
    **{
        f"n_samples {text!r}": (with_metadata(n_samples=text), "n_samples must be a whole number")
        for text in ("", "-5", "+5", "05", "5.0", "1e3", " 5", "9" * 30)
    },
    "n_samples 0": (with_metadata(n_samples="0"), "n_samples must be from 1 to 1048576, got 0"),
    "n_samples 2^64 - 1": (with_metadata(n_samples=str((1 << 64) - 1)), "n_samples must be from 1 to"),
    "n_samples 2^40 without raw": (without_raw(1 << 40), "n_samples must be from 1 to 1048576"),
    "n_axes 0": (with_metadata(n_axes="0"), "n_axes must be from 1 to 256, got 0"),
    "n_axes 2^62": (with_metadata(n_axes=str(1 << 62)), "n_axes must be from 1 to 256"),
    "n_axes 1": (with_metadata(n_axes="1"), "bin_range must hold one range, or one per axis"),
    "spec of bands": (with_spec(blocks=["level"]), "feature_spec: has an unknown entry"),
    "spec of other bins": (with_spec(n_bins=5), "coef must have shape (3, 20)"),
    "spec without raw": (with_spec(raw=False), "coef must have shape (3, 8)"),
    "spec without anything": (with_spec(raw=False, hfmh=False), "at least one of raw and hfmh must be true"),
    "spec no JSON": (with_spec("rate_hz=500"), "feature_spec: is no valid JSON"),
    "spec a list": (with_spec("[]"), "feature_spec: must be a JSON object, got a list"),
    "spec deep": (with_spec('{"raw": ' + DEEP), "recursion limit"),
    "spec key twice": (with_spec(json.dumps(SPEC)[:-1] + ', "raw": true}'), "'raw' is there twice"),
    "spec without order": (with_spec(order=None), "feature_spec: 'order' is missing"),
    "spec with more": (with_spec(window="hann"), "feature_spec: has an unknown entry 'window'"),
    "spec with a text": (with_spec(rate_hz="500"), "feature_spec: 'rate_hz' must be a number, got a text"),
    "spec with half an order": (with_spec(order=2.5), "feature_spec: 'order' must be a whole number"),
    "spec of order -1": (with_spec(order=-1), "feature_spec: 'order' must be a whole number"),
    "spec of order 10^9": (with_spec(order=10**9), "feature_spec: order must be from 1 to"),
    "spec with 1 for true": (with_spec(raw=1), "feature_spec: 'raw' must be true or false, got a number"),
    "spec with another word": (with_spec(outside="wrap"), "feature_spec: 'outside' must be 'drop' or 'clip'"),
    "spec of rate 0": (with_spec(rate_hz=0.0), "feature_spec: rate_hz must be positive"),
    "spec of cut-off above half the rate": (with_spec(cutoff_hz=250.0), "feature_spec: cutoff_hz must be"),
    "spec of reversed bins": (with_spec(bin_range=[[1, -1], [-1, 1]]), "bin_range must be finite"),
    "spec without bins": (with_spec(n_bins=0), "all axes together must be from 1 to 1048576, got 0"),
    "spec of 10^9 bins": (with_spec(n_bins=10**9), "n_bins of all axes together must be from 1 to"),
    "spec of 30000 ranges": (with_spec(bin_range=[[-1, 1]] * 30_000), "bin_range must hold one range"),
    "spec of no ranges": (with_spec(bin_range=[]), "bin_range must hold one range, or one per axis"),
    "spec of ranges of three": (with_spec(bin_range=[[0, 1, 2]]), "'bin_range' must be a list of pairs"),
    "axes of another number": (
        with_metadata(axes='["fx"]'),
        "axes must be a list of 2, one for each axis, got 1",
    ),
    "axes alike": (with_metadata(axes='["fx", "fx"]'), "axes[0] and axes[1] are both 'fx'"),
    "units of another number": (
        with_metadata(units="[]"),
        "units must be a list of 2, one for each axis, got 0",
    ),
    "units with escapes": (with_metadata(units=r'["N", "\u0007"]'), r"printable text, got '\u{7}'"),
    "version with a line end": (with_metadata(library_version="1\n0"), "library_version must be at most 256"),
    "long version": (with_metadata(library_version="1" * 300), "library_version must be at most 256 bytes"),
    "training hash": (with_metadata(training_sha256="AB" * 32), "must be 64 hexadecimal digits"),
    **{
        f"lead_s {text}": (with_metadata(lead_s=text), "lead_s must be seconds, at least 0, or empty")
        for text in ("-1", "nan", "inf", "1e999", "0.25 s")
    },
    "trained a list": (with_metadata(trained="[]"), "trained: must be a JSON object, got a list"),
    "trained nothing": (with_metadata(trained=""), "trained: is no valid JSON"),
    "trained deep": (with_metadata(trained='{"a": ' + DEEP), "recursion limit"),
    "trained key twice": (with_metadata(trained='{"C": 1, "C": 2}'), "'C' is there twice"),
    "raw_mean short": (with_tensors(raw_mean=np.zeros(3)), "raw_mean must have shape (10,)"),
    "early of one column": (with_tensors(early=np.ones((2, 1))), "early must have shape (M, 2)"),
    "early that falls": (with_tensors(early=np.array([[3.0, 1.0], [2.0, 1.0]])), "early[1] must be"),
    "early between samples": (with_value("early", (0, 0), 1.5), "early[0] must be"),
    "early after the end": (with_value("early", (1, 0), 6.0), "early[1] must be"),
    "early of a negative margin": (with_value("early", (1, 1), -0.1), "early[1] must be"),
}
"""Name to the bytes and a piece of the message."""

COSTLY: dict[str, bytes] = {
    "15 MiB, NaN at the end": large(60, np.nan),
    "15 MiB, one learner, NaN at the end": large(1, np.nan),
    **{
        f"a header of {what}": framed(filled(*parts).encode())
        for what, parts in {
            "zeros": ('{"a":[', "0,", "0]}"),
            "lists": ('{"a":[', "[],", "[]]}"),
            "objects": ('{"a":[', "{},", "{}]}"),
            "texts": ('{"a":[', '"",', '""]}'),
            "digits": ('{"a":', "9", "}"),
            "fractions": ('{"a":0.', "3", "}"),
            "blanks": ("{", " ", "}"),
        }.items()
    },
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

assert N_SAMPLES * N_AXES + 8 == N_FEATURES
