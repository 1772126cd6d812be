"""`Decision`: what an identifier says of a push; `StreamingIdentifier` says it while samples arrive."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from granular_id import _core
from granular_id._text import fixed
from granular_id.identifier.model import TrainedModel, probabilities
from granular_id.recording import refuse_tables


@dataclass(frozen=True)
class Decision:
    """The answer to one push, provisional or final.

    Attributes
    ----------
    label : str
        The best material.
    ranking : tuple of (str, float)
        Every material with its mean loss, the best first.
    margin : float
        Loss of the second material minus that of the first.
    probability : float, optional
        Probability of the label: a softmax of minus the losses, whose temperature was fitted on held-out recordings;
        None for a provisional answer and of a model that held none out.
    final : bool
        Whether the whole signal was seen.
    sure : bool
        Whether the margin is as large as the model's rule for early answers wants at this moment.
    n_seen : int
        Samples seen.
    seconds : float
        Seconds of signal seen.
    warnings : tuple of str
        What may have spoilt the signal: a gap, saturation, lag; and what of the set-up is not as in the training.
    candidates : tuple of str
        Materials that it may be, the likeliest first: they hold the right one as often as the training required.
        Empty for a provisional answer, and for a model without such a rule.
    unknown : bool or None
        Whether the signal is like none of the materials that the model knows; None for a provisional answer, and
        without such a rule.

    Examples
    --------
    >>> from granular_id import Decision
    >>> decision = Decision("rice", (("rice", 0.1), ("salt", 0.3)), 0.2, final=False, n_seen=800, seconds=1.6)
    >>> print(decision)
    rice after 1.60 s, provisional: margin 0.200 ahead of salt
    >>> decision.to_dict()["ranking"]
    [['rice', 0.1], ['salt', 0.3]]
    """

    label: str
    ranking: tuple[tuple[str, float], ...]
    margin: float
    probability: float | None = None
    final: bool = False
    sure: bool = False
    n_seen: int = 0
    seconds: float = 0.0
    warnings: tuple[str, ...] = ()
    candidates: tuple[str, ...] = ()
    unknown: bool | None = None

    def __str__(self) -> str:
        stage = "final" if self.final else "sure" if self.sure else "provisional"
        return self.sentence(f"after {fixed(self.seconds, 2)} s, {stage}")

    def sentence(self, stage: str = "") -> str:
        """Return the answer in words; `stage` says how far it is."""
        name = f"like no known material, nearest {self.label}" if self.unknown else self.label
        before = f"{name}{',' * bool(self.unknown)} {stage}:" if stage else f"{name},"
        line = f"{before} {self.lead()}"
        return f"{line} ({', '.join(self.warnings)})" if self.warnings else line

    def lead(self) -> str:
        """Return in words by how much the answer leads, and what else it may be."""
        line = f"margin {fixed(self.margin, 3)}"
        if len(self.ranking) > 1:
            line += f" ahead of {self.ranking[1][0]}"
        if self.probability is not None:
            line += f", probability {self.probability:.3f}"
        if len(self.candidates) > 1:
            line += f"; may be {' or '.join(self.candidates)}"
        return line

    def to_dict(self) -> dict[str, Any]:
        """Return the decision in types that JSON knows."""
        return {field.name: getattr(self, field.name) for field in fields(self)} | {
            "ranking": [[label, loss] for label, loss in self.ranking],
            "warnings": list(self.warnings),
            "candidates": list(self.candidates),
        }


def decision_of(
    stream: _core.StreamingIdentifier, model: TrainedModel, warned: Mapping[str, int]
) -> Decision:
    """Return the answer so far, with the warnings that were given in the window: each at a row of the stream."""
    ranking, margin, final, sure, n_seen, first_row, candidates, unknown = stream.standing()
    # A copy: another thread may be adding one.
    warnings = tuple(what for what, row in list(warned.items()) if row >= first_row)
    shares = probabilities(model, np.array([loss for _, loss in ranking])) if final else None
    probability = None if shares is None else float(shares[0])
    stage = final, sure, n_seen, n_seen / model.rate_hz
    return Decision(ranking[0][0], ranking, margin, probability, *stage, warnings, candidates, unknown)


class StreamingIdentifier:
    """Names the material while its samples arrive: push blocks, ask for the decision at any moment.

    The decision about a complete window is that about the same recording as a whole, bit for bit. Before, it is
    provisional: samples that have not arrived count as the mean of the training recordings, and histograms are scaled
    up to a whole window. Multi-band features are those of the samples so far, taken as the beginning of a recording.

    Parameters
    ----------
    identifier : Identifier
        What to identify with.
    hop : int, optional
        None: one window, from the first row on; push the rows of a capture that begin where the recordings of the
        training began. Else a window every `hop` samples: `next` goes on to the next one. Its first samples then follow
        others instead of rest, as they did not in training.

    Raises
    ------
    TypeError, ValueError
        Something else than an identifier; a hop that is not a positive integer.

    Notes
    -----
    `push` takes under a microsecond per sample, with multi-band features little for most and some ten microseconds for
    every 64th; `decision` some ten, with multi-band features some hundred. Allocate the object once, and `reset` it for
    each push of the robot. It may be used from several threads; calls take their turn.

    Examples
    --------
    >>> import numpy as np
    >>> import granular_id as gid
    >>> from granular_id import Identifier, StreamingIdentifier
    >>> data = gid.synthesize(["rice", "fine sugar"], n_per_class=6, duration_s=0.5)
    >>> stream = StreamingIdentifier(Identifier.fit(data, estimate=False))
    >>> for block in np.array_split(data.X[0], 25):
    ...     taken = stream.push(block)
    >>> decision = stream.decision()
    >>> decision.label, decision.final, decision.seconds
    ('rice', True, 0.5)
    """

    def __init__(self, identifier: TrainedModel, *, hop: int | None = None) -> None:
        if not isinstance(identifier, TrainedModel):
            raise TypeError(f"identifier must be an Identifier, got {type(identifier).__name__}")
        self.core = _core.StreamingIdentifier(identifier.core, hop=hop)
        self._model = identifier
        self._warnings: dict[str, int] = {}  # with the row of the stream at which it was last given

    @property
    def n_seen(self) -> int:
        """Samples of the window so far."""
        return self.core.n_seen

    @property
    def is_complete(self) -> bool:
        """Whether all samples of the window are there."""
        return self.core.is_complete

    def push(self, wrench: npt.ArrayLike) -> int:
        """Take rows until the window is complete.

        Parameters
        ----------
        wrench : array-like, shape (k, C) or (C,)
            Rows in N and N m, as they come; any k, 0 included.

        Returns
        -------
        int
            Rows taken. Those beyond the end of the window are not: push them again after `next` or `reset`.

        Raises
        ------
        TypeError, ValueError
            Another shape; NaN, infinity or values too large to work with. No row was taken then.
        """
        if not isinstance(wrench, np.ndarray):  # rows come in all the time, and have no names as a rule
            refuse_tables(wrench, "wrench")
        return self.core.push(wrench)

    def warn(self, what: str) -> None:
        """Remember that the signal may be spoilt here, as in ``warn("gap")``.

        Decisions carry the warning while the sample that came next is in the window, and until `reset`.
        """
        if not isinstance(what, str):
            raise TypeError(f"what must be a str, got {type(what).__name__}")
        self._warnings[what] = self.core.first_row + self.core.n_seen

    def decision(self) -> Decision:
        """Return the answer so far: final once the window is complete, provisional before.

        Raises
        ------
        ValueError
            A score left float64, for forces of unearthly size.
        """
        return decision_of(self.core, self._model, self._warnings)

    def next(self) -> None:
        """Go on to the next window; rows that it shares with this one stay. Needs `hop` and a complete window."""
        self.core.next()

    def reset(self) -> None:
        """Back to the state before the first row, without warnings."""
        self.core.reset()
        self._warnings.clear()

    def __repr__(self) -> str:
        return f"StreamingIdentifier({self.core.model!r}, hop={self.core.hop})"
