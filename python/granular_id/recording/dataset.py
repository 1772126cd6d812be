"""``Dataset``: recordings in order, and the steps that make a uniform array of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_id._checks import FloatArray, items_of
from granular_id._core import GranularIdError
from granular_id._text import counted
from granular_id.recording.checks import CheckReport, check_recordings
from granular_id.recording.clock import MAX_GAP_S
from granular_id.recording.frames import TimeUnit, recordings_of_arrays, recordings_of_frames
from granular_id.recording.onset import FALSE_ALARM_RATE, REST_S, find_all_onsets
from granular_id.recording.payload import Payload, compensate_recordings
from granular_id.recording.recording import Recording, common_axes, common_rate, stack
from granular_id.recording.report import SESSION_MAY_BE, StepReport, subject
from granular_id.recording.resampling import resample_recordings
from granular_id.recording.steps import align_recordings, cut_windows, select_recordings, split_recordings
from granular_id.recording.summary import Summary, summarise
from granular_id.recording.wrench import tare_recordings, transform_recordings

if TYPE_CHECKING:
    from granular_id.recording.wrench import RotationLike


@dataclass(frozen=True, eq=False, repr=False)
class Dataset:
    """An ordered, frozen set of at least one recording.

    Nothing is resampled, cropped or padded unless requested: each step gives a new ``Dataset`` whose
    ``history[-1]`` prints what was done. Two data sets are equal when their recordings are; history is not
    compared.

    Parameters
    ----------
    recordings : sequence of Recording
        In the order that ``.X`` and ``.y`` will have.
    history : sequence of StepReport
        What was done to get here.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id import Dataset, Recording
    >>> long = Recording(np.zeros((5, 6)), rate_hz=500, label="rice", name="a")
    >>> short = Recording(np.ones((4, 6)), rate_hz=500, label="peas", name="b")
    >>> data = Dataset([long, short]).align(n_samples=4)
    >>> data.X.shape, data.y.tolist()
    ((2, 4, 6), ['rice', 'peas'])
    >>> data.history[-1].totals["dropped_samples"]
    1
    """

    recordings: Sequence[Recording]
    history: Sequence[StepReport] = ()

    __hash__ = None  # type: ignore[assignment]  # equality looks at the samples: hashing them would be a trap

    def __post_init__(self) -> None:
        object.__setattr__(self, "recordings", items_of("recordings", self.recordings, Recording))
        object.__setattr__(self, "history", items_of("history", self.history, StepReport))
        if not self.recordings:
            raise GranularIdError("recordings is empty; a Dataset holds at least one recording")

    def _after(self, step: tuple[Sequence[Recording], StepReport]) -> Dataset:
        recordings, report = step
        return Dataset(recordings, (*self.history, report))

    # -- what is in it

    @cached_property
    def X(self) -> FloatArray:  # noqa: N802  # the name that scikit-learn gives it
        """Samples, shape (n, T, C), read-only; made once and cached (after ``align`` without a copy).

        Raises
        ------
        ValueError
            When recordings are irregular or differ in rate, length or axes, naming the method that helps.
        """
        return stack(self.recordings)

    @property
    def rate_hz(self) -> float:
        """The sampling rate all recordings share, Hz; ValueError naming ``.resample`` when there is none."""
        return common_rate(self.recordings)

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the C axes all recordings share; ValueError naming ``.select(axes=...)`` when they do not."""
        return common_axes(self.recordings)

    @property
    def y(self) -> NDArray[np.str_]:
        """Labels, shape (n,); ValueError naming the first recording without one."""
        without = [r.name for r in self.recordings if r.label is None]
        if without:
            raise GranularIdError(f"{subject(len(without))} no label, the first is {without[0]!r}")
        return np.array([r.label for r in self.recordings], dtype=np.str_)

    @property
    def labels(self) -> tuple[str, ...]:
        """The labels that occur, sorted, each once."""
        return tuple(sorted({r.label for r in self.recordings if r.label is not None}))

    @property
    def sessions(self) -> NDArray[np.object_]:
        """Sessions, shape (n,), dtype object: str, or None where the session is not known."""
        return np.array([r.session for r in self.recordings], dtype=object)

    @property
    def is_synthetic(self) -> bool:
        """Whether any recording was simulated rather than measured."""
        return any(r.is_synthetic for r in self.recordings)

    @property
    def start_times(self) -> FloatArray:
        """Times of the first samples, seconds since 1970, shape (n,); NaN where unknown."""
        return np.array([np.nan if r.start_time is None else r.start_time for r in self.recordings])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the recordings, in order."""
        return tuple(r.name for r in self.recordings)

    @classmethod
    def concatenate(cls, datasets: Sequence[Dataset]) -> Dataset:
        """Put data sets one after the other, keeping all their histories."""
        parts = items_of("datasets", datasets, Dataset)
        report = StepReport("concatenate", totals={"recordings": [len(d) for d in parts]})
        history = [step for d in parts for step in d.history]
        return cls([r for d in parts for r in d.recordings], (*history, report))

    @classmethod
    def from_arrays(
        cls,
        X: ArrayLike | Sequence[ArrayLike],
        y: ArrayLike | Sequence[str] | None = None,
        rate_hz: float | None = None,
        *,
        sessions: ArrayLike | Sequence[str] | None = None,
        names: Sequence[str] | None = None,
        axes: str | Sequence[str] | None = None,
        units: str | Sequence[str] | None = None,
    ) -> Dataset:
        """Make a data set of arrays.

        Parameters
        ----------
        X : array_like, shape (n, T, C), or sequence of array_like, shape (T, C)
            Samples: recordings, samples, axes; fx fy fz in N and tx ty tz in N m unless `axes` or `units` say
            otherwise. Rows that are NaN in all axes are missing samples: at the end of a recording they are padding,
            elsewhere they leave a gap. One array whose recordings end in different numbers of rows of zeros is
            refused, as it was padded; in a list zeros are samples.
        y : sequence of str or numbers, length n, optional
            Labels; None where one is unknown.
        rate_hz : float
            Sampling rate, Hz.
        sessions : sequence of str or numbers, length n, optional
            What was recorded in one go.
        names : sequence of str, length n, optional
            How reports call the recordings.
        axes : str or sequence of str, optional
            Names of the C columns; needed unless they are fx fy fz tx ty tz.
        units : str or sequence of str, optional
            Units of the axes: one for all, one an axis, or one for each three axes (``"N,Nm"``). Forces and torques
            are converted to N and N m; others stand in ``meta["units"]``.

        Returns
        -------
        Dataset

        Raises
        ------
        TypeError, ValueError
            Naming the argument, what came and what is wanted.

        Examples
        --------
        >>> import numpy as np
        >>> from granular_id import Dataset
        >>> data = Dataset.from_arrays(np.zeros((2, 1600, 6)), ["rice", "peas"], rate_hz=500, sessions=["a", "a"])
        >>> data.X.shape, data.y.tolist()
        ((2, 1600, 6), ['rice', 'peas'])
        """
        if rate_hz is None:
            raise GranularIdError("rate_hz is missing; wanted the sampling rate in Hz, as in rate_hz=500")
        of_recordings = {"y": y, "sessions": sessions, "names": names}
        recordings, report = recordings_of_arrays(X, of_recordings, rate_hz, axes, units)
        return cls(recordings, (report,))

    @classmethod
    def from_frames(
        cls,
        frames: Any,
        labels: ArrayLike | Sequence[str] | None = None,
        *,
        time: str | None = None,
        axes: str | Sequence[str] | None = None,
        id: str | None = None,  # noqa: A002 (what the column is called)
        label: str | None = None,
        session: str | None = None,
        sessions: ArrayLike | Sequence[str] | None = None,
        names: Sequence[str] | None = None,
        units: str | Sequence[str] | None = None,
        rate_hz: float | None = None,
        time_unit: TimeUnit | None = None,
    ) -> Dataset:
        """Make a data set of tables: of pandas, polars or pyarrow, or dicts of columns.

        Columns are found by the names that `granular_id.load` knows in files; what is not read is noted.

        Parameters
        ----------
        frames : table or sequence of tables
            One table a recording, a row a sample; or one table of many recordings, which a column tells apart.
        labels : sequence of str or numbers, optional
            Label of each table; of one table with a column of labels see `label`.
        time : str, optional
            Column of the clock, or name of the index: seconds (or `time_unit`), dates, or texts of dates. By default
            ``time``, ``t``, ``timestamp`` ..., or an index of dates.
        axes : str or sequence of str, optional
            Columns that are the axes, in this order. By default fx fy fz tx ty tz, by any of their names.
        id, label, session : str, optional
            Columns of what tells recordings apart, and of label and session. By default ``recording``, ``trial`` or
            ``id``; ``label``, ``material`` or ``class``; ``session``.
        sessions, names : sequence, optional
            Session and name of each table.
        units : str or sequence of str, optional
            Units of the axes where neither their names, ``attrs["units"]`` of pandas nor the metadata of a pyarrow
            field (``unit``) state them, as in `from_arrays`.
        rate_hz : float, optional
            Sampling rate where there is no clock, or one that stamps come in packets by.
        time_unit : {"s", "ms", "us", "ns", "sample"}, optional
            What stamps count; seconds by default.

        Returns
        -------
        Dataset

        Raises
        ------
        TypeError, ValueError
            Naming the table, row and column.

        Examples
        --------
        >>> import numpy as np
        >>> from granular_id import Dataset
        >>> columns = {axis: np.zeros(4) for axis in ("fx", "fy", "fz", "tx", "ty", "tz")}
        >>> data = Dataset.from_frames([{"t": np.arange(4) / 500, **columns}], ["rice"], time="t")
        >>> data[0]
        Recording('recording 1', label='rice', 4 samples at 500 Hz)
        """
        of_tables = {"labels": labels, "sessions": sessions, "names": names}
        columns = {"time": time, "id": id, "label": label, "session": session}
        recordings, report = recordings_of_frames(frames, of_tables, columns, axes, units, rate_hz, time_unit)
        return cls(recordings, (report,))

    # -- the steps that make a uniform array of it

    def select(
        self,
        labels: str | Sequence[str] | None = None,
        sessions: str | Sequence[str] | None = None,
        indices: ArrayLike | None = None,
        *,
        axes: Sequence[str] | None = None,
    ) -> Dataset:
        """Keep the recordings that meet every condition given, and of their axes those named.

        Parameters
        ----------
        labels, sessions : str or sequence of str, optional
            Labels and sessions to keep; one that does not occur is a ValueError.
        indices : array_like of int or bool, optional
            Recordings to keep, in this order (int), or a mask, shape (n,), as in
            ``data[[r.meta["speed_m_s"] < 0.05 for r in data]]``.
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
        return self._after(select_recordings(self.recordings, labels, sessions, indices, axes))

    def resample(
        self,
        rate_hz: float,
        *,
        max_gap_s: float | None = MAX_GAP_S,
        on_gap: Literal["raise", "skip"] = "raise",
    ) -> Dataset:
        """Bring every recording to one uniform rate.

        Recordings already at `rate_hz` stay as they are. New samples stand at k / `rate_hz` from the first
        sample to the last; none is extrapolated. Those strictly inside a gap (a step longer than twice the
        recording's median step and twice the new step) get ``SampleFlag.GAP_FILLED``; flags of the neighbours
        carry over.

        To a rate that is higher than a recording's own on average, or less than 5 % lower, straight lines are drawn
        between its samples (as ``numpy.interp``). To a lower one it first goes through a low-pass, which takes off
        40 dB or more from 1.05 times half the new rate on, and delays nothing: what lies there would come out as
        another frequency. Irregular recordings are put on even steps before, as a signal without frequencies above half
        of their rate: with stamps that are off by a tenth of a step the 40 dB hold up to 0.48 of the rate on average.
        Where stamps come in bursts lines are drawn, and a note says that frequencies cannot be distinguished.

        Parameters
        ----------
        rate_hz : float
            The new rate, Hz.
        max_gap_s : float or None
            Longest gap that is interpolated over; 0.25 s by default, in which the paper's tool moves 7.5 mm,
            less than half its width. None: no limit.
        on_gap : {"raise", "skip"}
            What to do with a recording whose gap is longer: refuse, or leave it out and say so. :meth:`split` makes a
            recording of each stretch between such gaps.

        Returns
        -------
        Dataset
            ``history[-1]`` counts old, new and made-up samples, and names each recording resampled or left out.

        Raises
        ------
        ValueError
            Bad settings, a gap beyond the limit (with recording and place).

        Examples
        --------
        >>> import numpy as np
        >>> from granular_id import Dataset, Recording
        >>> tone = np.sin(2 * np.pi * 400 * np.arange(2000) / 1000)           # would be one of 100 Hz
        >>> data = Dataset([Recording(tone[:, None], rate_hz=1000, axes=["fz"])]).resample(500)
        >>> bool(abs(data.X[:, 20:-20]).max() < 0.01)
        True
        """
        return self._after(resample_recordings(self.recordings, rate_hz, max_gap_s, on_gap))

    def split(self, gap_s: float) -> Dataset:
        """Make a recording of each stretch between gaps, as of a log with pauses.

        A stretch keeps label, session, metadata, and the flags and trigger that lie in it; `start_time` moves along,
        and its name says from which second of the recording on it is. One whose stamps are even is uniform.

        Parameters
        ----------
        gap_s : float
            A longer step between two samples is a gap, seconds.

        Returns
        -------
        Dataset
            ``history[-1]`` says into how many stretches each recording was split; those without a gap stay as they are.

        Raises
        ------
        TypeError, ValueError
            `gap_s` that is not positive.

        Examples
        --------
        >>> import numpy as np
        >>> from granular_id import Dataset, Recording
        >>> time_s = np.r_[np.arange(100), 900 + np.arange(50)] / 100
        >>> log = Recording(np.zeros((150, 6)), time_s=time_s, label="rice", name="log")
        >>> [str(stretch) for stretch in Dataset([log]).split(1.0)][1]
        "Recording('log @ 9 s', label='rice', 50 samples at 100 Hz)"
        """
        return self._after(split_recordings(self.recordings, gap_s))

    def align(
        self,
        n_samples: int | Literal["shortest"] | None = None,
        *,
        duration_s: float | None = None,
        trigger: Literal["recorded"] | None = None,
        lead_s: float = 0.0,
        on_short: Literal["raise", "skip"] = "raise",
    ) -> Dataset:
        """Crop every recording to the same number of samples.

        Parameters
        ----------
        n_samples : int or "shortest", optional
            Samples to keep, or as many as the shortest recording offers.
        duration_s : float, optional
            The same in seconds (n = round(duration_s * rate)); exactly one of the two is given.
        trigger : {None, "recorded"}
            Where to begin: at the first sample, or at each recording's `trigger_index`.
        lead_s : float
            Seconds to include ahead of the trigger.
        on_short : {"raise", "skip"}
            What to do with a recording that is too short or, with ``trigger="recorded"``, has no trigger: refuse, or
            leave it out and say so. Never padded. :meth:`find_onsets` finds triggers, or takes yours.

        Returns
        -------
        Dataset
            ``history[-1]`` counts what was dropped, and names each recording cropped or left out.

        Raises
        ------
        ValueError
            Bad settings, no common rate (resample first), a recording too short, a missing trigger.
        """
        return self._after(
            align_recordings(self.recordings, n_samples, duration_s, trigger, lead_s, on_short)
        )

    def windows(
        self,
        duration_s: float,
        hop_s: float | None = None,
        *,
        on_short: Literal["raise", "skip"] = "raise",
    ) -> Dataset:
        """Cut every recording into windows of one length, each a recording of its own.

        What is left at the end of a recording, shorter than a window, is dropped and counted, as is a window without a
        measured sample, all of it filled in a gap when it was resampled. A window keeps label, session, metadata, and
        the flags and trigger that lie in it; `start_time` moves along, and ``meta["window"]`` says of which recording
        it is and from which second on. Where halves in time are held out, windows of one recording are on one side;
        random folds part those that share no samples.

        Parameters
        ----------
        duration_s : float
            Length of a window, seconds (n = round(duration_s * rate) samples).
        hop_s : float, optional
            From the beginning of one window to that of the next, seconds. Default: `duration_s`, so that they lie
            side by side.
        on_short : {"raise", "skip"}
            What to do with a recording that is shorter than a window: refuse, or leave it out and say so.

        Returns
        -------
        Dataset
            ``history[-1]`` counts the windows and the samples dropped of each recording.

        Raises
        ------
        ValueError
            Bad settings, no common rate (resample first), a recording too short.

        Examples
        --------
        >>> import numpy as np
        >>> from granular_id import Dataset, Recording
        >>> drive = Recording(np.zeros((500, 2)), rate_hz=100, label="gravel", name="drive_1", axes=("wx", "ax"))
        >>> windows = Dataset([drive]).windows(1.7)
        >>> windows.X.shape, windows.names[1]
        ((2, 170, 2), 'drive_1 @ 1.7 s')
        """
        return self._after(cut_windows(self.recordings, duration_s, hop_s, on_short))

    def find_onsets(
        self,
        *,
        rest_s: float = REST_S,
        false_alarm_rate: float = FALSE_ALARM_RATE,
        overrule: Mapping[str, float | None] | None = None,
        replace: bool = False,
    ) -> Dataset:
        """Set each recording's `trigger_index` to where its motion begins, found from the wrench alone.

        The first `rest_s` seconds are taken for rest. A change is found where neighbouring windows, a fifth of that
        long, differ by more than windows at rest do, by a quantile of Student's t; then the sample at which the change
        began is estimated by fitting a jump, a straight or a quadratic rise. Nothing has to be known about the noise:
        it may be autocorrelated, filtered, quantised or drift, as long as it stays what it was at rest. Where a sensor
        is slower than its messages, which then repeat its readings, the rest must hold five of these.
        ``.align(trigger="recorded", lead_s=0.1, n_samples=...)`` then cuts all recordings to the same lead, as the
        paper's are.

        Parameters
        ----------
        rest_s : float, default 0.1
            Seconds at the start of each recording that are known to be at rest; at least 5 samples. The longer, the
            smaller and the slower a change can be found.
        false_alarm_rate : float, default 0.001
            Probability that a recording without any motion gets an onset: per recording, not per sample or axis. It is
            approximate, and lower in most simulated noises.
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

        Examples
        --------
        >>> import numpy as np
        >>> from granular_id import Dataset
        >>> force = np.random.default_rng(0).normal(0, 0.02, (2, 1600, 6))    # N, at rest
        >>> load = 2 * (1 - np.exp(-np.arange(1520) / 15))                    # motion from 0.16 s on, of one of them
        >>> force[0, 80:, [0, 4]] += np.outer([1, 0.1], load)                 # N, N m
        >>> found = Dataset.from_arrays(force, rate_hz=500).find_onsets()
        >>> [recording.trigger_index for recording in found]
        [79, None]
        >>> found.history[-1].rows[0]["why"]
        'no change stands out from the noise of the first 0.1 s'
        """
        return self._after(find_all_onsets(self.recordings, rest_s, false_alarm_rate, overrule, replace))

    # -- the wrench itself: frame, weight of the tool, zero

    def transform(
        self,
        rotation: RotationLike | None = None,
        translation: ArrayLike = (0.0, 0.0, 0.0),
        *,
        frame: str | None = None,
        flip: Sequence[str] = (),
        sign: str | None = None,
    ) -> Dataset:
        """Give all recordings in another frame: ``F' = R F``, ``T' = R T + p x R F``.

        Parameters
        ----------
        rotation : scipy Rotation, array_like of shape (3, 3) or (4,), optional
            Turns components in the old frame into those in the new one: a proper rotation, as a matrix or a quaternion
            (x, y, z, w). Default: none.
        translation : array_like, shape (3,)
            Position of the old origin in the new frame, m. Default: the same origin.
        frame : str, optional
            Name of the new frame, put into the metadata: models compare it (`Setup`). Wanted where the wrench is
            turned or moved; alone it renames.
        flip : sequence of str, default none
            Axes whose sign changes before that, such as ``("fx", "tx")`` of a driver that mirrors them. Gravity in the
            metadata is left out, as where the wrench is turned.
        sign : str, optional
            Where all six are flipped: whose force on whom it is then, in the words of the model's training; put into
            the metadata.

        Returns
        -------
        Dataset

        Raises
        ------
        TypeError, ValueError
            As :func:`granular_id.recording.transform`; recordings that are no wrench in N and N m; a turn of recordings
            that are of several frames, or of `frame` already, by their metadata, as of their signs with `sign`.

        Examples
        --------
        >>> from scipy.spatial.transform import Rotation
        >>> from granular_id import synthesize
        >>> data = synthesize(["rice"], n_per_class=1)
        >>> turned = data.transform(Rotation.from_euler("z", 90, degrees=True), frame="flange")
        >>> bool(abs(turned.X[..., 1] - data.X[..., 0]).max() < 1e-12), turned[0].meta["frame"]
        (True, 'flange')
        >>> mirrored = data.transform(flip=("fx", "tx"))
        >>> bool((mirrored.X[..., 0] == -data.X[..., 0]).all())
        True
        """
        return self._after(transform_recordings(self.recordings, rotation, translation, frame, flip, sign))

    def compensate(self, payload: Payload, gravity: ArrayLike | Sequence[ArrayLike] | None = None) -> Dataset:
        """Take weight and zero of a payload off all recordings, before :meth:`transform` and :meth:`tare`.

        Parameters
        ----------
        payload : Payload
        gravity : array_like, shape (3,), or sequence of them, optional
            Direction of gravity in the frame of the wrench, of any length: one for all recordings, or one entry a
            recording, of shape (3,), or (T, 3) where the sensor turns within it. Default: what their metadata say.

        Returns
        -------
        Dataset
            Their metadata say ``compensated`` and the ``payload``.

        Raises
        ------
        TypeError, ValueError
            Recordings that are no wrench in N and N m, are compensated or tared already, or state another frame or sign
            than the payload; a direction of gravity that is missing, or none.

        Examples
        --------
        >>> from granular_id.recording import Payload
        >>> from granular_id import synthesize
        >>> data = synthesize(["rice"], n_per_class=2)                        # z points down
        >>> lighter = data.compensate(Payload(0.3, (0, 0, 0.05)), gravity=[0, 0, 1])
        >>> float((data.X - lighter.X)[0, 0, 2].round(3)), lighter[0].meta["payload"]
        (2.942, '0.3 kg')
        """
        return self._after(compensate_recordings(self.recordings, payload, gravity))

    def tare(self, *, lead_s: float | None = None) -> Dataset:
        """Take the rest before the motion for zero: subtract from each recording the mean of its own lead.

        Of each recording the samples within `lead_s` before its `trigger_index` are averaged, and the mean is
        subtracted from all its samples. ``meta["tare"]`` becomes ``"rest"``. A trigger by force comes after the motion
        has begun: put it where the motion begins by ``.find_onsets(replace=True)`` before.

        Parameters
        ----------
        lead_s : float, optional
            Seconds at rest before the trigger. Default: of each recording the rest that it has, 0.1 s at least and the
            last 2 s at most. A longer rest gives a better zero, and beyond 2 s the zero has wandered.

        Returns
        -------
        Dataset
            ``history[-1]`` has the zero of each recording, and how long its rest was.

        Raises
        ------
        TypeError, ValueError
            Recordings without a trigger, with too short a rest before it, or irregularly sampled.

        Examples
        --------
        >>> from granular_id import synthesize
        >>> tared = synthesize(["rice"], n_per_class=1).tare()
        >>> n = tared[0].trigger_index
        >>> bool(abs(tared[0].wrench[:n].mean(axis=0)).max() < 1e-12), tared[0].meta["tare"]
        (True, 'rest')
        """
        return self._after(tare_recordings(self.recordings, lead_s))

    # -- looking at it

    def summary(self) -> Summary:
        """Count recordings, lengths, rates, sessions and flags per label; ``print`` it."""
        return summarise(self.recordings)

    def check(self) -> CheckReport:
        """Look for what would spoil an evaluation: ``print`` it.

        Each statistical check (leaks, outliers, clipping) suspects one sound data set in a hundred.

        Returns
        -------
        CheckReport
            A sequence of findings, worst first, with ``.states`` of recordings and ``.worst``; empty when
            nothing was found.
        """
        notes = [note for step in self.history for note in step.notes if note.startswith(SESSION_MAY_BE)]
        return check_recordings(self.recordings, notes[0].partition(": ")[2] if notes else "")

    def __add__(self, other: Dataset) -> Dataset:
        return Dataset.concatenate([self, other]) if isinstance(other, Dataset) else NotImplemented

    def __len__(self) -> int:
        return len(self.recordings)

    def __iter__(self) -> Iterator[Recording]:
        return iter(self.recordings)

    @overload
    def __getitem__(self, index: int) -> Recording: ...
    @overload
    def __getitem__(self, index: slice | Sequence[int] | NDArray[Any]) -> Dataset: ...
    def __getitem__(self, index: Any) -> Recording | Dataset:
        if isinstance(index, (int, np.integer)) and not isinstance(index, bool):
            return self.recordings[int(index)]
        if index is None:
            raise TypeError("indices must be int, a slice, a list of int or a mask, got None")
        return self.select(indices=np.arange(len(self))[index] if isinstance(index, slice) else index)

    def __eq__(self, other: object) -> bool:
        return self.recordings == other.recordings if isinstance(other, Dataset) else NotImplemented

    def __repr__(self) -> str:
        rates = {r.rate_hz for r in self.recordings}
        rate = next(iter(rates)) if len(rates) == 1 else None
        shared = "no common rate" if rate is None else f"{rate:g} Hz"
        return f"Dataset({counted(len(self))}, {counted(len(self.labels), 'label')}, {shared})"

    def __reduce__(self) -> tuple[Any, ...]:
        return (Dataset, (self.recordings, self.history))  # without the cached X, which would be sent twice
