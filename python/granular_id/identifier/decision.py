"""`Decision`: what an identifier says of a push, and how much of the signal it has seen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from granular_id import _core
from granular_id._text import fixed
from granular_id.identifier.rules import probabilities


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
        Materials that it may be, the likeliest first: they hold the right one as often as the training asked for.
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
    stream: _core.StreamingIdentifier, warned: Mapping[str, int], temperature: float | None
) -> Decision:
    """Return the answer so far, with the warnings that were given in the window: each at a row of the stream."""
    ranking, margin, final, sure, n_seen, first_row, candidates, unknown = stream.standing()
    # A copy: another thread may be adding one.
    warnings = tuple(what for what, row in list(warned.items()) if row >= first_row)
    model = stream.model
    shares = probabilities(temperature, np.array([loss for _, loss in ranking])) if final else None
    probability = None if shares is None else float(shares[0])
    stage = final, sure, n_seen, n_seen / model.rate_hz
    return Decision(ranking[0][0], ranking, margin, probability, *stage, warnings, candidates, unknown)
