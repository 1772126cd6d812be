"""Models brought to another set-up: a new model with other weights, which says in a line how it came to be."""

from __future__ import annotations

import base64
import json
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from datetime import datetime, timezone
from typing import Any

import numpy as np
import numpy.typing as npt

from granular_id import _core
from granular_id._checks import checked_flag
from granular_id._memory import empty
from granular_id._parallel import single_threaded_blas
from granular_id._text import counted, percent, verb
from granular_id.features import FeatureSpec
from granular_id.identifier.metadata import (
    ADAPTED,
    MARKS,
    MAX_FILE_BYTES,
    SOURCE,
    Begin,
    Metadata,
    check_recordings,
    cropped_to_model,
    fingerprint,
    marks_of,
    stored_marks,
)
from granular_id.identifier.rules import KEY as CONFIDENCE
from granular_id.recording import Dataset, setups_in, values_in
from granular_id.spaces import (
    LEAST_ROWS,
    Learners,
    SourceStatistics,
    adapted_by_labels,
    adapted_to_all,
)

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

_MOST_SOURCE = 2**19
"""Bytes of text; a model of more materials or features keeps none, and asks for its recordings again."""

_FOR_MORE = 2**17
"""Bytes that are left for what adapting adds in the largest file."""

_DONE_TO_SAMPLES = ("tare", "payload", "compensated")

_LEAST_KNOWN = 0.9  # linear learners name nearly all of what trained them
_CHANCE = 1.5  # recordings
_AT_ONCE = 1024
_MOST_FOLDS = 5


def features_of(core: _core.Model, X: FloatArray, threads: int | None = None) -> FloatArray:
    """Extract what the weights of a model are for, (n, D), from recordings (n, T, C)."""
    spec = core.spec
    features = empty((len(X), core.n_features), "features of the recordings")
    for start in range(0, len(X), _AT_ONCE):
        rows = slice(start, start + _AT_ONCE)
        if isinstance(spec, FeatureSpec):
            features[rows] = _core.extract_features(X[rows], spec, threads, None, np.float64)
        else:
            features[rows] = spec.extract(X[rows], threads)
    return features


def with_source(
    core: _core.Model, rows: Callable[[], FloatArray], y: npt.NDArray[np.str_], max_file_bytes: int
) -> _core.Model:
    """Return the model with what adapting it needs of its training rows; as it is where that is too large."""
    if not _has_room(core, max_file_bytes):
        return core
    with single_threaded_blas():
        stored = _stored_source(_statistics(core, rows(), y))
    trained = {**Metadata(core).trained, SOURCE: stored}
    return _changed(core, trained)


def _has_room(core: _core.Model, max_file_bytes: int = MAX_FILE_BYTES) -> bool:
    text = 4 * 8 * (2 * core.n_features + core.coding_matrix.size) // 3
    return text <= _MOST_SOURCE and len(core.to_bytes()) + text + _FOR_MORE <= max_file_bytes


def adapted_model(
    core: _core.Model,
    recordings: Dataset,
    labels: npt.ArrayLike | None,
    *,
    all_materials: bool,
    allow_missing: bool,
    trained_on: Dataset | None,
    begin_at: Begin,
    lead_s: float | None,
    accept: str | Sequence[str],
    threads: int | None,
) -> _core.Model:
    """Bring a model to the set-up of recordings; `Identifier.adapt` describes it."""
    _check_way(labels, all_materials, allow_missing)
    if not isinstance(recordings, Dataset):
        raise TypeError(f"recordings must be a granular_id.Dataset, got {type(recordings).__name__}")
    differences = check_recordings(recordings, core, accept)
    data = cropped_to_model(recordings, core, begin_at=begin_at, lead_s=lead_s, over_all=False)
    truth = _known_codes(data, core.classes)
    missing: list[str] = []
    if labels is not None:
        truth = _codes_of(np.asarray(labels), core.classes, len(data), "labels")
        missing = _refuse_too_little(truth, core.classes, allow_missing)
    source, learners, blocks = _source(core, trained_on, threads), _learners(core), _blocks(core)
    rows = features_of(core, data.X, threads)

    def corrected(members: npt.NDArray[np.bool_]) -> Learners:
        return adapted_by_labels(learners, source, rows[members], truth[members], blocks)

    with single_threaded_blas():
        if labels is None:
            made, known = adapted_to_all(learners, source, rows, blocks)
            after: IntArray | None = made.answers(rows)
        else:
            made, known = corrected(np.ones(len(rows), dtype=np.bool_)), source
            after = _answers_held_out(corrected, rows, truth)
        before = learners.answers(rows)
    judged = truth >= 0
    accuracies = None
    if after is not None and judged.any():
        accuracies = _balanced(before[judged], truth[judged]), _balanced(after[judged], truth[judged])
    doubts = _doubts_of_labels(core, data, truth) if labels is not None else _doubts_of_all(core, data)
    if accuracies is not None and (accuracies[0] - accuracies[1]) * judged.sum() > _CHANCE:
        doubts.append(
            f"balanced accuracy on the recordings with a label fell from {percent(accuracies[0])} to "
            f"{percent(accuracies[1])}: keep the model as it was, or record more, of more materials"
        )
    for doubt in doubts:
        warnings.warn(doubt, stacklevel=3)  # of `Identifier.adapt`
    line = _line(len(data), labels is not None, missing, differences, accuracies)
    return _new_model(core, made, known, data, line, labelled=labels is not None)


