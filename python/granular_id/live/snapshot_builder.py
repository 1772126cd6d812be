"""From the rows of a stream to the snapshots that views show."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from granular_id._checks import argument_error, as_floats, finite_number, whole_number
from granular_id._core import AXES, UNITS, StreamingExtractor
from granular_id.features import FeatureSpec
from granular_id.live.snapshot import Outcome, Snapshot, ranking_span_s
from granular_id.signal import butter, sosfilt, sosfilt_zi

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from granular_id.identifier import Decision
    from granular_id.live.capture import Push
    from granular_id.live.rows import BlockLike

__all__ = ["SnapshotBuilder"]

_MOST_ROWS = 600  # more than a trace on any screen has columns of its own
_MOST_ANSWERS = 240  # eight seconds at thirty answers a second; thinned beyond
_MOST_OUTCOMES = 40  # sent to each page thirty times a second


class SnapshotBuilder:
    """Keeps what views show, at the cost of a filter per block; a snapshot is made only when one is wanted.

    Give every block to `rows` as it is read. For the histogram and the ranking over time, say `begin_capture`
    when a capture is armed, and give `captured` the rows that belong to it. Tell `end_capture` what came of it: views
    hold that until rows of the next capture come in, and list it in their history.

    Parameters
    ----------
    rate_hz : float
        Sampling rate of the source.
    spec : FeatureSpec, optional
        Filter and bins of the model. Default: the paper's, with a cut-off of a quarter of the rate where the
        rate is too low for 23 Hz.
    classes : sequence of str, optional
        Materials the model knows, in its order.
    view_s : float, default 5
        How much of the past traces show: a push of 3.2 s with the rest around it.
    n_samples : int, default 1600
        Length of a capture; the paper's.
    source : str, optional
        Where the rows come from, to be shown.
    synthetic : bool, default False
        Do they come from a model instead of a sensor?
    max_lag_s : float, default 0.02
        A newest row older than this is an alarm.
    axes, units : sequence of str
        Names of the columns, and the unit of each. Default: those of a wrench.
    hop_s : float, optional
        Answers come every so many seconds, each about the last `n_samples`; None: one a capture. The ranking is then
        that of the last half minute, or of ten captures where these are longer.

    Raises
    ------
    ValueError, TypeError
        A number outside its range, or a specification made for another rate than `rate_hz`.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.live import SnapshotBuilder, WrenchBuffer
    >>> buffer = WrenchBuffer(seconds=10.0, rate_hz=500.0)
    >>> reader = buffer.reader()
    >>> buffer.push_block(np.ones((1000, 6)))
    1000
    >>> builder = SnapshotBuilder(500.0, source="a bench")
    >>> builder.rows(reader.read())
    >>> snapshot = builder.build("armed", lag_s=0.001)
    >>> snapshot.wrench.shape, snapshot.time_s, snapshot.lost
    ((224, 6), 1.998, 0)
    """

    def __init__(
        self,
        rate_hz: float,
        spec: FeatureSpec | None = None,
        classes: Sequence[str] = (),
        *,
        view_s: float = 5.0,
        n_samples: int = 1600,
        source: str = "",
        synthetic: bool = False,
        max_lag_s: float = 0.02,
        axes: Sequence[str] = AXES,
        units: Sequence[str] = UNITS,
        hop_s: float | None = None,
    ) -> None:
        rate = finite_number("rate_hz", rate_hz, positive=True)
        spec = FeatureSpec(rate_hz=rate, cutoff_hz=min(23.0, rate / 4)) if spec is None else spec
        if not math.isclose(spec.rate_hz, rate, rel_tol=1e-3):
            problem = f"is {rate:g}, but spec was made for {spec.rate_hz:g} Hz"
            raise argument_error(ValueError, "rate_hz", problem)
        view = finite_number("view_s", view_s)
        if not 0 < view * rate <= 1e7:
            raise ValueError(f"view_s must be above 0 and hold at most 1e7 rows, got {view:g} at {rate:g} Hz")
        n_samples = whole_number("n_samples", n_samples)
        self._classes = tuple(classes)
        self._fixed: dict[str, Any] = {
            "source": source,
            "synthetic": synthetic,
            "rate_hz": rate,
            "cutoff_hz": spec.cutoff_hz,
            "n_samples": n_samples,
            "classes": self._classes,
            "max_lag_s": max_lag_s,
            "axes": tuple(axes),
            "units": tuple(units),
            "hop_s": hop_s,
        }
        self._hop_s, self._span_s = hop_s, ranking_span_s(n_samples / rate, hop_s)
        self._n_axes = n_axes = len(axes)
        self._rate_hz = rate
        self._view_rows = n = max(1, round(view * rate))
        # Thinned rows come in pairs of each piece, and a piece at either end may be unfinished.
        self._step = 1 if n <= _MOST_ROWS else math.ceil(n / (_MOST_ROWS // 2 - 1))
        self._sections = butter(spec.order, spec.cutoff_hz, "highpass", fs=spec.rate_hz)
        self._histogram = StreamingExtractor(_counting(spec), n_samples=n_samples, n_axes=n_axes)
        ranges = np.broadcast_to(np.asarray(spec.bin_range, np.float64), (n_axes, 2))
        self._edges = np.array([np.linspace(low, high, spec.n_bins + 1) for low, high in ranges])
        self._recent: deque[NDArray[np.float64]]
        self._filtered: NDArray[np.float64] | None  # state of the filter; None: it begins anew
        self._clear_traces()
        self._latest = np.full(n_axes, math.nan)
        self._time_s: float | None = None
        self._epoch: int | None = None
        self._counted = {"rows": 0, "missing": 0, "missed": 0, "epochs": 0}
        self._answers: list[tuple[float, list[float]]] = []
        self._anew = False  # with its first rows, not before: the last result stays in sight until then
        self._history: deque[Outcome] = deque(maxlen=_MOST_OUTCOMES)

    def rows(self, block: BlockLike) -> None:
        """Take the next block of the stream.

        Where instants are missing, or rows were overwritten before they were read, the traces are interrupted and
        the high-pass starts anew; a new epoch clears both.

        Raises
        ------
        ValueError
            A block of another number of columns, or with values that are no finite numbers.
        """
        wrench = _checked(block.wrench, "block.wrench", self._n_axes)
        if not len(wrench):
            return
        missing = np.asarray(block.missing_before, np.int64)
        gaps = missing.copy()
        if block.epoch == self._epoch:
            gaps[0] += int(block.missed)
        else:  # rows that were missed are of the epoch before
            self._epoch = block.epoch
            self._counted["epochs"] += 1
            self._clear_traces()
        begin = 0
        for end in [*np.flatnonzero(gaps).tolist(), len(wrench)]:
            piece = wrench[begin:end]
            if len(piece):
                self._trace(np.hstack([piece, self._high_passed(piece)]), len(piece))
            if end < len(wrench):
                self._filtered = None
                n_missing = int(gaps[end])
                nothing = np.full((min(n_missing, self._view_rows), 2 * self._n_axes), math.nan)
                self._trace(nothing, n_missing)
            begin = end
        self._latest = wrench[-1].copy()
        self._time_s = float(block.time_s[-1])
        self._counted["rows"] += len(wrench)
        self._counted["missing"] += int(missing.sum())
        self._counted["missed"] += int(block.missed)

    def begin_capture(self) -> None:
        """Say that the next rows of `captured` belong to another capture: they empty the histogram and the ranking."""
        self._anew = True

    def captured(self, rows: NDArray[np.float64]) -> None:
        """Take rows that belong to the capture, shape (k, C), in order and each once; after `n_samples` it is full.

        Raises
        ------
        ValueError
            As for `rows`.
        """
        checked = _checked(rows, "rows", self._n_axes)
        if self._anew and len(checked):
            self._histogram.reset()
            if self._hop_s is None:
                self._answers.clear()
            self._anew = False
        self._histogram.push(checked)

    def end_capture(self, push: Push) -> None:
        """Add what came of the capture to the history; ``Push()`` is a recording that nobody names."""
        number = self._history[-1].number + 1 if self._history else 1
        self._history.append(Outcome(number, time.time(), push))

    def build(
        self,
        state: str,
        decision: Decision | None = None,
        *,
        hint: str = "",
        lag_s: float = math.nan,
        counters: Mapping[str, int] | None = None,
        warnings: Sequence[str] = (),
        n_captures: int = 0,
        n_correct: int | None = None,
    ) -> Snapshot:
        """Make a snapshot of now.

        Parameters
        ----------
        state : str
            State of the capture, see `Snapshot`.
        decision : Decision, optional
            The answer so far.
        hint, lag_s, n_captures, n_correct
            See `Snapshot`.
        counters : mapping of str to int, optional
            Of the buffer. Rows, missing and missed rows and epochs are counted here where it does not tell them.
        warnings : sequence of str
            In addition to those of the decision.

        Returns
        -------
        Snapshot
        """
        if decision is not None:
            self._remember(decision)
        recent = np.concatenate(self._recent)[-self._view_rows :]
        self._recent, self._n_kept = deque([recent]), len(recent)
        places, shown = outline(recent, self._n_instants - len(recent), self._step)
        own = () if decision is None else tuple(decision.warnings)
        shape = (len(self._answers), len(self._classes))
        losses = np.array([losses for _, losses in self._answers]).reshape(shape)
        return Snapshot(
            state=state,
            time_s=self._time_s,
            hint=hint,
            latest=self._latest,
            row_age_s=(len(recent) - 1 - places) / self._rate_hz,
            wrench=shown[:, : self._n_axes],
            residual=shown[:, self._n_axes :],
            bin_edges=self._edges,
            counts=self._histogram.features().reshape(self._n_axes, -1).astype(np.int64),
            ranking_history=(np.array([seconds for seconds, _ in self._answers]) - self._before_s(), losses),
            decision=decision,
            history=tuple(self._history),
            lag_s=lag_s,
            counters={**self._counted, **(counters or {})},
            warnings=tuple(dict.fromkeys((*own, *warnings))),
            n_captures=n_captures,
            n_correct=n_correct,
            **self._fixed,
        )

    def _before_s(self) -> float:
        """When the time begins over which the ranking is shown."""
        return self._answers[-1][0] - self._span_s if self._hop_s is not None and self._answers else 0.0

    def _clear_traces(self) -> None:
        self._n_instants = self._n_kept = 0
        self._recent = deque([np.empty((0, 2 * self._n_axes))])
        self._filtered = None

    def _trace(self, rows: NDArray[np.float64], n_instants: int) -> None:
        """Append to the traces, and forget what is too old to be shown."""
        self._n_instants += n_instants
        self._n_kept += len(rows)
        self._recent.append(rows)
        while self._n_kept - len(self._recent[0]) >= self._view_rows:
            self._n_kept -= len(self._recent.popleft())

    def _high_passed(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        if self._filtered is None:
            # From a steady state: a step from nothing to the sensor's offset is no residual worth a screen.
            self._filtered = sosfilt_zi(self._sections)[:, :, None] * rows[0]
        left, self._filtered = sosfilt(self._sections, rows, axis=0, zi=self._filtered)
        return left

    def _remember(self, decision: Decision) -> None:
        seconds = decision.seconds if self._hop_s is None else self._time_s or 0.0
        if self._answers and seconds < self._answers[-1][0]:
            self._answers.clear()  # the answer begins anew
        if self._answers and seconds == self._answers[-1][0]:
            return
        losses = dict(decision.ranking)
        unknown = sorted(set(self._classes) ^ set(losses))
        if unknown:
            raise ValueError(f"decision ranks other materials than classes: {', '.join(unknown[:5])} differ")
        self._answers.append((seconds, [losses[name] for name in self._classes]))
        begin_s = self._before_s()
        while self._hop_s is not None and self._answers[0][0] < begin_s:
            del self._answers[0]
        if len(self._answers) > _MOST_ANSWERS:
            del self._answers[1::2]


def _checked(rows: object, name: str, n_axes: int) -> NDArray[np.float64]:
    values = as_floats(rows, name, f"numbers of shape (k, {n_axes})")
    if values.ndim != 2 or values.shape[1] != n_axes:
        raise ValueError(f"{name} has shape {values.shape}, wanted (k, {n_axes})")
    if not np.isfinite(values).all():
        raise ValueError(f"{name} holds values that are not finite, wanted numbers in every row")
    return values


def _counting(spec: FeatureSpec) -> FeatureSpec:
    """Return a specification with nothing but the counts of the histograms."""
    names = ("rate_hz", "cutoff_hz", "order", "n_bins", "bin_range", "outside", "initial")
    return FeatureSpec(raw=False, **{name: getattr(spec, name) for name in names})


def outline(
    rows: NDArray[np.float64], first: int, step: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Keep the smallest and the largest value of every `step` rows (n, C), in the order in which they came.

    `first` is the number of the first row in the whole stream: pieces begin at multiples of `step` of that numbering,
    so that a trace which moves on keeps its shape; an unfinished piece at the beginning is left out. Returns where the
    kept values stand, in rows from `rows[0]` (a quarter and three quarters into their piece), and the values (m, C);
    NaN where a piece has none at all.
    """
    if step == 1:
        return np.arange(len(rows), dtype=np.float64), rows
    start = -first % step
    rows = rows[start:]
    n_axes = rows.shape[1]
    pieces = np.concatenate([rows, np.full((-len(rows) % step, n_axes), math.nan)]).reshape(-1, step, n_axes)
    unknown = np.isnan(pieces)
    low = np.where(unknown, math.inf, pieces).argmin(axis=1, keepdims=True)
    high = np.where(unknown, -math.inf, pieces).argmax(axis=1, keepdims=True)
    both = np.concatenate([np.minimum(low, high), np.maximum(low, high)], axis=1)
    kept = np.take_along_axis(pieces, both, axis=1).reshape(-1, n_axes)
    middle = (step - 1) / 2
    places = start + step * np.arange(len(pieces))[:, None] + middle + np.array([-0.25, 0.25]) * step
    return np.clip(places, start, start + len(rows) - 1).ravel(), kept
