"""The steps that make a uniform array of recordings: select, resample, find onsets, align."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Literal, TypeVar

from numpy.typing import ArrayLike

from granular_id.recording.alignment import align_recordings
from granular_id.recording.one import Recording
from granular_id.recording.onset.find import FALSE_ALARM_RATE, REST_S
from granular_id.recording.onset.step import find_all_onsets
from granular_id.recording.report import StepReport
from granular_id.recording.resampling import MAX_GAP_S, Method, resample_recordings
from granular_id.recording.selection import select_recordings
from granular_id.recording.stacking import common_rate

D = TypeVar("D", bound="DatasetSteps")


class DatasetSteps:
    """What can be done to a :class:`Dataset`: each step gives a new one whose ``history[-1]`` reports it."""

    recordings: Sequence[Recording]
    history: Sequence[StepReport]

    def _after(self: D, recordings: Sequence[Recording], report: StepReport) -> D:
        raise NotImplementedError

    def select(
        self: D,
        labels: str | Sequence[str] | None = None,
        sessions: str | Sequence[str] | None = None,
        indices: ArrayLike | None = None,
        *,
        names: str | Sequence[str] | None = None,
        where: Callable[[Recording], bool] | None = None,
        axes: Sequence[str] | None = None,
    ) -> D:
        """Keep the recordings that meet every condition given, and of their axes those named.

        Parameters
        ----------
        labels, sessions : str or sequence of str, optional
            Labels and sessions to keep; one that does not occur is a ValueError.
        indices : array_like of int or bool, optional
            Recordings to keep, in this order (int), or a mask, shape (n,).
        names : str or sequence of str, optional
            Names of the recordings to keep; one that does not occur is a ValueError.
        where : callable, optional
            Gets a recording and says whether it is kept: ``lambda r: r.meta["speed_m_s"] < 0.05``.
        axes : sequence of str, optional
            Axes to keep, in this order.

        Returns
        -------
        Dataset

        Raises
        ------
        TypeError, ValueError, IndexError
            Indices that are none, or out of range; a label or session that does not occur; nothing left.
        """
        kept, report = select_recordings(
            self.recordings, labels, sessions, indices, names=names, where=where, axes=axes
        )
        return self._after(kept, report)

    def resample(
        self: D,
        rate_hz: float,
        method: Method = "linear",
        *,
        max_gap_s: float | None = MAX_GAP_S,
        on_gap: Literal["raise", "skip"] = "raise",
    ) -> D:
        """Bring every recording to one uniform rate.

        Recordings already at `rate_hz` stay as they are. New samples stand at k / `rate_hz` from the first
        sample to the last; none is extrapolated. Those strictly inside a gap (a step longer than twice the
        recording's median step and twice the new step) get ``SampleFlag.GAP_FILLED``; flags of the neighbours
        carry over.

        Parameters
        ----------
        rate_hz : float
            The new rate, Hz.
        method : {"linear", "polyphase"}
            ``"linear"``: straight lines between samples (as ``numpy.interp``), for any stamps; it does not
            filter, so content above half the new rate folds back. ``"polyphase"``:
            ``scipy.signal.resample_poly`` with its anti-alias filter (zero phase) and straight-line padding;
            uniform input and a rational ratio only.
        max_gap_s : float or None
            Longest gap that is interpolated over; 0.25 s by default, in which the paper's tool moves 7.5 mm,
            less than half its width. None or infinity: no limit.
        on_gap : {"raise", "skip"}
            What to do with a recording whose gap is longer: refuse, or leave it out and say so.

        Returns
        -------
        Dataset
            ``history[-1]`` counts old, new and made-up samples, and names each recording resampled or left out.

        Raises
        ------
        ValueError
            Bad settings, a gap beyond the limit (with recording and place), polyphase on irregular input.
        """
        results, report = resample_recordings(
            self.recordings, rate_hz, method=method, max_gap_s=max_gap_s, on_gap=on_gap
        )
        return self._after(results, report)

    def align(
        self: D,
        n_samples: int | Literal["shortest"] | None = None,
        *,
        duration_s: float | None = None,
        trigger: Literal["recorded"] | Sequence[int] | None = None,
        lead_s: float = 0.0,
        on_short: Literal["raise", "skip"] = "raise",
        on_missing: Literal["raise", "skip"] = "raise",
    ) -> D:
        """Crop every recording to the same number of samples.

        Parameters
        ----------
        n_samples : int or "shortest", optional
            Samples to keep, or as many as the shortest recording offers.
        duration_s : float, optional
            The same in seconds (n = round(duration_s * rate)); exactly one of the two is given.
        trigger : None, "recorded" or sequence of int
            Where to begin: at the first sample, at each recording's `trigger_index`, or at these indices,
            shape (n,).
        lead_s : float
            Seconds kept ahead of the trigger.
        on_short : {"raise", "skip"}
            What to do with a recording that is too short: refuse, or leave it out and say so. Never padded.
        on_missing : {"raise", "skip"}
            What to do, with ``trigger="recorded"``, with a recording that has no trigger: refuse (naming some),
            or leave it out and say so. :meth:`find_onsets` finds triggers, or takes yours.

        Returns
        -------
        Dataset
            ``history[-1]`` counts what was dropped, and names each recording cropped or left out.

        Raises
        ------
        ValueError
            Bad settings, no common rate (resample first), a recording too short, a missing trigger.
        """
        cropped, report = align_recordings(
            self.recordings,
            common_rate(self.recordings),
            n_samples=n_samples,
            duration_s=duration_s,
            trigger=trigger,
            lead_s=lead_s,
            on_short=on_short,
            on_missing=on_missing,
        )
        return self._after(cropped, report)

    def find_onsets(
        self: D,
        *,
        rest_s: float = REST_S,
        false_alarm_rate: float = FALSE_ALARM_RATE,
        overrule: Mapping[str, float | None] | None = None,
        replace: bool = False,
    ) -> D:
        """Set each recording's `trigger_index` to where its motion begins, found from the wrench alone.

        See :func:`granular_id.recording.onset.find_onset` for the method. ``.align(trigger="recorded",
        lead_s=0.1, n_samples=...)`` then cuts all recordings to the same lead, as the paper's are.

        Parameters
        ----------
        rest_s : float, default 0.1
            Seconds at the start of each recording that are known to be at rest; at least 5 samples.
        false_alarm_rate : float, default 0.001
            Probability, at most, that a recording without any motion gets an onset.
        overrule : mapping of str to float or None, optional
            Onsets that you know better, by name of the recording: seconds from its first sample, or None for no
            onset. They also replace a trigger that was recorded.
        replace : bool, default False
            Whether recordings that already have a `trigger_index` get a new one (or none, where none is found).

        Returns
        -------
        Dataset
            ``history[-1]`` says for each recording how its onset came about, or why there is none.

        Raises
        ------
        TypeError, ValueError
            Bad settings, a name that no recording or more than one has, a time outside the recording, and
            irregular recordings, which must be resampled (or overruled) first.
        """
        results, report = find_all_onsets(
            self.recordings,
            rest_s=rest_s,
            false_alarm_rate=false_alarm_rate,
            overrule=overrule,
            replace_recorded=replace,
        )
        return self._after(results, report)
