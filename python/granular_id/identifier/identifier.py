"""`Identifier`: a trained model that names materials, and fits into one safe file."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from granular_id import _core
from granular_id._columns import samples_of
from granular_id._files import MODELS, refuse_other_kind, whole_file
from granular_id._progress import ProgressCallback
from granular_id.features import FeatureSpec
from granular_id.identifier.decision import Decision, decision_of
from granular_id.identifier.metadata import (
    BANDED,
    MAX_FILE_BYTES,
    Begin,
    Metadata,
    check_recordings,
    check_trained,
    cropped_to_model,
)
from granular_id.identifier.rules import probabilities
from granular_id.recording import Dataset, Recording

# Training, adapting and probabilities are imported where they are called for: they bring in scikit-learn.

if TYPE_CHECKING:
    from sklearn.pipeline import Pipeline

    from granular_id.identifier.answers import Timeline

FloatArray = npt.NDArray[np.float64]


class Identifier:
    """A trained model that names materials: features, linear learners, classes and metadata of the training.

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
    >>> from granular_id import Identifier
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

    def __init__(self, core: _core.Model | None = None) -> None:
        if not isinstance(core, _core.Model):
            came = "nothing" if core is None else type(core).__name__
            raise TypeError(
                "an Identifier is made by Identifier.fit(data), Identifier.load(path) or "
                f"Identifier.from_classifier(pipeline); it holds a granular_id._core.Model, got {came}"
            )
        self.core = core

    @classmethod
    def fit(
        cls,
        data: Dataset,
        space: str | Pipeline = "best",
        *,
        by: str = "auto",
        background: Sequence[str] = (),
        estimate: bool = True,
        target_error: float | None = 0.01,
        coverage: float | None = 0.9,
        share_known: float | None = 0.95,
        random_state: int = 0,
        threads: int | None = None,
        progress: bool | ProgressCallback | None = None,
    ) -> Identifier:
        """Train on all recordings of a data set; the estimates in `trained` come from recordings held out.

        Parameters
        ----------
        data : Dataset
            Recordings of equal length and rate with a label each.
        space : {"best", "multiband", "raw+hfmh", "hfmh", "raw"} or Pipeline, default "best"
            Feature space. ``"best"`` takes multi-band features (`granular_id.MultiBand`) and chooses blocks, whitening
            and cost by holding recordings out (`granular_id.BestClassifier`); `trained` says what was chosen. The
            default, because it is the most accurate on other sessions. ``"multiband"`` has no choice to make and trains
            faster. Samples and counts, as in the paper (``"raw+hfmh"``), give scores that grow with each sample. Other
            settings come as a pipeline that is not fitted: `RawSignal`, `HFMH`, `RawHFMH` or `MultiBand`, steps that
            scale or whiten, then `ECOCClassifier` or `BestClassifier`.
        by : str, default "auto"
            What is held out, as in `granular_id.evaluate`, to measure the accuracy and to set all rules: whole sessions
            where half of the materials have several, else halves in time, else random folds; or what new recordings
            will not share with these, such as ``"tool"``, which ``"best"`` then holds out to choose, too.
        background : sequence of str, default ()
            Labels of materials that are recorded but never named. They show how materials differ, so that unknown ones
            stand out better; a push of one of them is refused, too. Two to four help most: of four named materials of
            real recordings the unknown stood out with an AUROC of 0.935 without, 0.968 with two, 0.973 with four.
        estimate : bool, default True
            Hold recordings out, by the folds of `evaluate`: the accuracy is the one that it prints. Costs a training
            for each fold. Without it there are no probabilities, candidates, refusals and early answers.
        target_error : float or None, default 0.01
            Share of early answers that may be wrong, in the mean over new sessions; None: no early answers.
        coverage : float or None, default 0.9
            Decisions name candidates, which hold the right material in this share of recordings in the mean over new
            sessions, see `granular_id.confidence.candidate_rule`; None: no candidates.
        share_known : float or None, default 0.95
            Decisions say whether a recording is like none of the materials, wrongly of the known ones in the rest of
            this share, see `granular_id.confidence.unknown_rule`; None: they do not.
        random_state : int, default 0
            Draws random folds. Same data and settings, same bytes.
        threads : int, optional
            Threads of the extraction; the result does not depend on it. Default: all cores.
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
            here, a setting out of range, a condition that cannot be held out, or a model too large: the message names
            ways out.
        """
        from granular_id.identifier.training import train

        training = train(
            data,
            space,
            by=by,
            background=background,
            estimate=estimate,
            target_error=target_error,
            coverage=coverage,
            share_known=share_known,
            random_state=random_state,
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
            has not been seen; without them zero.

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
        >>> from granular_id import Identifier
        >>> data = gid.synthesize(["rice", "fine sugar"], n_per_class=4, duration_s=0.5)
        >>> pipeline = make_pipeline(gid.RawHFMH(), gid.ECOCClassifier()).fit(data.X, data.y)
        >>> identifier = Identifier.from_classifier(pipeline, samples=data.X)
        >>> bool((identifier.predict(data.X) == pipeline.predict(data.X)).all())
        True
        """
        from granular_id.identifier.core import model_of

        raw = None if samples is None else np.asarray(samples, dtype=np.float64)
        return cls(model_of(pipeline, rate_hz, axes=axes, lead_s=lead_s, samples=raw))

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, max_file_bytes: int = MAX_FILE_BYTES) -> Identifier:
        """Read a model file. Nothing in it is executed; what is not exactly a model is refused.

        Parameters
        ----------
        path : path-like
            Written by `save`.
        max_file_bytes : int, default 32 MiB
            Largest file to read.

        Raises
        ------
        FileNotFoundError, OSError
            There is no such file, or it cannot be read.
        ValueError
            The file is no model, is damaged or too large: the first fault.
        """
        if os.path.isdir(path):  # noqa: PTH112 - bytes are paths, too
            wanted = "wanted a model file, as granular-id train and Identifier.save write it"
            raise IsADirectoryError(f"{os.fsdecode(path)} is a folder, {wanted}")
        core = _core.Model.read(path, max_file_bytes=max_file_bytes)
        try:
            check_trained(Metadata(core).trained)
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

    @property
    def classes(self) -> tuple[str, ...]:
        """The K labels, sorted."""
        return self.core.classes

    @property
    def spec(self) -> FeatureSpec | _core.MultiBandExtractor:
        """What is extracted from a recording: samples and counts, or multi-band features with their scales."""
        return self.core.spec

    @property
    def space(self) -> str:
        """Feature space that the model was trained in: "raw", "hfmh", "raw+hfmh", "multiband" or "best".

        Of another pipeline with multi-band features: "multiband", with the blocks added or left out.
        """
        spec = self.spec
        if isinstance(spec, FeatureSpec):
            return "+".join(name for name in ("raw", "hfmh") if getattr(spec, name))
        settings = self.trained.get("settings")
        if isinstance(settings, dict) and settings.get("space") in BANDED:
            return str(settings["space"])
        from granular_id.spaces import USUAL_BLOCKS  # brings in scikit-learn

        left_out = [name for name in USUAL_BLOCKS if name not in spec.blocks]
        added = [name for name in spec.blocks if name not in USUAL_BLOCKS]
        return "+".join(["multiband", *added]) + "".join(f"-{name}" for name in left_out)

    @cached_property
    def temperature(self) -> float | None:
        """What class values are divided by before the softmax of probabilities; None where none were held out."""
        return Metadata(self.core).temperature

    @property
    def n_samples(self) -> int:
        """Samples T of a recording."""
        return self.core.n_samples

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the C axes."""
        return Metadata(self.core).axes

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each axis; empty where nobody stated it."""
        return tuple(Metadata(self.core).units)

    @property
    def rate_hz(self) -> float:
        """Sampling rate, Hz."""
        return self.core.rate_hz

    @property
    def lead_s(self) -> float | None:
        """Seconds of rest ahead of the trigger, where all recordings of the training had the same; else None."""
        return Metadata(self.core).lead_s

    @cached_property
    def trained(self) -> dict[str, Any]:
        """What it was trained on and how, and the estimates; empty where nothing is known."""
        return Metadata(self.core).trained

    @property
    def synthetic(self) -> bool:
        """Whether it is known to be trained on simulated recordings: its answers say nothing about real materials."""
        return bool(self.trained.get("synthetic", False))

    def scores(self, X: npt.ArrayLike, *, threads: int | None = None) -> FloatArray:
        """Scores (n, L) of the binary learners; positive speaks for the classes with code +1.

        Parameters
        ----------
        X : Dataset or array-like, shape (n, T, C) or (T, C)
            Recordings of the length, rate, axes and units of the training. Of a Dataset these are checked. Tables with
            named columns, one or a list of them, come into the order of `axes`; other names are refused.
        threads : int, optional
            Threads of a batch; the result does not depend on it. Default: all cores.

        Raises
        ------
        TypeError, ValueError
            Another shape, NaN or infinity; a `Dataset` of another rate, other axes, units or set-up.
        """
        if isinstance(X, Recording):
            raise TypeError("X must be an array or a Dataset, got a Recording: pass it to identify")
        if isinstance(X, Dataset):
            check_recordings(X, self.core)
            X = X.X
        samples, _ = samples_of(X, "X", self.axes)
        return self.core.scores(samples, threads)

    def losses(self, X: npt.ArrayLike) -> FloatArray:
        """Mean binary loss (n, K) of each class for recordings as in `scores`: the smallest wins."""
        return self.core.losses(self.scores(X))

    def decision_function(self, X: npt.ArrayLike) -> FloatArray:
        """Decision values as `ECOCClassifier.decision_function` gives them.

        Returns
        -------
        ndarray, shape (n, K), or (n,) for two classes
            Minus the mean binary loss of each class. For two classes the value of the second minus the first.
        """
        values = -self.losses(X)
        return values[:, 1] - values[:, 0] if values.shape[1] == 2 else values

    def predict(self, X: npt.ArrayLike) -> npt.NDArray[np.str_]:
        """Label (n,) of each recording as in `scores`; of tied classes the first in `classes`."""
        labels: npt.NDArray[np.str_] = np.array(self.classes)[self.losses(X).argmin(axis=1)]
        return labels

    def predict_proba(self, X: npt.ArrayLike) -> FloatArray:
        """Probability (n, K) of each class for recordings as in `scores`; rows sum to 1.

        Raises
        ------
        ValueError
            The model held no recordings out when it was trained, and knows no temperature.
        """
        shares = probabilities(self.temperature, self.losses(X))
        if shares is None:
            raise ValueError(
                "the model knows no probabilities: train it with recordings held out (estimate=True)"
            )
        return shares

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
        differences: tuple[str, ...] = ()
        if isinstance(recording, Recording):
            data = Dataset([recording])
            differences = check_recordings(data, self.core, accept)
            wrench = cropped_to_model(data, self.core, begin_at=begin_at, lead_s=lead_s)[0].wrench
        elif isinstance(recording, Dataset):
            raise TypeError(
                "recording must be one Recording or an array, got a Dataset: pass them one by one, or call predict"
            )
        else:
            wrench = np.asarray(samples_of(recording, "recording", self.axes)[0], dtype=np.float64)
            wanted = (self.n_samples, len(self.axes))
            if wrench.shape != wanted:
                raise ValueError(f"recording must have shape {wanted} as in the training, got {wrench.shape}")
        stream = _core.StreamingIdentifier(self.core)
        stream.push(wrench)
        return decision_of(stream, dict.fromkeys(differences, 0), self.temperature)

    def predict_over(
        self,
        recording: Recording | npt.ArrayLike,
        hop_s: float | None = None,
        *,
        accept: str | Sequence[str] = (),
        threads: int | None = None,
    ) -> Timeline:
        """Name the materials in a long recording: one answer for the window of the model's length at each hop.

        Parameters
        ----------
        recording : Recording, or array-like of shape (T, C)
            Of the rate and axes of the training, and at least its length. An array has that rate.
        hop_s : float, optional
            Seconds from one answer to the next, to the nearest sample. Default: the length of a window, so that none
            shares samples with another.
        accept : str or sequence of str, default ()
            As in `identify`.
        threads : int, optional
            As in `scores`.

        Returns
        -------
        Timeline
            Each answer is that about its window alone, bit for bit; memory does not grow with overlapping windows.

        Raises
        ------
        TypeError, ValueError
            As `identify`; a recording shorter than a window; a hop below one sample.

        Examples
        --------
        >>> import granular_id as gid
        >>> data = gid.synthesize(["rice", "fine sugar"], n_per_class=6, duration_s=0.5)
        >>> model = gid.Identifier.fit(data, "hfmh", estimate=False)
        >>> drive = gid.synthesize(["rice"], n_per_class=1, duration_s=3.2, seed=1)[0]
        >>> answers = model.predict_over(drive, hop_s=0.3)
        >>> len(answers), answers.times_s[:3].tolist()
        (10, [0.5, 0.8, 1.1])
        """
        from granular_id.identifier.answers import predict_over

        return predict_over(self.core, recording, hop_s, accept, threads)

    def adapt(
        self,
        recordings: Dataset,
        labels: npt.ArrayLike | None = None,
        *,
        all_materials: bool = False,
        allow_missing: bool = False,
        trained_on: Dataset | None = None,
        begin_at: Begin = "auto",
        lead_s: float | None = None,
        accept: str | Sequence[str] = (),
        threads: int | None = None,
    ) -> Identifier:
        """Return a model for another set-up (tool, mounting, zero, room), learned from recordings of it.

        One of two ways: with the labels of a few recordings of each material, or of recordings that are declared to
        hold all materials about equally.

        Parameters
        ----------
        recordings : Dataset
            Of the new set-up: with `labels` three or more, three of each material are good; with `all_materials` three
            a material or more, in the mean.
        labels : array-like of str, shape (n,), optional
            Their labels, each one that the model knows, such as ``recordings.y``. Also after `all_materials`.
        all_materials : bool, default False
            Declare that they hold all materials about equally: each feature gets mean and spread of the training, and
            self-training follows. Loses where it is not so: with half of the materials 2 to 18 points. Labels that the
            recordings have only tell the accuracy before and after.
        allow_missing : bool, default False
            With labels, go on without some of the materials. What the others show does not carry over to these.
        trained_on : Dataset, optional
            The recordings of the training, for a model that keeps nothing of it: taken over from a pipeline, or of too
            many materials; one that keeps what it needs goes by that. Other recordings are refused by a model that
            knows its own, needed or not; one that was taken over warns where it names fewer than 90 % of them rightly.
        begin_at, lead_s, accept
            As in `identify`.
        threads : int, optional
            As in `scores`.

        Returns
        -------
        Identifier
            With other weights only, so that streams, batches and Rust give the same bits. What was measured on the old
            one is dropped: estimate, early answers, candidates, refusal of unknown materials, probabilities.
            ``trained["adapted"]`` says in a line what was done. This model stays as it is.

        Raises
        ------
        TypeError
            `recordings` is not a `Dataset`.
        ValueError
            Neither labels nor `all_materials`, or both; what `identify` refuses; too few recordings; a label that the
            model does not know; materials that are missing: the message names them; with `all_materials` a model that
            was adapted before; a model that keeps nothing of its training, without `trained_on`.

        Warns
        -----
        UserWarning
            Labels are of one material, or of recordings that have trained the model before; with `all_materials`,
            labels of recordings in which some are missing; balanced accuracy fell by more than a recording; doubts
            about `trained_on`.

        Notes
        -----
        With labels the score of each pair is recentred on its own two materials, with few recordings more on all of
        them; the difference that is left to the mean scores of the training is learned by kernel ridge regression on
        standardised features, with a ridge of 0.1 of their mean squared norm; not of samples and counts. All of it is
        linear, and ends in the weights.

        With `all_materials` two rounds of self-training do the same with memberships in place of labels:
        exp(-loss / w), w = 0.15 of the median margin, over their sum. 30 steps of Sinkhorn and Knopp make the shares of
        all materials equal for recentring, one step for the regression, whose ridge is the mean squared norm.

        References
        ----------
        Equal shares: Asano et al., "Self-labelling via simultaneous clustering and representation learning" (ICLR
        2020).

        Examples
        --------
        >>> import granular_id as gid
        >>> from granular_id.synthetic import Rig
        >>> data = gid.synthesize(["rice", "fine sugar"], n_per_class=8, duration_s=0.5)
        >>> model = gid.Identifier.fit(data, "multiband")
        >>> shallow = gid.synthesize(["rice", "fine sugar"], 3, duration_s=0.5, seed=1, rig=Rig(depth_m=0.05))
        >>> new = model.adapt(shallow, shallow.y)
        >>> new.trained["adapted"][:24]
        'by 6 labelled recordings'
        >>> declared = model.adapt(shallow, all_materials=True)
        """
        from granular_id.identifier.adapt import adapted_model

        return Identifier(
            adapted_model(
                self.core,
                recordings,
                labels,
                all_materials=all_materials,
                allow_missing=allow_missing,
                trained_on=trained_on,
                begin_at=begin_at,
                lead_s=lead_s,
                accept=accept,
                threads=threads,
            )
        )

    def __repr__(self) -> str:
        on = ", trained on SYNTHETIC recordings" if self.synthetic else ""
        size = f"{self.n_samples} samples at {self.rate_hz:g} Hz"
        return f"Identifier({self.space!r}, {len(self.classes)} classes, {size}{on})"
