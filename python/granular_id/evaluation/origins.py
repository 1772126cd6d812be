"""Where recordings come from: sessions, and an order in time; for classifiers that choose by holding rows out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.pipeline import Pipeline
from sklearn.utils.validation import has_fit_parameter

from granular_id.evaluation.partitions import describe_order
from granular_id.recording import Dataset

__all__ = ["Origins", "asked_for", "origins_of"]

Rows = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Origins:
    """What is known about where the recordings of a data set come from.

    Attributes
    ----------
    sessions : (n,) object array
        Session of each recording; None where it is not known.
    rank : (n,) int array or None
        Place of each recording in time; None where no order is known.
    """

    sessions: NDArray[np.object_]
    rank: Rows | None

    def fit_arguments(self, estimator: Any, rows: Rows) -> dict[str, Any]:
        """Return what `fit` of an estimator takes of it, for training rows.

        Parameters
        ----------
        estimator : estimator
            Its `fit`, or that of the last step of a pipeline, may have the parameters ``sessions`` and ``order``, as
            that of `granular_id.best.BestClassifier` has.
        rows : (m,) int array
            Of the data set.

        Returns
        -------
        dict
            ``sessions`` (m,), and ``order`` (m,): places in `rows`, the earliest first, or None.

        Examples
        --------
        >>> import numpy as np
        >>> from granular_id.best import BestClassifier
        >>> origins = Origins(np.array(["mon", "mon", "tue"], dtype=object), np.array([2, 0, 1]))
        >>> known = origins.fit_arguments(BestClassifier(), np.array([0, 2]))
        >>> known["sessions"].tolist(), known["order"].tolist()
        (['mon', 'tue'], [1, 0])
        """
        known = {
            "sessions": self.sessions[rows],
            "order": None if self.rank is None else np.argsort(self.rank[rows], kind="stable"),
        }
        return asked_for(estimator, known)


def asked_for(estimator: Any, known: Mapping[str, Any]) -> dict[str, Any]:
    """Return those of the known things that `fit` has a parameter for, in a pipeline that of its last step.

    Examples
    --------
    >>> from sklearn.pipeline import make_pipeline
    >>> from granular_id.best import BestClassifier
    >>> asked_for(make_pipeline(BestClassifier()), {"order": None, "weather": "dry"})
    {'bestclassifier__order': None}
    """
    prefix = ""
    while isinstance(estimator, Pipeline):
        name, estimator = estimator.steps[-1]
        prefix += f"{name}__"
    return {f"{prefix}{name}": value for name, value in known.items() if has_fit_parameter(estimator, name)}


def origins_of(data: Dataset) -> Origins:
    """Gather sessions and the order in time of a data set; an order that contradicts itself counts as none."""
    sessions = np.empty(len(data), dtype=object)
    sessions[:] = data.sessions
    try:
        describe_order(data.start_times, data.y, data.names)
    except ValueError:
        return Origins(sessions, None)
    return Origins(sessions, np.argsort(data.chronological_order()[0], kind="stable"))
