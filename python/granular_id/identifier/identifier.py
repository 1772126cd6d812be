"""`Identifier`: a trained model that names materials, and fits into one safe file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from granular_id import _core
from granular_id._checks import checked_flag, checked_share
from granular_id._core import GranularIdError
from granular_id._progress import ProgressCallback, Ticker, showing
from granular_id.confidence import candidate_rule, fit_temperature
from granular_id.identifier.answers import Timeline, timeline_of
from granular_id.identifier.decision import Decision, decision_of
from granular_id.identifier.early import HeldOut, OverTime, calibrate
from granular_id.identifier.model import RULES, TrainedModel, fingerprint, probabilities, stored_marks
from granular_id.recording import (
    Dataset,
    Recording,
    common_units,
    data_warnings,
    mixed_setup_warnings,
    refuse_tables,
)

# What trains and adapts is imported where it is called for: it brings in scikit-learn, for which a robot that only
# identifies does not wait.

if TYPE_CHECKING:
    from sklearn.pipeline import Pipeline

FloatArray = npt.NDArray[np.float64]


class Identifier(TrainedModel):
    """A trained model that names materials: features, linear learners, classes and metadata of the training.

    Made by `fit` or `load`. Everything that decides about an answer is in `core`, the same object
    that the Rust crate and the streaming identification use: the same labels and scores, to the last bit, from whole
    recordings and from streams.

    Parameters
    ----------
    core : granular_id._core.Model
        The model.

    Attributes
    ----------
    over_time_ : OverTime or None
        Accuracy of provisional answers against seconds of signal, and what early answers are worth, on the recordings
        that `fit` held out; None where none were, and of a model that was read from a file.
    held_ : HeldOut or None
        The answers that this and all estimates were made of.

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

    held_: HeldOut | None = None
    over_time_: OverTime | None = None

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
        from granular_id._estimators import convergence_warnings
        from granular_id._parallel import single_threaded_blas
        from granular_id.identifier import training
        from granular_id.identifier.adapt import stored_source

        shares = {"target_error": target_error, "coverage": coverage, "share_known": share_known}
        for argument, share in shares.items():
            if share is not None:
                checked_share(argument, share)
        if not isinstance(data, Dataset):
            raise TypeError(f"data must be a granular_id.Dataset, got {type(data).__name__}")
        refuses = checked_flag("estimate", estimate) and share_known is not None
        beside = training.background_of(data, background, has_use=refuses)
        units, whole = common_units(data), data
        data = data if beside is None else data[[r.label not in background for r in data]]
        split = training.split_of(data, by, random_state, estimate=estimate)
        name, pipeline = training.pipeline_of(space, data.rate_hz, threads)
        training.refuse_large(pipeline, split.n_classes, data.X)

        held = early = novelty = None
        rules: dict[str, Any] = {}
        with showing(progress or False) as callback, convergence_warnings(name) as not_converged:
            ticker = Ticker(1 + (0 if split.folds is None else len(split.folds)), callback)
            fitted = training.fit_all(pipeline, data, split.groups, random_state, threads)
            ticker.tick("all recordings")
            if split.folds is not None:
                held = training.held_out_answers(
                    pipeline, data, split.folds, seed=random_state, tick=ticker.tick, name=name
                )
        if held is not None:
            judged = held.held.values, held.truth, held.sessions
            rules["temperature"] = fit_temperature(*judged)
            early = None if target_error is None else calibrate(held, float(target_error))
            confidence: dict[str, Any] = {}
            if coverage is not None:
                confidence["candidates"] = candidate_rule(
                    fitted.plain.classes, *judged, float(coverage)
                ).to_dict()
            if share_known is not None:
                confidence["unknown"], novelty = training.refusal(
                    fitted, beside, held.held, split, float(share_known), threads
                )
            rules |= {RULES: confidence} if confidence else {}
        trained = {
            **training.described(data, name, pipeline),
            **stored_marks(whole),
            **({} if beside is None else {"background": training.counts(beside)}),
            **training.estimated(held, split.why_none),
            "early": None if early is None else early.to_dict(),
            **training.chosen(fitted, held),
            **rules,
            "left_out": getattr(fitted.pipeline[0], "dropped_", ""),
            # What may mislead a reader of the estimate.
            "notes": [
                *(mixed_setup_warnings(data) if held is None else data_warnings(data)),
                *not_converged,
            ],
            **stored_source(fitted.plain, fitted.rows, fitted.codes),
        }
        with single_threaded_blas():
            identifier = cls(
                training.model_of(
                    fitted.pipeline,
                    data,
                    samples=data.X,
                    units=units,
                    early=None if early is None else early.table(),
                    novelty=novelty,
                    trained=trained,
                    training_sha256=fingerprint(whole, trained["settings"]),
                )
            )
        if held is not None:
            identifier.held_ = held
            identifier.over_time_ = OverTime.of(held, early, synthetic=data.is_synthetic)
        return identifier

    def scores(self, X: npt.ArrayLike) -> FloatArray:
        """Scores (n, L) of the binary learners; positive speaks for the classes with code +1.

        Parameters
        ----------
        X : Dataset or array-like, shape (n, T, C) or (T, C)
            Recordings of the length, rate, axes and units of the training. Of a Dataset these are checked.

        Raises
        ------
        TypeError, ValueError
            Another shape, NaN or infinity; a `Dataset` of another rate, other axes, units or set-up.
        """
        if isinstance(X, Recording):
            raise TypeError("X must be an array or a Dataset, got a Recording: pass it to identify")
        if isinstance(X, Dataset):
            self.requirements.check(X)
            X = X.X
        refuse_tables(X, "X")
        return self.core.scores(X)

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
        shares = probabilities(self, self.losses(X))
        if shares is None:
            raise GranularIdError(
                "the model knows no probabilities: train it with recordings held out (estimate=True)"
            )
        return shares

    def identify(
        self,
        recording: Recording | npt.ArrayLike,
        *,
        accept: str | Sequence[str] = (),
    ) -> Decision:
        """Name the material of one recording.

        Parameters
        ----------
        recording : Recording, or array-like of shape (T, C)
            An array has the length, rate and axes of the training.
            A recording may be longer: then the window begins as in the training, at its trigger (less the lead) or at
            its first sample.
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
            differences = self.requirements.check(data, accept)
            wrench = self.requirements.crop(data)[0].wrench
        elif isinstance(recording, Dataset):
            raise TypeError(
                "recording must be one Recording or an array, got a Dataset: pass them one by one, or call predict"
            )
        else:
            refuse_tables(recording, "recording")
            wrench = np.asarray(recording, dtype=np.float64)
            wanted = (self.n_samples, len(self.axes))
            if wrench.shape != wanted:
                raise GranularIdError(
                    f"recording must have shape {wanted} as in the training, got {wrench.shape}"
                )
        stream = _core.StreamingIdentifier(self.core)
        stream.push(wrench)
        return decision_of(stream, self, dict.fromkeys(differences, 0))

    def predict_over(
        self,
        recording: Recording | npt.ArrayLike,
        hop_s: float | None = None,
        *,
        accept: str | Sequence[str] = (),
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
        return timeline_of(self, recording, hop_s, accept)

    def adapt(
        self,
        recordings: Dataset,
        labels: npt.ArrayLike | None = None,
        *,
        all_materials: bool = False,
        allow_missing: bool = False,
        accept: str | Sequence[str] = (),
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
        accept
            As in `identify`.

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
            was adapted before; a model whose learners are too many to keep what it needs of its training.

        Warns
        -----
        UserWarning
            Labels are of one material, or of recordings that have trained the model before; with `all_materials`,
            labels of recordings in which some are missing; balanced accuracy fell by more than a recording.

        Notes
        -----
        With labels the score of each pair is recentred on its own two materials, with few recordings more on all of
        them; the difference that is left to the mean scores of the training is learned by kernel ridge regression on
        standardised features, not of samples and counts. With `all_materials` two rounds of self-training do the same
        with memberships in place of labels, whose shares are made equal. All of it is linear, and ends in the weights.

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
        from granular_id.identifier.adapt import adapted_model, check_way

        check_way(labels, all_materials=all_materials, allow_missing=allow_missing)
        if not isinstance(recordings, Dataset):
            raise TypeError(f"recordings must be a granular_id.Dataset, got {type(recordings).__name__}")
        differences = self.requirements.check(recordings, accept)
        data = self.requirements.crop(recordings, over_all=False)
        return Identifier(adapted_model(self, data, labels, differences, allow_missing=allow_missing))
