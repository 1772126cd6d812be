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
from sklearn.model_selection import StratifiedKFold

from granular_id import _core
from granular_id._checks import checked_flag
from granular_id._core import GranularIdError
from granular_id._parallel import single_threaded_blas
from granular_id._text import counted, percent, verb
from granular_id.features import FeatureSpec
from granular_id.identifier.model import (
    ADAPTED,
    MARKS,
    MAX_FILE_BYTES,
    RULES,
    SOURCE,
    TrainedModel,
    known_marks,
    mark_of,
    stored_marks,
)
from granular_id.identifier.training import features_of
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
"""Bytes of text; a model of more materials or features keeps none, and cannot be adapted."""

_FOR_MORE = 2**18
"""Bytes that are left for what else is stated of the training, and what adapting adds, in the largest file."""

_DONE_TO_SAMPLES = ("tare", "payload", "compensated")

_CHANCE = 1.5  # recordings
_MOST_FOLDS = 5


def check_way(labels: object, *, all_materials: bool, allow_missing: bool) -> None:
    """Refuse neither and both of the two ways to adapt; missing materials may be allowed where labels are given."""
    if (labels is not None) == checked_flag("all_materials", all_materials):
        raise GranularIdError(
            f"adapting needs one of two ways, got {'both' if all_materials else 'neither'}: give the labels of a few "
            "recordings of each material, or pass all_materials=True, which declares that the recordings hold all "
            "materials about equally"
        )
    if checked_flag("allow_missing", allow_missing) and all_materials:
        raise GranularIdError(
            "leave out allow_missing=True (--allow-missing): all_materials=True declares that no material is missing"
        )


def adapted_model(
    model: TrainedModel,
    data: Dataset,
    labels: npt.ArrayLike | None,
    differences: Sequence[str],
    *,
    allow_missing: bool,
) -> _core.Model:
    """Bring a model to the set-up of recordings of its length; without labels they hold all materials.

    `differences` are those of their set-up. `Identifier.adapt` describes it.
    """
    core = model.core
    places: dict[str | None, int] = {label: code for code, label in enumerate(core.classes)}
    truth = np.array([places.get(one.label, -1) for one in data], dtype=np.intp)
    missing: list[str] = []
    if labels is not None:
        truth = _codes_of(np.asarray(labels), places, len(data))
        missing = _refuse_too_little(truth, core.classes, allow_missing)
    source, learners = _read_source(model), _learners(core)
    # Of samples and counts too few rows tell too little: there regression costs what recentring gains.
    blocks = None if isinstance(core.spec, FeatureSpec) else core.spec.block_sizes
    rows = features_of(core, data.X)

    def corrected(members: IntArray) -> Learners:
        return adapted_by_labels(learners, source, rows[members], truth[members], blocks)

    with single_threaded_blas():
        if labels is None:
            made, known = adapted_to_all(learners, source, rows, blocks)
            after: IntArray | None = made.answers(rows)
        else:
            made, known = corrected(np.arange(len(rows))), source
            after = _answers_held_out(corrected, rows, truth)
        before = learners.answers(rows)
    judged = truth >= 0
    accuracies = None
    if after is not None and judged.any():
        accuracies = _balanced(before[judged], truth[judged]), _balanced(after[judged], truth[judged])
    doubts = _doubts_of_all(core, data) if labels is None else _doubts_of_labels(model, data, truth)
    if accuracies is not None and (accuracies[0] - accuracies[1]) * judged.sum() > _CHANCE:
        doubts.append(
            f"balanced accuracy on the recordings with a label fell from {percent(accuracies[0])} to "
            f"{percent(accuracies[1])}: keep the model as it was, or record more, of more materials"
        )
    for doubt in doubts:
        warnings.warn(doubt, stacklevel=3)  # of `Identifier.adapt`
    line = _line(len(data), labels is not None, missing, differences, accuracies)
    return _new_model(model, made, known, data, line, labelled=labels is not None)


def _codes_of(labels: npt.NDArray[Any], places: Mapping[str | None, int], n: int) -> IntArray:
    """Return the place of each of n labels among the classes; refuse others."""
    if labels.shape != (n,):
        raise GranularIdError(
            f"labels must hold a label for each of {n} recordings, got shape {labels.shape}"
        )
    unknown = [label for label in labels.tolist() if label not in places]
    if unknown:
        raise GranularIdError(f"labels must hold labels of the training, got {unknown[0]!r}")
    return np.array([places[label] for label in labels.tolist()], dtype=np.intp)


def _refuse_too_little(codes: IntArray, classes: Sequence[str], allow_missing: bool) -> list[str]:
    """Return the classes without a labelled recording, if they are allowed; refuse too few recordings."""
    if len(codes) < LEAST_ROWS:
        raise GranularIdError(
            f"adapting by labels needs at least {LEAST_ROWS} recordings, got {len(codes)}: the offset of one cannot be "
            "separated from its material; record more, of more materials"
        )
    missing = [label for code, label in enumerate(classes) if code not in codes]
    if missing and not allow_missing:
        raise GranularIdError(
            f"adapting by labels needs recordings of every material, {', '.join(missing)} "
            f"{verb(len(missing), 'is', 'are')} missing: what the others show does not carry over; record them, "
            "or pass allow_missing=True (--allow-missing)"
        )
    return missing