def _check_way(labels: object, all_materials: bool, allow_missing: bool) -> None:
    """Refuse neither and both of the two ways to adapt; missing materials may be allowed where labels are given."""
    if (labels is not None) == checked_flag("all_materials", all_materials):
        raise ValueError(
            f"adapting needs one of two ways, got {'both' if all_materials else 'neither'}: give the labels of a few "
            "recordings of each material, or pass all_materials=True, which declares that the recordings hold all "
            "materials about equally"
        )
    if checked_flag("allow_missing", allow_missing) and all_materials:
        raise ValueError(
            "leave out allow_missing=True: all_materials=True declares that no material is missing"
        )


def _codes_of(labels: npt.NDArray[Any], classes: Sequence[str], n: int, name: str) -> IntArray:
    """Return the place of each of n labels among the classes; refuse others."""
    if labels.shape != (n,):
        raise ValueError(f"{name} must hold a label for each of {n} recordings, got shape {labels.shape}")
    codes = {label: code for code, label in enumerate(classes)}
    unknown = next((label for label in labels.tolist() if label not in codes), None)
    if unknown is not None:
        raise ValueError(f"{name} must hold labels of the training, got {unknown!r}")
    return np.array([codes[label] for label in labels.tolist()], dtype=np.intp)


def _missing(codes: IntArray, classes: Sequence[str]) -> list[str]:
    """Return the classes that no recording has."""
    return [label for code, label in enumerate(classes) if code not in set(codes.tolist())]


def _refuse_too_little(codes: IntArray, classes: Sequence[str], allow_missing: bool) -> list[str]:
    """Return the classes without a labelled recording, if they are allowed; refuse too few recordings."""
    if len(codes) < LEAST_ROWS:
        raise ValueError(
            f"adapting by labels needs at least {LEAST_ROWS} recordings, got {len(codes)}: the offset of one cannot be "
            "told from its material; record more, of more materials"
        )
    missing = _missing(codes, classes)
    if missing and not allow_missing:
        raise ValueError(
            f"adapting by labels needs recordings of every material, {', '.join(missing)} "
            f"{verb(len(missing), 'is', 'are')} missing: what the others show does not carry over; record them, "
            "or pass allow_missing=True"
        )
    return missing


def _known_codes(data: Dataset, classes: Sequence[str]) -> IntArray:
    """Return the place of each recording's label among the classes; -1 where it has none of them."""
    places: dict[str | None, int] = {label: code for code, label in enumerate(classes)}
    return np.array([places.get(one.label, -1) for one in data], dtype=np.intp)


def _answers_held_out(
    corrected: Callable[[npt.NDArray[np.bool_]], Learners], rows: FloatArray, codes: IntArray
) -> IntArray | None:
    """Answers of models that were made without the rows they name; None where a class has one row."""
    counts = np.bincount(codes)
    n_folds = min(_MOST_FOLDS, int(counts[counts > 0].min()))
    if n_folds < 2:
        return None
    fold = np.empty(len(codes), dtype=np.intp)
    for k in np.flatnonzero(counts):
        fold[codes == k] = np.arange(counts[k]) % n_folds
    named = np.empty_like(codes)
    for number in range(n_folds):
        held = fold == number
        named[held] = corrected(~held).answers(rows[held])
    return named


