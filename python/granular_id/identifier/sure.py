"""What a model keeps beside its weights to say how sure it is: candidates of a stated coverage, and strangers.

The rules are those of `granular_id.confidence`, set on the recordings that were held out for the estimate, and stored
among what is known of the training. The core checks them with the model, and applies them to whole recordings:
provisional answers have none.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from granular_id import _core

if TYPE_CHECKING:
    from granular_id.confidence import ConformalRule, UnknownRule
    from granular_id.identifier.held_out import HeldOut

__all__ = ["KEY", "Rules", "rules_of"]

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
        """Read the rules of a model, which the core has found to fit it.

        Raises
        ------
        TypeError, ValueError
            A number is written as no rule of the library writes it.
        """
        stored = json.loads(core.metadata["trained"]).get(KEY)
        if stored is None:
            return cls()
        from granular_id.confidence.conformal import ConformalRule  # noqa: PLC0415 (few models have them)
        from granular_id.confidence.unknown import UnknownRule  # noqa: PLC0415

        kinds: dict[str, Any] = {"conformal": ConformalRule, "unknown": UnknownRule}
        return cls(**{name: kinds[name].from_dict(rule) for name, rule in stored.items() if rule is not None})


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