def _answers_held_out(
    corrected: Callable[[IntArray], Learners], rows: FloatArray, codes: IntArray
) -> IntArray | None:
    """Answers of models that were made without the rows they name; None where a class has one row."""
    counts = np.bincount(codes)
    n_folds = min(_MOST_FOLDS, int(counts[counts > 0].min()))
    if n_folds < 2:
        return None
    named = np.empty_like(codes)
    for others, held in StratifiedKFold(n_folds).split(rows, codes):
        named[held] = corrected(others).answers(rows[held])
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


def _doubts_of_labels(model: TrainedModel, data: Dataset, codes: IntArray) -> list[str]:
    """Say where labelled recordings are of one material, or have trained the model before."""
    doubts = []
    if len(set(codes.tolist())) == 1:
        doubts.append(
            f"all recordings are of one material, {model.classes[codes[0]]}: the set-up cannot be separated from it, "
            "and the new model may name other materials less well; record several"
        )
    known = known_marks(model)
    if known and (again := sum(mark_of(samples) in known for samples in data.X)):
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


# What a model keeps of its training, to be adapted with.


def _learners(core: _core.Model) -> Learners:
    return Learners(core.coef, core.intercept, core.coding_matrix, core.losses)


def stored_source(core: _core.Model, rows: FloatArray, codes: IntArray) -> dict[str, Any]:
    """Return what a model keeps of the rows (n, D) that trained it; nothing where that is too large."""
    if not _has_room(core):
        return {}
    with single_threaded_blas():
        return _as_text(SourceStatistics.of(rows, codes, _learners(core)))


def _has_room(core: _core.Model) -> bool:
    """Whether what is stored of the training fits into a model file, beside novelty in float32."""
    n_features, n_learners, n_classes = core.n_features, core.n_learners, core.n_classes
    text = 4 * 8 * (2 * n_features + n_classes * n_learners) // 3
    tensors = 8 * n_features * n_learners + 4 * n_features * (2 * n_classes + 1)
    return text <= _MOST_SOURCE and tensors + text + _FOR_MORE <= MAX_FILE_BYTES


def _as_text(source: SourceStatistics) -> dict[str, Any]:
    parts = {"mean": source.mean, "sd": source.sd, "scores": source.scores}
    return {
        SOURCE: {
            name: None if v is None else base64.b64encode(v.astype("<f8").tobytes()).decode("ascii")
            for name, v in parts.items()
        }
    }


def _read_source(model: TrainedModel) -> SourceStatistics:
    stored = model.trained.get(SOURCE)
    if stored is None:
        raise GranularIdError(
            f"the model keeps nothing of its training that it could be adapted with: {model.core.n_learners} learners "
            f"on {model.core.n_features} features are too many; train one on a pipeline that ends in "
            "ECOCClassifier('onevsall'), or on fewer features"
        )
    n_features, shape = model.core.n_features, model.core.coding_matrix.shape
    mean = None if stored["mean"] is None else _numbers(stored["mean"], "mean", n_features)
    sd = _numbers(stored["sd"], "sd", n_features)
    if (sd < 0).any():
        raise GranularIdError(f"the model file: {SOURCE}.sd must not be negative")
    scores = _numbers(stored["scores"], "scores", shape[0] * shape[1])
    return SourceStatistics(mean, sd, scores.reshape(shape))


def _numbers(text: str, name: str, size: int) -> FloatArray:
    try:
        numbers = np.frombuffer(base64.b64decode(text, validate=True), dtype="<f8").astype(np.float64)
    except ValueError:
        numbers = np.empty(0)
    if numbers.size != size or not np.isfinite(numbers).all():
        raise GranularIdError(f"the model file: {SOURCE}.{name} must be {size} finite numbers in base64")
    return numbers


# The new model.


def _balanced(named: IntArray, truth: IntArray) -> float:
    return float(np.mean([(named[truth == k] == k).mean() for k in np.unique(truth)]))


def _new_model(
    model: TrainedModel,
    made: Learners,
    source: SourceStatistics,
    data: Dataset,
    line: str,
    *,
    labelled: bool,
) -> _core.Model:
    """Put weights and how they were made into a new model, and leave out what was measured on the old one."""
    trained = {name: value for name, value in model.trained.items() if name not in (RULES, "temperature")}
    # What was done to samples is that of the new recordings; what a frame or a sensor is called may only be unsaid.
    setup = trained.get("setup", {}).items()
    unchanged = {name: values for name, values in setup if name not in _DONE_TO_SAMPLES}
    trained |= {
        "estimate": None,
        "why_no_estimate": "the model was adapted to another set-up, of which no recordings were held out",
        "synthetic": model.synthetic or data.is_synthetic,
        "setup": {**unchanged, **values_in(setups_in(data))},
        ADAPTED: line,
        # Another time the columns are no longer those of the training.
        **_as_text(replace(source, mean=None)),
    }
    if trained.get("early") is not None:
        why_not = "the model was adapted since its margins were measured"
        trained["early"] = {"target_error": trained["early"]["target_error"], "why_not": why_not}
    if labelled and trained.get(MARKS):  # they have trained it, too
        trained[MARKS] += stored_marks(data).get(MARKS, "")
    core = model.core
    (spec, _, _, coding, classes), options = core.__getnewargs_ex__()
    text = json.dumps(trained, ensure_ascii=False, sort_keys=True, allow_nan=False)
    options |= {"early": None, "novelty": None, "metadata": {**core.metadata, "trained": text}}
    if core.raw_mean is not None:
        options["raw_mean"] = data.X.mean(axis=0).T.ravel()
    return _core.Model(spec, made.coef, made.intercept, coding, classes, **options)
