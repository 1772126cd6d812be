"""What every `Identifier` can do about another set-up; the work is in `adapt.py`, which brings in scikit-learn."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from granular_id import _core
from granular_id.identifier.metadata import HISTORY, Begin, Metadata
from granular_id.recording import Dataset

if TYPE_CHECKING:
    from typing_extensions import Self

    from granular_id.identifier.adapt import Adaptation


class Adaptable:
    """A model that can be brought to another set-up: methods of `Identifier`."""

    core: _core.Model

    if TYPE_CHECKING:

        def __init__(self, core: _core.Model | None = None) -> None: ...

    def adapt(
        self,
        recordings: Dataset,
        *,
        all_materials: bool = False,
        rounds: int | None = None,
        trained_on: Dataset | None = None,
        begin_at: Begin = "auto",
        lead_s: float | None = None,
        accept: str | Sequence[str] = (),
        threads: int | None = None,
    ) -> Self:
        """Return a model for another set-up (tool, mounting, zero, room), learned from recordings of it without labels.

        Parameters
        ----------
        recordings : Dataset
            Three or more of the new set-up, of whichever of the materials: better of many than many of one, whose
            own signal cannot be told from that of the set-up. Labels are only used to tell the accuracy before and
            after.
        all_materials : bool, default False
            Declare that they hold all materials about equally: each feature gets mean and spread of the training, and
            two rounds of self-training follow. Gains more than the default, and loses where it is not so: with half
            of the materials 2 to 18 points. By default a common offset of the scores is taken away, which costs
            nothing in the mean with any shares of three materials or more.
        rounds : int, optional
            Rounds of self-training. Default: 2 with `all_materials`, else 0.
        trained_on : Dataset, optional
            The recordings of the training, for a model that keeps nothing of it: of an earlier version, or taken over
            from a pipeline; one that keeps what it needs goes by that. Other recordings are refused by a model that
            knows its own, needed or not; one that was taken over warns where it names fewer than 90 % of them rightly.
        begin_at, lead_s, accept
            As in `identify`.
        threads : int, optional
            As in `scores`.

        Returns
        -------
        Self
            With other weights only, so that streams, batches and Rust give the same bits. What was measured on the old
            one is dropped: estimate, early answers, candidates, refusal of unknown materials, probabilities. Its
            `adaptations` end with what was done. This model stays as it is.

        Raises
        ------
        TypeError
            `recordings` is not a `Dataset`.
        ValueError
            What `identify` refuses; fewer than three recordings; with `all_materials` fewer than three a material, in
            the mean, or a model that was adapted before; a model that keeps nothing of its training, without
            `trained_on`.

        Warns
        -----
        UserWarning
            All recordings are of one material; with `all_materials`, labels in which some are missing; balanced
            accuracy fell by more than a recording; doubts about `trained_on`.

        Notes
        -----
        The method is that of `BestClassifier.adapt`. With samples and counts as features three
        more recordings of each material are added that ask for no offset, since they name too few materials rightly.

        Examples
        --------
        >>> import granular_id as gid
        >>> from granular_id.synthetic import Rig
        >>> data = gid.synthesize(["rice", "fine sugar"], n_per_class=8, duration_s=0.5)
        >>> model = gid.Identifier.fit(data, "multiband")
        >>> shallow = gid.synthesize(["rice", "fine sugar"], 6, duration_s=0.5, seed=1, rig=Rig(depth_m=0.05))
        >>> new = model.adapt(shallow)
        >>> new.adaptations[-1].method, new.adaptations[-1].n_recordings
        ('balanced shift', 12)
        """
        from granular_id.identifier.adapt import adapted_model

        return type(self)(
            adapted_model(
                self.core,
                recordings,
                all_materials=all_materials,
                rounds=rounds,
                trained_on=trained_on,
                begin_at=begin_at,
                lead_s=lead_s,
                accept=accept,
                threads=threads,
            )
        )

    def recalibrate(
        self,
        labelled: Dataset,
        *,
        allow_missing: bool = False,
        trained_on: Dataset | None = None,
        begin_at: Begin = "auto",
        lead_s: float | None = None,
        accept: str | Sequence[str] = (),
        threads: int | None = None,
    ) -> Self:
        """Return a model for another set-up, learned from a few labelled recordings of each material; three are good.

        Parameters
        ----------
        labelled : Dataset
            Recordings of the new set-up, each with a label that the model knows. Also after `adapt`.
        allow_missing : bool, default False
            Go on without some of the materials. What the others show does not carry over to these.
        trained_on, begin_at, lead_s, accept, threads
            As in `adapt`.

        Returns
        -------
        Self
            As of `adapt`.

        Raises
        ------
        TypeError, ValueError
            As `adapt`; recordings without a label, or with one that the model does not know; materials that are
            missing: the message names them.

        Warns
        -----
        UserWarning
            As `adapt`; some of the recordings have trained or recalibrated the model before.

        Notes
        -----
        The method is that of `BestClassifier.recalibrate`, with samples and counts as features
        without its regression.

        Examples
        --------
        >>> import granular_id as gid
        >>> from granular_id.synthetic import Rig
        >>> data = gid.synthesize(["rice", "fine sugar"], n_per_class=8, duration_s=0.5)
        >>> model = gid.Identifier.fit(data, "multiband")
        >>> shallow = gid.synthesize(["rice", "fine sugar"], 3, duration_s=0.5, seed=1, rig=Rig(depth_m=0.05))
        >>> model.recalibrate(shallow).adaptations[-1].materials
        {'fine sugar': 3, 'rice': 3}
        """
        from granular_id.identifier.adapt import recalibrated_model

        return type(self)(
            recalibrated_model(
                self.core,
                labelled,
                allow_missing=allow_missing,
                trained_on=trained_on,
                begin_at=begin_at,
                lead_s=lead_s,
                accept=accept,
                threads=threads,
            )
        )

    @property
    def adaptations(self) -> tuple[Adaptation, ...]:
        """How it was brought to other set-ups, the latest last; empty of a model as it was trained."""
        stored = Metadata(self.core).trained.get(HISTORY)
        if not stored:
            return ()
        from granular_id.identifier.adapt import Adaptation

        return tuple(map(Adaptation.from_dict, stored))
