"""What was chosen, on which folds, and how well each machine did on them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from granular_id.best.candidates import Machine
from granular_id.evaluation.chosen import Chosen
from granular_id.evaluation.tables import Table, percent

__all__ = ["Choice", "choose"]

FloatArray = npt.NDArray[np.float64]


def choose(accuracies: FloatArray, n_rows: int) -> tuple[int, ...]:
    """Machines within one standard error of the best, or within one recording where that is more.

    Parameters
    ----------
    accuracies : ndarray, shape (J, n_machines)
        On J folds.
    n_rows : int
        Different recordings that were held out.

    Returns
    -------
    tuple of int
        Those whose mean accuracy is at most one standard error below the highest, that of a share of `n_rows` (the
        rule of Breiman, Friedman, Olshen & Stone, "Classification and Regression Trees", 1984), or at most
        ``1 / n_rows`` where that is more: the error of a share of 1 is 0, and one recording is chance all the same.
        Ascending. Where they take the simplest, the mean of their scores is taken here: where
        few recordings choose, chance does, and a mean of equals is steadier than any one of them.

    Examples
    --------
    >>> import numpy as np
    >>> choose(np.array([[0.90, 0.92, 0.80], [0.92, 0.91, 0.83]]), 100)
    (0, 1)
    """
    means = accuracies.mean(axis=0)
    best = means.max()
    slack = max(1.0 / n_rows, np.sqrt(best * (1.0 - best) / n_rows))
    return tuple(np.flatnonzero(means >= best - slack - 1e-12).tolist())


@dataclass(frozen=True, eq=False)
class Choice:
    """The choice of a `BestClassifier`.

    Attributes
    ----------
    machines : tuple of Machine
        All that were tried.
    chosen : tuple of int
        Which of them make up the model; see `choose`.
    accuracies : ndarray, shape (J, n_machines)
        Of each on each fold; J is 0 where there were no folds.
    joint : ndarray, shape (J,)
        Accuracy of the chosen ones together. They were chosen on these folds: too good by as much as the choice won.
    held_out : {"sessions", "blocks in time", "random recordings", "nothing"}
        What a fold was.
    note : str
        How the folds were made, as a line to read.
    random_state : int or None, default None
        What drew random folds, where it was a number.
    """

    machines: tuple[Machine, ...]
    chosen: tuple[int, ...]
    accuracies: FloatArray
    joint: FloatArray
    held_out: str
    note: str
    random_state: int | None = None

    @property
    def accuracy(self) -> float:
        """Mean of `joint`; NaN where there were no folds."""
        return float(self.joint.mean()) if self.joint.size else float("nan")

    @property
    def reduced(self) -> Chosen | None:
        """What a reader asks for; None where there was one machine, and nothing to choose."""
        if len(self.machines) < 2:
            return None
        return Chosen(
            machines=tuple(machine.name for machine in self.machines),
            chosen=self.chosen,
            accuracies=tuple(self.accuracies.mean(axis=0).tolist()) if len(self.accuracies) else (),
            together=self.accuracy if self.joint.size else None,
            note=self.note,
        )

    def table(self) -> Table:
        """All machines, in the order of their accuracy on the folds; ``>`` marks the chosen ones."""
        n_machines = len(self.machines)
        means = self.accuracies.mean(axis=0) if len(self.accuracies) else np.full(n_machines, np.nan)
        spreads = self.accuracies.std(axis=0) if len(self.accuracies) else np.full(n_machines, np.nan)
        order = sorted(range(n_machines), key=lambda k: (-np.nan_to_num(means[k]), k))
        rows = tuple(
            (
                f"{'> ' if k in self.chosen else '  '}{self.machines[k].name}",
                percent(float(means[k])),
                "-" if np.isnan(spreads[k]) else f"{100 * spreads[k]:.1f}",
            )
            for k in order
        )
        notes = [f"chosen on {self.note}"]
        if len(self.accuracies):
            notes.append(
                "> chosen: what is within one standard error of the best, or one recording; the mean of their "
                f"scores reaches {percent(self.accuracy)} on the same folds"
            )
        return Table("Machines tried", ("machine", "accuracy", "SD of folds"), rows, tuple(notes))

    def __str__(self) -> str:
        return str(self.table())

    def to_dict(self) -> dict[str, Any]:
        """Everything in types that JSON knows."""
        return {
            "held_out": self.held_out,
            "note": self.note,
            "random_state": self.random_state,
            "n_folds": len(self.accuracies),
            "accuracy_on_the_folds_that_chose": self.accuracy if self.joint.size else None,
            "chosen": [self.machines[k].name for k in self.chosen],
            "machines": [
                {
                    "name": machine.name,
                    "blocks": list(machine.blocks),
                    "shrinkage": machine.shrinkage,
                    "relative_cost": machine.relative_cost,
                    "chosen": k in self.chosen,
                    "accuracies": self.accuracies[:, k].tolist(),
                }
                for k, machine in enumerate(self.machines)
            ],
        }