def _doubts_of_all(core: _core.Model, data: Dataset) -> list[str]:
    """Say where labels speak against the statement that all materials are there."""
    labels = {one.label for one in data}
    missing = [label for label in core.classes if label not in labels]
    if None in labels or not missing:  # one without a label may be of any material
        return []
    return [
        f"all_materials=True states that all materials are there, and by the labels {', '.join(missing)} "
        f"{verb(len(missing), 'is', 'are')} missing: record them, or give labels"
    ]


def _doubts_of_labels(core: _core.Model, data: Dataset, codes: IntArray) -> list[str]:
    """Say where labelled recordings are of one material, or have trained the model before."""
    doubts = []
    if len(set(codes.tolist())) == 1:
        doubts.append(
            f"all recordings are of one material, {core.classes[codes[0]]}: the set-up cannot be told from it, and the "
            "new model may name other materials less well; record several"
        )
    known = Metadata(core).marks
    if known and (again := sum(mark in known for mark in marks_of(data))):
        doubts.append(
            f"{again} of {counted(len(data))} {verb(again, 'has', 'have')} trained or adapted the model before, and "
            "count twice now: record others"
        )
    return doubts


def _line(
    n_recordings: int,
    labelled: bool,
    missing: Sequence[str],
    differences: Sequence[str],
    accuracies: tuple[float, float] | None,
) -> str:
    """Say in a line how a model was adapted, which its file keeps."""
    by = counted(n_recordings, "labelled recording" if labelled else "recording")
    declared = "" if labelled else " declared to hold all materials"
    parts = [f"by {by}{declared}, {datetime.now(timezone.utc):%Y-%m-%d %H:%M} UTC"]
    if accuracies is not None:
        on = "each named by a model made without it" if labelled else "on what adapted the model"
        before, after = map(percent, accuracies)
        parts.append(f"balanced accuracy {before} before, {after} after, {on}")
    if missing:
        parts.append(f"materials that were missing, and gain nothing: {', '.join(missing)}")
    if differences:
        parts.append(f"set-up: {', '.join(differences)}")
    return "; ".join(parts)


def _learners(core: _core.Model) -> Learners:
    return Learners(core.coef, core.intercept, core.coding_matrix, core.losses)


def _blocks(core: _core.Model) -> dict[str, int] | None:
    """Of samples and counts too few rows tell too little: there regression costs what recentring gains."""
    return None if isinstance(core.spec, FeatureSpec) else core.spec.block_sizes


# What a model keeps of its training.


def _statistics(core: _core.Model, rows: FloatArray, y: npt.NDArray[np.str_]) -> SourceStatistics:
    codes = _codes_of(y, core.classes, len(rows), "trained_on")
    missing = _missing(codes, core.classes)
    if missing:
        raise ValueError(
            f"trained_on must hold every material that the model knows, {missing[0]!r} is missing"
        )
    return SourceStatistics.of(rows, codes, _learners(core))


def _source(core: _core.Model, trained_on: Dataset | None, threads: int | None) -> SourceStatistics:
    """Read what the model keeps of its training, or compute it from the recordings."""
    known = Metadata(core)
    stored = known.trained.get(SOURCE)
    if trained_on is not None:
        _check_trained_on(core, trained_on)
    if stored is not None:
        return _read_source(stored, core)
    if known.trained.get(ADAPTED):
        raise ValueError(
            "the model keeps nothing of its training, and was adapted before: adapt the model that it was made from"
        )
    if trained_on is None:
        raise ValueError(
            "the model keeps nothing of its training that it could be adapted with: it was taken over from a pipeline "
            "or has too many materials; pass the recordings of its training, trained_on=data"
        )
    if Metadata(core).trained.get("background"):  # never named, and no part of the weights
        trained_on = trained_on.select(labels=list(core.classes))
    rows, y = features_of(core, trained_on.X, threads), trained_on.y
    with single_threaded_blas():
        source, named = _statistics(core, rows, y), _learners(core).answers(rows)
    accuracy = _balanced(named, _codes_of(y, core.classes, len(rows), "trained_on"))
    if accuracy < _LEAST_KNOWN:
        warnings.warn(
            f"the model names only {percent(accuracy)} of trained_on rightly: if these are not the recordings of its "
            "training, what follows is wrong",
            stacklevel=4,
        )
    return source


