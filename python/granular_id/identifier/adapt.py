"""Models brought to another set-up: a new model with other weights, and the history of how it came to be."""

from __future__ import annotations

import base64
import hashlib
import json
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from datetime import datetime, timezone
from typing import Any

import numpy as np
import numpy.typing as npt

from granular_id import _core
from granular_id._checks import checked_flag
from granular_id._memory import empty
from granular_id._parallel import single_threaded_blas
from granular_id._text import Table, counted, percent, verb
from granular_id.features import FeatureSpec
from granular_id.identifier.metadata import (
    ADAPTED_BEFORE,
    HISTORY,
    MARKS,
    MAX_FILE_BYTES,
    SOURCE,
    Begin,
    Metadata,
    check_recordings,
    cropped_to_model,
    fingerprint,
    mark_of,
    marks_of,
    stored_marks,
)
from granular_id.identifier.rules import KEY as CONFIDENCE
from granular_id.recording import Dataset, setups_in, values_in
from granular_id.spaces import (
    Learners,
    SourceStatistics,
    adapted,
    checked_rounds,
    codes_of,
    missing_of,
    recalibrated,
    refuse_few,
    refuse_missing,
)

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

_MOST_SOURCE = 2**19
"""Bytes of text; a model of more materials or features keeps none, and asks for its recordings again."""

_FOR_HISTORY = 2**17
"""Bytes that are left for it in the largest file."""

_CAUTION = 3.0
"""Rows a material without offset, in spaces of samples and counts: their scores name too few recordings rightly."""

_DONE_TO_SAMPLES = ("tare", "payload", "compensated")

_MOST_SESSIONS, _LONGEST_SESSION = 20, 80
_FEW = 4
_LEAST_KNOWN = 0.9  # linear learners name nearly all of what trained them
_CHANCE = 1.5  # recordings
_AT_ONCE = 1024
_MOST_FOLDS = 5

SHIFT, STANDARDISED, LABELLED = "balanced shift", "mean and SD of each column", "labelled recordings"


