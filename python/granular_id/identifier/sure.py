"""What a model keeps beside its weights to say how sure it is: candidates of a stated coverage, and strangers.

The rules are those of `granular_id.confidence`, set on the recordings that were held out for the estimate, and stored
among what is known of the training. They hold for whole recordings: provisional answers have none.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from granular_id import _core

if TYPE_CHECKING:
    from granular_id.confidence import ConformalRule, UnknownRule
    from granular_id.identifier.held_out import HeldOut

__all__ = ["KEY", "Rules", "rules_of"]

FloatArray = npt.NDArray[np.float64]

KEY = "confidence"
"""Where the rules stand in what is known of a training."""


@dataclass(frozen=True)
class Rules:
    """The rules of a model, None where it has none.

    Attributes
    ----------
    conformal : ConformalRule or None
    unknown : UnknownRule or None
    """

    conformal: ConformalRule | None = None
    unknown: UnknownRule | None = None

    @classmethod
    def of(cls, core: _core.Model) -> Rules:
        """Read and check the rules of a model.

        Raises
        ------
        TypeError, ValueError
            Something else stands in their place, or they are for other classes or learners.
        """
        stored = json.loads(core.metadata["trained"]).get(KEY)
        if stored is None:
            return cls()
        from granular_id.confidence.conformal import ConformalRule  # noqa: PLC0415 (few models have them)
        from granular_id.confidence.unknown import UnknownRule  # noqa: PLC0415

        kinds: dict[str, Any] = {"conformal": ConformalRule, "unknown": UnknownRule}
        if not isinstance(stored, Mapping) or not set(stored) <= set(kinds):
            raise ValueError(f"{KEY} must hold rules named {' and '.join(kinds)}, got {stored!r:.80}")
        rules = cls(**{name: kinds[name].from_dict(rule) for name, rule in stored.items()})
        for rule in (rules.conformal, rules.unknown):
            if rule is not None and tuple(rule.classes) != tuple(core.classes):
                raise ValueError(f"{KEY}: the rule is for other classes than the model: {rule.classes!r:.80}")
        if rules.unknown is not None and not rules.unknown.fits(core.coding_matrix):
            raise ValueError(
                f"{KEY}: the rule {rules.unknown.kind!r} is for other learners than the model has"
            )
        return rules

    def in_core(self) -> _core.Rules | None:
        """Return the rules as the core applies them, in microseconds; None where it does not know the kind of one."""
        conformal, unknown = self.conformal, self.unknown
        if conformal is not None and conformal.kind != "margin":
            return None
        limits = None if conformal is None else conformal.limits_of()
        if unknown is None:
            return _core.Rules(limits)
        if unknown.nearest is None:
            return None
        return _core.Rules(
            limits,
            unknown.nearest,
            of_losses=unknown.kind == "value_distance",
            threshold=unknown.threshold,
        )

    def candidates(self, values: list[float]) -> tuple[str, ...]:
        """Materials in the set of a recording, the likeliest first and at least one; empty without a rule.

        Parameters
        ----------
        values : list of K float
            Minus the mean losses, in the order of the classes.
        """
        return () if self.conformal is None else self.conformal.names(values, at_least_one=True)

    def is_unknown(self, values: list[float], scores: FloatArray) -> bool | None:
        """Whether a recording is like none of the known materials; None without a rule.

        Parameters
        ----------
        values : list of K float
            As of `candidates`.
        scores : ndarray, shape (L,)
            Of the learners.
        """
        return None if self.unknown is None else not self.unknown.knows(values, scores)


def rules_of(
    held: HeldOut,
    classes: tuple[str, ...],
    coding: npt.NDArray[np.int8],
    *,
    coverage: float | None,
    share_known: float | None,
) -> dict[str, Any]:
    """Set the rules on held-out recordings.

    Parameters
    ----------
    held : HeldOut
    classes : tuple of K str
    coding : ndarray of int8, shape (K, L)
    coverage : float or None
        Share of recordings of which the candidates hold the right material; None: no rule.
    share_known : float or None
        Share of recordings of known materials that are not called unknown; None: no rule.

    Returns
    -------
    dict
        In types that JSON knows.
    """
    from granular_id.confidence import HeldOutScores, conformal_rule, unknown_rule  # noqa: PLC0415
    from granular_id.confidence.held_out import Scores  # noqa: PLC0415

    rows, first = np.unique(held.rows, return_index=True)  # each once, however often it was held out
    scored = HeldOutScores(
        classes=classes,
        truth=held.truth[first],
        scores=Scores(held.values[first], held.scores[first], None, coding),
        rows=rows,
        folds=held.folds[first],
        groups=np.arange(rows.size, dtype=np.intp),
        held_out=held.held_out,
    )
    rules: dict[str, Any] = {}
    if coverage is not None:
        rules["conformal"] = conformal_rule(scored, [coverage]).to_dict()
    if share_known is not None:
        rules["unknown"] = unknown_rule(scored, share_known=share_known).to_dict()
    return rules
