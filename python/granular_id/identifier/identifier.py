"""``Identifier``: a trained model that names materials, and fits into one safe file."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from granular_id import _core
from granular_id._columns import samples_of
from granular_id._files import MODELS, refuse_other_kind, whole_file
from granular_id._progress import ProgressCallback
from granular_id.identifier.answers import Answers
from granular_id.identifier.metadata import check_known
from granular_id.identifier.recipe import Begin, Recipe, fitted, parts_of, refuse_others
from granular_id.identifier.rules import Rules
from granular_id.identifier.training import MAX_FILE_BYTES, core_of, train
from granular_id.recording import Dataset, Recording
from granular_id.spaces import DEFAULT_RANGE, BinRange, BlockWeights, axis_names, axis_units

if TYPE_CHECKING:
    from granular_id.identifier.answers import Decision
# What a model is and what it says, whatever it was made from.

FloatArray = npt.NDArray[np.float64]


class Identifier(Answers):
    """A trained model that names materials: features, linear learners, classes and what is known of their making.

    Made by `fit`, `from_classifier` or `load`. Everything that decides about an answer is in `core`, the same object
    that the Rust crate and the streaming identification use: the same labels and scores, to the last bit, from whole
    recordings and from streams.

    Parameters
    ----------
    core : granular_id._core.Model
        The model.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> import granular_id as gid
    >>> from granular_id.identifier import Identifier
    >>> data = gid.synthesize(["rice", "fine sugar"], n_per_class=6, duration_s=0.5)
    >>> identifier = Identifier.fit(data, "hfmh")
    >>> identifier
    Identifier('hfmh', 2 classes, 250 samples at 500 Hz, trained on SYNTHETIC recordings)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder) / "kitchen.safetensors"
    ...     identifier.save(file)
    ...     same = Identifier.load(file)
    >>> bool((same.predict(data.X) == identifier.predict(data.X)).all())
    True
    """

    @classmethod
    def fit(
        cls,
        data: Dataset,
        space: str = "best",
        *,
        cutoff_hz: float = 23.0,
        order: int = 8,
        n_bins: int = 100,
        bin_range: BinRange = DEFAULT_RANGE,
        outside: str = "drop",
        density: bool = False,
        initial: str = "zero",
        block_weights: BlockWeights = None,
        shrinkage: float | None = None,
        C: float = 1.0,
        coding: str | npt.ArrayLike = "onevsone",
        loss: str = "auto",
        decoding: str = "loss_weighted",
        posterior: str | None = None,
        estimate: bool = True,
        early: bool = True,
        target_error: float = 0.01,
        coverage: float | None = 0.9,
        share_known: float | None = 0.95,
        n_folds: int = 5,
        random_state: int = 0,
        max_file_bytes: int = MAX_FILE_BYTES,
        threads: int | None = None,
        progress: bool | ProgressCallback | None = None,
    ) -> Identifier:
        """Train on all recordings of a data set; the estimates in `trained` come from recordings held out.

        Parameters
        ----------
        data : Dataset
            Recordings of equal length and rate with a label each.
        space : {"best", "multiband", "raw+hfmh", "hfmh", "raw"}, default "best"
            Feature space. ``"best"`` takes multi-band features (`granular_id.MultiBand`) and chooses blocks, whitening
            and `C` by holding recordings out, sessions where it can (`granular_id.BestClassifier`); `trained`
            says what was chosen. The default, as of `granular-id train`, because it is the most accurate on other
            sessions. ``"multiband"`` has no choice to make and trains faster. Samples and counts, as in the paper
            (``"raw+hfmh"``), give scores that grow with each sample: live answers can be settled before the end.
        cutoff_hz, order, n_bins, bin_range, outside, density, initial, block_weights
            As in `granular_id.RawHFMH`; weights of blocks end in those of the learners.
        shrinkage : float, optional
            Whitens multi-band features within classes, see `granular_id.spaces.WithinClassWhitening`.
        C, coding, loss, decoding, posterior
            As in `granular_id.ECOCClassifier`, but that the loss ``"auto"`` is ``"root"`` with multi-band features;
            `posterior` gives `predict_proba`. ``"best"`` chooses the first four.
        estimate : bool, default True
            Hold recordings out to measure the accuracy: whole sessions where every class has several, else halves
            in time order, else random folds. Costs a training for each partition. Without it there is no early rule.
        early : bool, default True
            Calibrate on them from which margin on an answer may be given before the recording ends.
        target_error : float, default 0.01
            Share of early answers that may be wrong; ``1 / target_error - 1`` recordings at least can show it.
        coverage : float or None, default 0.9
            Decisions name candidates, which hold the right material in this share of recordings like those held out,
            see `granular_id.confidence.conformal_rule`; None: no candidates.
        share_known : float or None, default 0.95
            Decisions say whether a recording is like none of the materials, wrongly of the known ones in the rest of
            this share, see `granular_id.confidence.unknown_rule`; None: they do not.
        n_folds : int, default 5
            Random folds, where neither sessions nor an order in time are known.
        random_state : int, default 0
            Draws random codings, random folds and those of `posterior`. Same data and settings, same bytes.
        max_file_bytes : int, default 16 MiB
            Largest model file.
        threads : int, optional
            Threads of the extraction; no bit depends on it. Default: all cores.
        progress : bool or callable, optional
            As in `granular_id.evaluate`; None is silent.

        Returns
        -------
        Identifier

        Raises
        ------
        TypeError
            `data` is not a `Dataset`, or a setting has the wrong type.
        ValueError
            Lengths or rates differ, a recording has no label, there is one class only, a space that does not work
            here, a setting out of range, or a model too large: the message names ways out.
        """
        recipe = Recipe(
            space=space,
            cutoff_hz=cutoff_hz,
            order=order,
            n_bins=n_bins,
            bin_range=bin_range,
            outside=outside,
            density=density,
            initial=initial,
            block_weights=block_weights,
            shrinkage=shrinkage,
            C=C,
            coding=coding,
            loss=loss,
            decoding=decoding,
            posterior=posterior,
            random_state=random_state,
        )
        training = train(
            data,
            recipe,
            estimate=estimate,
            early=early,
            target_error=target_error,
            coverage=coverage,
            share_known=share_known,
            n_folds=n_folds,
            max_file_bytes=max_file_bytes,
            threads=threads,
            progress=progress,
        )
        return cls(training.core)

    @classmethod
    def from_classifier(
        cls,
        pipeline: Any,
        *,
        rate_hz: float | None = None,
        axes: Sequence[str] | None = None,
        lead_s: float | None = None,
        samples: npt.ArrayLike | None = None,
    ) -> Identifier:
        """Take over a scikit-learn pipeline that was fitted on recordings.

        Parameters
        ----------
        pipeline : Pipeline
            Fitted, on labels of text: `RawSignal`, `HFMH`, `RawHFMH` or `MultiBand`; then steps that scale, whiten or
            project (`BlockScaler`, `WithinClassWhitening`, `StandardScaler` ...), if any; then an `ECOCClassifier` of
            linear learners or a `BestClassifier`.
        rate_hz : float, optional
            Rate of the recordings, Hz, where the feature space does not know it (`RawSignal` need not).
        axes : sequence of str, optional
            Names of the axes. Default: those that the pipeline was fitted on, if they had names; else fx fy fz tx ty tz
            where there are six, else axis0, axis1 ...
        lead_s : float, optional
            Seconds of rest ahead of the trigger in the recordings.
        samples : ndarray, shape (n, T, C), optional
            The recordings of the training. Provisional answers of models on raw samples take their mean for what
            has not been seen; without them zero, and none is ever settled.

        Returns
        -------
        Identifier
            Without estimates and without an early rule; whether its recordings were simulated is not known.

        Raises
        ------
        TypeError, ValueError
            Another kind of pipeline, not fitted, learners that are not linear, no rate, labels that are no text,
            samples of another shape than the pipeline was fitted on.

        Examples
        --------
        >>> import granular_id as gid
        >>> from sklearn.pipeline import make_pipeline
        >>> from granular_id.identifier import Identifier
        >>> data = gid.synthesize(["rice", "fine sugar"], n_per_class=4, duration_s=0.5)
        >>> pipeline = make_pipeline(gid.RawHFMH(), gid.ECOCClassifier()).fit(data.X, data.y)
        >>> identifier = Identifier.from_classifier(pipeline, samples=data.X)
        >>> bool((identifier.predict(data.X) == pipeline.predict(data.X)).all())
        True
        """
        parts = parts_of(pipeline, rate_hz)
        axes = getattr(pipeline[0], "axes_in_", None) if axes is None else axes
        names = axis_names(parts.n_axes) if axes is None else tuple(axes)
        units = axis_units(parts.n_axes) if axes is None else None
        raw = None if samples is None else np.asarray(samples, dtype=np.float64)
        wanted = (parts.n_samples, parts.n_axes)
        if raw is not None and raw.shape[1:] != wanted:
            raise ValueError(f"samples must have shape (n, {wanted[0]}, {wanted[1]}), got {raw.shape}")
        raw = raw if parts.takes_samples else None
        return cls(core_of(parts, axes=names, units=units, lead_s=lead_s, samples=raw))

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, max_file_bytes: int = MAX_FILE_BYTES) -> Identifier:
        """Read a model file. Nothing in it is executed; what is not exactly a model is refused.

        Parameters
        ----------
        path : path-like
            Written by `save`.
        max_file_bytes : int, default 16 MiB
            Largest file to read.

        Raises
        ------
        FileNotFoundError, OSError
            There is no such file, or it cannot be read.
        ValueError
            (`granular_id._core.ModelFileError`) The file is no model, is damaged or too large: the first fault.

        Warns
        -----
        UserWarning
            The file has no digest: an earlier version wrote it, and damage cannot be told. `lacks_digest` tells later.
        """
        core = _core.Model.read(path, max_file_bytes=max_file_bytes)
        if core.lacks_digest:
            warnings.warn(
                f"{os.fspath(path)}: this file has no digest, an earlier version wrote it: damage to its numbers would "
                "go unnoticed. Train again, or load and save a copy that you trust",
                stacklevel=2,
            )
        try:
            check_known(json.loads(core.metadata["trained"]))
            Rules.of(core)
        except (TypeError, ValueError) as fault:
            raise _core.ModelFileError(f"{os.fspath(path)}: trained: {fault}") from None
        return cls(core)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the model into one file (safetensors), whole or not at all; one that is there is replaced.

        Raises
        ------
        ValueError
            The path ends like another kind of file.
        OSError
            It cannot be written.
        """
        refuse_other_kind(path, MODELS)
        with whole_file(path) as draft:
            draft.write_bytes(self.core.to_bytes())

    def identify(
        self,
        recording: Recording | npt.ArrayLike,
        *,
        begin_at: Begin = "auto",
        lead_s: float | None = None,
        accept: str | Sequence[str] = (),
    ) -> Decision:
        """Name the material of one recording.

        Parameters
        ----------
        recording : Recording, or array-like of shape (T, C)
            An array has the length, rate and axes of the training; columns with names come into the order of `axes`.
            A recording may be longer.
        begin_at : {"auto", "first", "trigger"}, default "auto"
            Where to begin in a recording: automatically at the first sample where it has the length of the model;
            where it is longer as in the training, at its trigger (less the lead) or at the first sample.
        lead_s : float, optional
            Seconds kept ahead of the trigger; default: as in the training.
        accept : str or sequence of str, default ()
            What of the recording's set-up may differ from the training though it is refused otherwise: "frame",
            "transform", "sign", "units", see `granular_id.recording.Setup`.

        Returns
        -------
        Decision
            Final, with label, ranking and margin; with a probability where the model has them. Its warnings say what
            else of the set-up is not as in the training.

        Raises
        ------
        TypeError, ValueError
            Another rate, axes, frame, sign or unit, a recording too short, or nothing says where to begin.
        """
        from granular_id.identifier.streaming import StreamingIdentifier  # it imports this module

        differences: tuple[str, ...] = ()
        if isinstance(recording, Recording):
            data = Dataset([recording])
            differences = refuse_others(data, self.core, accept)
            wrench = fitted(data, self.core, begin_at=begin_at, lead_s=lead_s)[0].wrench
        else:
            wrench = np.asarray(samples_of(recording, "recording", self.axes)[0], dtype=np.float64)
            wanted = (self.n_samples, len(self.axes))
            if wrench.shape != wanted:
                raise ValueError(f"recording must have shape {wanted} as in the training, got {wrench.shape}")
        stream = StreamingIdentifier(self)
        for difference in differences:
            stream.warn(difference)
        stream.push(wrench)
        return stream.decision()

    def __repr__(self) -> str:
        on = ", trained on SYNTHETIC recordings" if self.synthetic else ""
        size = f"{self.n_samples} samples at {self.rate_hz:g} Hz"
        return f"Identifier({self.space!r}, {len(self.classes)} classes, {size}{on})"