@dataclass(frozen=True)
class Adaptation:
    """How a model was brought to another set-up, as its file keeps it; ``print`` shows a table.

    Attributes
    ----------
    method : {"balanced shift", "mean and SD of each column", "labelled recordings"}
    rounds : int
        Of self-training.
    made : str
        When, UTC, ISO 8601.
    n_recordings : int
    sha256 : str
        Of their samples.
    sessions : tuple of str
        Theirs, 20 at most.
    materials : dict of str to int
        Labelled recordings of each material; empty where labels were not used.
    missing : tuple of str
        Materials without a labelled recording: what the others showed does not carry over to them.
    shares_before, shares_after : dict of str to float
        Share of the recordings that each model names for each material.
    n_changed : int
        Recordings that the new model names otherwise.
    n_judged : int
        Recordings with a label that the model knows.
    accuracy_before, accuracy_after : float or None
        Balanced accuracy on those. After labelled recordings by models that were made without the recordings they
        name, unless some of these were seen before; None with fewer than two of a material.
    n_seen : int
        Of the judged, recordings that the model was trained on or adapted to before: they make both accuracies too
        good.
    marks : str
        To know recordings again: 8 hexadecimal digits of each one's SHA-256, side by side; of more than 4096 none.
        Labelled ones are among the recordings of the training, where the model keeps these.
    differences : tuple of str
        What of the set-up was not as in the training.
    dropped : tuple of str
        What the model could no longer promise.
    estimate_before : float or None
        Accuracy that the training expected of recordings of its own set-up.
    """

    method: str
    rounds: int
    made: str
    n_recordings: int
    sha256: str
    sessions: tuple[str, ...]
    shares_before: dict[str, float]
    shares_after: dict[str, float]
    n_changed: int
    n_judged: int = 0
    accuracy_before: float | None = None
    accuracy_after: float | None = None
    materials: dict[str, int] = field(default_factory=dict)
    missing: tuple[str, ...] = ()
    differences: tuple[str, ...] = ()
    dropped: tuple[str, ...] = ()
    estimate_before: float | None = None
    n_seen: int = 0
    marks: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Return everything in types that JSON knows."""
        return {name: list(v) if isinstance(v, tuple) else v for name, v in asdict(self).items()}

    @classmethod
    def from_dict(cls, stored: Mapping[str, Any]) -> Adaptation:
        """Read what `to_dict` gave."""
        known: dict[str, Any] = {
            name: tuple(v) if isinstance(v, list) else v
            for name, v in stored.items()
            if name in cls.__dataclass_fields__
        }
        return cls(**known)

    @property
    def lines(self) -> tuple[str, ...]:
        """What was done, in lines to read."""
        few = ", ".join([*self.sessions[:_FEW], *(["..."] if len(self.sessions) > _FEW else [])])
        rounds = f" and {counted(self.rounds, 'round')} of self-training" if self.rounds else ""
        told = [
            f"{self.method}{rounds}, from {counted(self.n_recordings)}{f' ({few})' if few else ''}",
            f"made {self.made[:16].replace('T', ' ')} UTC from samples {self.sha256[:16]}",
            f"answers changed: {self.n_changed} of {self.n_recordings}",
        ]
        if self.accuracy_before is not None:
            after = "after not known, with fewer than two recordings of a material"
            if self.accuracy_after is not None:
                after = f"{percent(self.accuracy_after)} after"
                if not self.materials:
                    after += ", on what adapted the model"
                elif not self.n_seen:
                    after += ", each named by a recalibration without it"
            told.append(
                f"balanced accuracy on the {self.n_judged} with a label that the model knows: "
                f"{percent(self.accuracy_before)} before, {after}"
            )
        if self.n_seen:
            told.append(
                f"{self.n_seen} of these trained or adapted the model before: both accuracies are too good"
            )
        if self.differences:
            told.append(f"set-up: {'; '.join(self.differences)}")
        if self.missing:
            told.append(f"materials that were missing, and gain nothing: {', '.join(self.missing)}")
        if self.dropped:
            told.append(f"no longer true, and dropped: {', '.join(self.dropped)}")
        return tuple(told)

    def table(self) -> Table:
        """Shares of answers before and after, with what was done below."""
        names = list(self.shares_before)
        rows = tuple((n, percent(self.shares_before[n]), percent(self.shares_after[n])) for n in names)
        return Table(
            "Share of the answers that name each material", ("material", "before", "after"), rows, self.lines
        )

    def __str__(self) -> str:
        return str(self.table())


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
    return text <= _MOST_SOURCE and len(core.to_bytes()) + text + _FOR_HISTORY <= max_file_bytes


def adapted_model(
    core: _core.Model,
    recordings: Dataset,
    *,
    all_materials: bool,
    rounds: int | None,
    trained_on: Dataset | None,
    begin_at: Begin,
    lead_s: float | None,
    accept: str | Sequence[str],
    threads: int | None,
) -> _core.Model:
    """Adapt a model to recordings without labels; `Identifier.adapt` describes it."""
    rounds = checked_rounds(rounds, all_materials)
    data, differences = _taken(core, recordings, "recordings", begin_at, lead_s, accept)
    source, learners = _source(core, trained_on, threads), _learners(core)
    rows = features_of(core, data.X, threads)
    with single_threaded_blas():
        made, known = adapted(
            learners,
            source,
            rows,
            all_materials=all_materials,
            rounds=rounds,
            blocks=_blocks(core),
            caution=_CAUTION if isinstance(core.spec, FeatureSpec) else 0.0,
        )
    entry = _entry(
        core,
        learners,
        made,
        rows,
        data,
        differences,
        method=STANDARDISED if all_materials else SHIFT,
        rounds=rounds,
        marks=stored_marks(data).get(MARKS, ""),
    )
    _warn_of(entry, core, data, all_materials=all_materials)
    return _new_model(core, made, known, data, entry)


def recalibrated_model(
    core: _core.Model,
    labelled: Dataset,
    *,
    allow_missing: bool,
    trained_on: Dataset | None,
    begin_at: Begin,
    lead_s: float | None,
    accept: str | Sequence[str],
    threads: int | None,
) -> _core.Model:
    """Adapt a model to recordings with labels; `Identifier.recalibrate` describes it."""
    checked_flag("allow_missing", allow_missing)
    data, differences = _taken(core, labelled, "labelled", begin_at, lead_s, accept)
    codes = codes_of(data.y, np.array(core.classes), len(data), "labelled")
    refuse_few(len(codes), "recalibration")
    missing = refuse_missing(codes, core.classes, allow_missing)
    source, learners = _source(core, trained_on, threads), _learners(core)
    rows = features_of(core, data.X, threads)
    blocks = _blocks(core)

    def corrected(members: npt.NDArray[np.bool_]) -> Learners:
        return recalibrated(learners, source, rows[members], codes[members], blocks)

    with single_threaded_blas():
        made = corrected(np.ones(len(rows), dtype=np.bool_))
        after = _accuracy_held_out(corrected, rows, codes)
    counts = np.bincount(codes, minlength=len(core.classes)).tolist()
    entry = _entry(
        core,
        learners,
        made,
        rows,
        data,
        differences,
        method=LABELLED,
        accuracy_after=after,
        materials={label: n for label, n in zip(core.classes, counts, strict=True) if n},
        missing=tuple(missing),
        marks="" if Metadata(core).marks else stored_marks(data).get(MARKS, ""),
    )
    _warn_of(entry, core, data)
    return _new_model(core, made, source, data, entry)


def _accuracy_held_out(
    corrected: Callable[[npt.NDArray[np.bool_]], Learners], rows: FloatArray, codes: IntArray
) -> float | None:
    """Balanced accuracy of models made without the rows they name; None where a class has one row."""
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
    return _balanced(named, codes)


def _taken(
    core: _core.Model,
    recordings: Dataset,
    name: str,
    begin_at: Begin,
    lead_s: float | None,
    accept: str | Sequence[str],
) -> tuple[Dataset, tuple[str, ...]]:
    """Refuse what the model cannot identify, and crop the rest to its length."""
    if not isinstance(recordings, Dataset):
        raise TypeError(f"{name} must be a granular_id.Dataset, got {type(recordings).__name__}")
    differences = check_recordings(recordings, core, accept)
    data = cropped_to_model(recordings, core, begin_at=begin_at, lead_s=lead_s, over_all=False)
    return data, differences


def _learners(core: _core.Model) -> Learners:
    return Learners(core.coef, core.intercept, core.coding_matrix, core.losses)


def _blocks(core: _core.Model) -> dict[str, int] | None:
    """Of samples and counts too few rows tell too little: there regression costs what recentring gains."""
    return None if isinstance(core.spec, FeatureSpec) else core.spec.block_sizes


# What a model keeps of its training.


def _statistics(core: _core.Model, rows: FloatArray, y: npt.NDArray[np.str_]) -> SourceStatistics:
    codes = codes_of(y, np.array(core.classes), len(rows), "trained_on")
    missing = missing_of(codes, core.classes)
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
    if known.trained.get(HISTORY) or known.trained.get(ADAPTED_BEFORE):
        raise ValueError(
            "the model keeps nothing of its training, and was adapted before: adapt the model that it was made from"
        )
    if trained_on is None:
        raise ValueError(
            "the model keeps nothing of its training that it could be adapted with: it is of an earlier version, was "
            "taken over from a pipeline or has too many materials; pass the recordings of its training, trained_on=data"
        )
    rows, y = features_of(core, trained_on.X, threads), trained_on.y
    with single_threaded_blas():
        source, named = _statistics(core, rows, y), _learners(core).answers(rows)
    accuracy = _balanced(named, codes_of(y, np.array(core.classes), len(rows), "trained_on"))
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
    if not trained.get(HISTORY):  # which names the set-up of the new recordings
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


def _entry(
    core: _core.Model,
    before: Learners,
    after: Learners,
    rows: FloatArray,
    data: Dataset,
    differences: tuple[str, ...],
    **known: Any,
) -> Adaptation:
    """Compare the answers of two models about recordings, and add what is known of how the second was made."""
    with single_threaded_blas():
        old, new, n = before.answers(rows), after.answers(rows), len(rows)
    seen = Metadata(core).seen
    places = {label: k for k, label in enumerate(core.classes)}
    truth = np.array([places.get(r.label, -1) if r.label is not None else -1 for r in data], dtype=np.intp)
    judged = truth >= 0

    def shares(named: IntArray) -> dict[str, float]:
        counts = np.bincount(named, minlength=len(core.classes)) / n
        return dict(zip(core.classes, counts.tolist(), strict=True))

    sessions = sorted({str(s)[:_LONGEST_SESSION] for s in data.sessions.tolist() if s is not None})
    facts: dict[str, Any] = {
        "rounds": 0,
        "made": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "n_recordings": n,
        "sha256": hashlib.sha256(np.ascontiguousarray(data.X, dtype="<f8").data).hexdigest(),
        "sessions": tuple(sessions[:_MOST_SESSIONS]),
        "shares_before": shares(old),
        "shares_after": shares(new),
        "n_changed": int((old != new).sum()),
        "n_judged": int(judged.sum()),
        "accuracy_before": _balanced(old[judged], truth[judged]) if judged.any() else None,
        "accuracy_after": _balanced(new[judged], truth[judged]) if judged.any() else None,
        "n_seen": sum(mark_of(data.X[row]) in seen for row in np.flatnonzero(judged)) if seen else 0,
        "differences": differences,
    }
    return Adaptation(**facts | known)


def _warn_of(entry: Adaptation, core: _core.Model, data: Dataset, *, all_materials: bool = False) -> None:
    """Warn where labels, or recordings that come again, speak against what was made of them."""
    doubts = []
    labels = {one.label for one in data}
    missing = [label for label in core.classes if label not in labels]
    all_known = None not in labels  # one without a label may be of any material
    if all_known and all_materials and missing:
        doubts.append(
            f"all_materials=True states that all materials are there, and by the labels {', '.join(missing)} "
            f"{verb(len(missing), 'is', 'are')} missing: leave it out, or record them"
        )
    elif all_known and len(labels) == 1:
        doubts.append(
            f"all recordings are of one material, {data[0].label}: the set-up cannot be told from it, and the new "
            "model may name other materials less well; record several"
        )
    before, after = entry.accuracy_before, entry.accuracy_after
    if before is not None and after is not None and (before - after) * entry.n_judged > _CHANCE:
        doubts.append(
            f"balanced accuracy on the recordings with a label fell from {percent(before)} to {percent(after)}: keep "
            "the model as it was, or record more, of more materials"
        )
    if entry.materials and (taught := Metadata(core).taught):
        again = sum(mark in taught for mark in marks_of(data))
        if again:
            doubts.append(
                f"{again} of {counted(len(data))} {verb(again, 'has', 'have')} trained or recalibrated the model "
                "before, and count twice now: record others"
            )
    for doubt in doubts:
        warnings.warn(doubt, stacklevel=4)  # of `Identifier.adapt`


def _balanced(named: IntArray, truth: IntArray) -> float:
    return float(np.mean([(named[truth == k] == k).mean() for k in np.unique(truth)]))


def _new_model(
    core: _core.Model, made: Learners, source: SourceStatistics, data: Dataset, entry: Adaptation
) -> _core.Model:
    """Put weights and history into a new model, and leave out what was measured on the old one."""
    trained = dict(Metadata(core).trained)
    rules = trained.pop(CONFIDENCE, None) or {}
    estimate, setup = trained.get("estimate"), trained.get("setup") or {}
    dropped = {
        "early answers": core.early is not None,
        "probabilities": core.sigmoid is not None,
        "candidates": rules.get("conformal") is not None,
        "refusal of unknown materials": rules.get("unknown") is not None,
        "estimate of the accuracy": estimate is not None,
    }
    entry = replace(
        entry,
        dropped=tuple(name for name, had in dropped.items() if had),
        estimate_before=None if estimate is None else estimate["accuracy"],
    )
    # What was done to samples is that of the new recordings; what a frame or a sensor is called may only be unsaid.
    kept_setup = {name: values for name, values in setup.items() if name not in _DONE_TO_SAMPLES}
    why = "the model was adapted to another set-up, of which no recordings were held out"
    trained |= {
        "estimate": None,
        "why_no_estimate": why,
        "synthetic": bool(trained.get("synthetic", False)) or data.is_synthetic,
        "setup": {**kept_setup, **values_in(setups_in(data))},
        HISTORY: [*_older(trained.get(HISTORY, [])), entry.to_dict()],
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
    if entry.materials and trained.get(MARKS):  # they have trained it, too
        trained[MARKS] += stored_marks(data).get(MARKS, "")
    kept: dict[str, Any] = {"early": None, "sigmoid": None, "posterior_weights": None}
    if core.raw_low is not None and core.raw_high is not None:
        # Bounds of what may still come: what the training saw, and the new set-up.
        low, high, mean = (v.T.ravel() for v in (data.X.min(axis=0), data.X.max(axis=0), data.X.mean(axis=0)))
        kept["raw_low"] = np.minimum(low, core.raw_low)
        kept["raw_high"] = np.maximum(high, core.raw_high)
        kept["raw_mean"] = np.ascontiguousarray(mean)
    return _changed(core, trained, made, posterior="", **kept)


def _older(history: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Keep the marks of the last two adaptations only: a file has no room for all."""
    last = len(history) - 2
    return [{**one, "marks": ""} if k < last else dict(one) for k, one in enumerate(history)]


def _changed(
    core: _core.Model,
    trained: Mapping[str, Any],
    learners: Learners | None = None,
    posterior: str | None = None,
    **parts: Any,
) -> _core.Model:
    """Return a model with other metadata, and other weights where they are given."""
    (spec, coef, intercept, coding, classes), options = core.__getnewargs_ex__()
    if learners is not None:
        coef, intercept = learners.coef, learners.intercept
    text = json.dumps(trained, ensure_ascii=False, sort_keys=True, allow_nan=False)
    metadata = {**core.metadata, "trained": text}
    if posterior is not None:
        metadata["posterior"] = posterior
    options = {**options, **parts, "metadata": metadata, "lacks_digest": False}
    return _core.Model(spec, coef, intercept, coding, classes, **options)
