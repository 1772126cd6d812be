"""Identification while samples arrive."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from granular_id import _core
from granular_id._columns import samples_of
from granular_id.identifier.decision import Decision, decision_of
from granular_id.identifier.metadata import Metadata

if TYPE_CHECKING:
    from granular_id.identifier.identifier import Identifier


class StreamingIdentifier:
    """Names the material while its samples arrive: push blocks, ask for the decision at any moment.

    The decision about a complete window is that about the same recording as a whole, bit for bit. Before, it is
    provisional: samples that have not arrived count as the mean of the training recordings, and histograms are scaled
    up to a whole window. Multi-band features are those of the samples so far, taken as the beginning of a recording.

    Parameters
    ----------
    identifier : Identifier or granular_id._core.Model
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

    def __init__(self, identifier: Identifier | _core.Model, *, hop: int | None = None) -> None:
        core = getattr(identifier, "core", identifier)
        if not isinstance(core, _core.Model):
            raise TypeError(f"identifier must be an Identifier, got {type(identifier).__name__}")
        self.core = _core.StreamingIdentifier(core, hop=hop)
        self._temperature = Metadata(core).temperature
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
            Rows in N and N m, as they come; any k, 0 included. Columns with names come into the order of the model's
            axes.

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
            wrench, _ = samples_of(wrench, "wrench", Metadata(self.core.model).axes)
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
        return decision_of(self.core, self._warnings, self._temperature)

    def next(self) -> None:
        """Go on to the next window; rows that it shares with this one stay. Needs `hop` and a complete window."""
        self.core.next()

    def reset(self) -> None:
        """Back to the state before the first row, without warnings."""
        self.core.reset()
        self._warnings.clear()

    def __repr__(self) -> str:
        return f"StreamingIdentifier({self.core.model!r}, hop={self.core.hop})"