def _check_trained_on(core: _core.Model, trained_on: Dataset) -> None:
    """Refuse what is not the recordings of the training; a model that was taken over does not know them."""
    if not isinstance(trained_on, Dataset):
        raise TypeError(f"trained_on must be a granular_id.Dataset, got {type(trained_on).__name__}")
    trained, digest = Metadata(core).trained, core.metadata["training_sha256"]
    settings = trained.get("settings")
    if not trained.get(ADAPTED):  # which names the set-up of the new recordings
        check_recordings(trained_on, core)
    if settings is not None and digest and fingerprint(trained_on, settings) != digest:
        raise ValueError(
            "trained_on must be the recordings that the model was trained on, in their order and as they were "
            "prepared then; these are others"
        )


def _stored_source(source: SourceStatistics) -> dict[str, str | None]:
    parts = {"mean": source.mean, "sd": source.sd, "scores": source.scores}
    return {
        name: None if v is None else base64.b64encode(v.astype("<f8").tobytes()).decode("ascii")
        for name, v in parts.items()
    }


def _read_source(stored: Mapping[str, str | None], core: _core.Model) -> SourceStatistics:
    n_features, shape = core.n_features, core.coding_matrix.shape
    mean = None if stored["mean"] is None else _numbers(stored["mean"], "mean", n_features)
    sd = _numbers(stored["sd"], "sd", n_features)
    if (sd < 0).any():
        raise ValueError(f"the model file: {SOURCE}.sd must not be negative")
    scores = _numbers(stored["scores"], "scores", shape[0] * shape[1])
    return SourceStatistics(mean, sd, scores.reshape(shape))


def _numbers(text: str | None, name: str, size: int) -> FloatArray:
    try:
        numbers = np.frombuffer(base64.b64decode(text or "", validate=True), dtype="<f8").astype(np.float64)
    except ValueError:
        numbers = np.empty(0)
    if numbers.size != size or not np.isfinite(numbers).all():
        raise ValueError(f"the model file: {SOURCE}.{name} must be {size} finite numbers in base64")
    return numbers


# The new model.


def _balanced(named: IntArray, truth: IntArray) -> float:
    return float(np.mean([(named[truth == k] == k).mean() for k in np.unique(truth)]))


def _new_model(
    core: _core.Model, made: Learners, source: SourceStatistics, data: Dataset, line: str, *, labelled: bool
) -> _core.Model:
    """Put weights and how they were made into a new model, and leave out what was measured on the old one."""
    trained = dict(Metadata(core).trained)
    trained.pop(CONFIDENCE, None)
    trained.pop("temperature", None)
    setup = trained.get("setup") or {}
    # What was done to samples is that of the new recordings; what a frame or a sensor is called may only be unsaid.
    kept_setup = {name: values for name, values in setup.items() if name not in _DONE_TO_SAMPLES}
    why = "the model was adapted to another set-up, of which no recordings were held out"
    trained |= {
        "estimate": None,
        "why_no_estimate": why,
        "synthetic": bool(trained.get("synthetic", False)) or data.is_synthetic,
        "setup": {**kept_setup, **values_in(setups_in(data))},
        ADAPTED: line,
    }
    if SOURCE in trained or _has_room(core):
        # Another time the columns are no longer those of the training.
        trained[SOURCE] = _stored_source(replace(source, mean=None))
    if trained.get("early") is not None:
        target = trained["early"]["target_error"]
        trained["early"] = {
            "target_error": target,
            "why_not": "the model was adapted since its margins were measured",
        }
    if labelled and trained.get(MARKS):  # they have trained it, too
        trained[MARKS] += stored_marks(data).get(MARKS, "")
    parts: dict[str, Any] = {"early": None, "novelty": None}
    if core.raw_mean is not None:
        parts["raw_mean"] = data.X.mean(axis=0).T.ravel()
    return _changed(core, trained, made, **parts)


def _changed(
    core: _core.Model, trained: Mapping[str, Any], learners: Learners | None = None, **parts: Any
) -> _core.Model:
    """Return a model with other metadata, and other weights where they are given."""
    (spec, coef, intercept, coding, classes), options = core.__getnewargs_ex__()
    text = json.dumps(trained, ensure_ascii=False, sort_keys=True, allow_nan=False)
    metadata = {**core.metadata, "trained": text}
    if learners is not None:
        coef, intercept = learners.coef, learners.intercept
    options = {**options, **parts, "metadata": metadata}
    return _core.Model(spec, coef, intercept, coding, classes, **options)
