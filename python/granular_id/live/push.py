"""What came of one push: the answer, or why there is none, and whether it is right."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from granular_id.identifier import Decision
    from granular_id.live.capture_state import FailureReason

__all__ = ["Push"]


@dataclass(frozen=True)
class Push:
    """What came of one push.

    Attributes
    ----------
    decision : Decision or None
        The answer; None where the capture failed before there was one.
    reason : FailureReason or None
        Why the capture failed, if it did; `text` says it in words.
    text : str
    truth : str or None
        The material, where the source knows it: simulations and recordings played again.
    """

    decision: Decision | None = None
    reason: FailureReason | None = None
    text: str = ""
    truth: str | None = None

    @property
    def is_right(self) -> bool | None:
        """Whether the answer is the truth; None where either is missing.

        An answer that it is like no known material is right where the model does not know the truth.
        """
        if self.decision is None or self.truth is None:
            return None
        if self.decision.unknown:
            return self.truth not in dict(self.decision.ranking)
        return self.decision.label == self.truth

    def to_dict(self) -> dict[str, Any]:
        """Return all of it as plain JSON-like values."""
        return {
            "decision": None if self.decision is None else self.decision.to_dict(),
            "failure": None if self.reason is None else {"reason": self.reason.value, "text": self.text},
            "truth": self.truth,
        }

    def __str__(self) -> str:
        if self.decision is None:
            return f"no answer: {self.text}"
        verdict = {True: "  right", False: f"  WRONG, it was {self.truth}", None: ""}[self.is_right]
        if self.is_right and self.decision.unknown:
            verdict += f", it was {self.truth}"
        if self.is_right is not None and self.truth not in dict(self.decision.ranking):
            verdict += ", which the model does not know"
        return f"{self.decision}{verdict}"
