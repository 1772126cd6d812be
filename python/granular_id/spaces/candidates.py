"""What can be chosen: which blocks of columns, whether they are whitened, how hard the margin is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.pipeline import Pipeline

from granular_id._checks import positive_number
from granular_id._text import Table, percent


@dataclass(frozen=True)
class Machine:
    """One way to train linear learners on blocks of columns.

    Attributes
    ----------
    blocks : tuple of str
        Blocks that it sees.
    shrinkage : float or None
        Of `granular_id.spaces.WithinClassWhitening`; None: rows are not whitened.
    relative_cost : float
        C times the mean squared distance of the training rows from their mean.
    left_out : tuple of str
        Optional blocks that it does not see.
    """

    blocks: tuple[str, ...]
    shrinkage: float | None
    relative_cost: float
    left_out: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """What makes it differ, in a few words, such as ``without level, whitened 0.001, C 1``."""
        parts = [f"without {' and '.join(self.left_out)}"] if self.left_out else ["all blocks"]
        parts.append("plain" if self.shrinkage is None else f"whitened {self.shrinkage:g}")
        return ", ".join((*parts, f"C {self.relative_cost:g}"))


def plan_machines(
    blocks: Sequence[str], optional: Any, shrinkages: Any, relative_costs: Any
) -> tuple[Machine, ...]:
    """Every combination, from the plainest: fewest blocks first, then no whitening, then the lowest cost.

    Parameters
    ----------
    blocks : sequence of str
        Names of all blocks, in the order of the columns.
    optional : sequence of str
        Of these, the ones that are tried with and without.
    shrinkages : sequence of float or None
    relative_costs : sequence of float

    Returns
    -------
    tuple of Machine

    Raises
    ------
    TypeError, ValueError
        An argument that is no sequence, empty, holds something twice or out of range; a name that is no block, or
        all of them optional.
    """
    extra = _checked("optional_blocks", optional, "names of blocks", empty=True)
    unknown = [name for name in extra if name not in blocks]
    if unknown:
        raise ValueError(
            f"optional_blocks must name blocks ({', '.join(map(repr, blocks))}), got {unknown[0]!r}"
        )
    if len(extra) == len(blocks):
        raise ValueError(f"optional_blocks must leave a block that always stays, got all of them: {extra!r}")
    amounts = [
        None if value is None else positive_number("shrinkages", value, "None or a number")
        for value in _checked("shrinkages", shrinkages, "numbers or None")
    ]
    costs = [
        positive_number("relative_costs", value)
        for value in _checked("relative_costs", relative_costs, "numbers")
    ]
    amounts.sort(key=lambda value: (value is not None, -(value or 0.0)))  # the plainest turns down least
    kept_sets = sorted(product((False, True), repeat=len(extra)), key=sum)
    machines = []
    for kept, shrinkage, cost in product(kept_sets, amounts, sorted(costs)):
        left_out = tuple(name for name, stays in zip(extra, kept, strict=True) if not stays)
        own = tuple(name for name in blocks if name not in left_out)
        machines.append(Machine(own, shrinkage, cost, left_out))
    return tuple(machines)


def _checked(argument: str, values: Any, what: str, *, empty: bool = False) -> list[Any]:
    if isinstance(values, (str, bytes)) or not hasattr(values, "__iter__"):
        raise TypeError(f"{argument} must be a sequence of {what}, got {values!r}")
    every = list(values)
    if not every and not empty:
        raise ValueError(f"{argument} must hold at least one of {what}, got none")
    if len(set(every)) < len(every):
        raise ValueError(f"{argument} must hold each once, got {every!r}")
    return every


# What was chosen, on which folds, and how well each machine did on them.

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


# What a classifier that chooses its own preparation took, as that of ``"best"`` does.


@dataclass(frozen=True)
class Chosen:
    """The choice of one fitted classifier, reduced to what a reader asks for.

    Attributes
    ----------
    machines : tuple of str
        Names of all that were tried.
    chosen : tuple of int
        Which of them make up the model.
    accuracies : tuple of float
        Mean of each machine over the folds that chose, inside the training rows; empty where there were no folds.
    together : float or None
        That of the chosen ones together, on the same folds: too good by what the choice won.
    note : str
        What the folds were.
    """

    machines: tuple[str, ...]
    chosen: tuple[int, ...]
    accuracies: tuple[float, ...]
    together: float | None
    note: str

    @classmethod
    def of(cls, classifier: Any) -> Chosen | None:
        """Return what a fitted classifier chose, or the last step of a pipeline; None where there was no choice.

        Only the `choice_` of a `granular_id.BestClassifier` counts: another classifier's may be anything.

        Examples
        --------
        >>> from sklearn.datasets import load_iris
        >>> from granular_id.spaces.best import BestClassifier
        >>> fitted = BestClassifier(relative_costs=[1.0], n_folds=2).fit(*load_iris(return_X_y=True))
        >>> Chosen.of(fitted).machines
        ('all blocks, plain, C 1', 'all blocks, whitened 0.001, C 1')
        """
        last = classifier[-1] if isinstance(classifier, Pipeline) else classifier
        reduced = getattr(getattr(last, "choice_", None), "reduced", None)
        return reduced if isinstance(reduced, cls) else None

    @property
    def names(self) -> tuple[str, ...]:
        """The machines that make up the model."""
        return tuple(self.machines[k] for k in self.chosen)

    @property
    def words(self) -> str:
        """What makes up the model, as a line to read."""
        count = f"{len(self.chosen)} of {len(self.machines)}"
        return f"the mean of the machines that were chosen, {count}: {'; '.join(self.names)}"

    def to_dict(self) -> dict[str, Any]:
        """Return plain lists, numbers and text."""
        return asdict(self)

    @classmethod
    def from_dict(cls, saved: Mapping[str, Any]) -> Chosen:
        """Make one from what `to_dict` gave.

        Raises
        ------
        TypeError, ValueError
            Parts that are missing, of another type, or do not fit together.
        """
        missing = [field.name for field in fields(cls) if field.name not in saved]
        if missing:
            raise ValueError(f"a choice must hold {', '.join(missing)}")
        machines, chosen, accuracies = (
            _list(name, saved[name], kinds)
            for name, kinds in (("machines", (str,)), ("chosen", (int,)), ("accuracies", (int, float)))
        )
        together = saved["together"]
        if together is not None:
            (together,) = _list("together", [together], (int, float))
        if not chosen or not set(chosen) <= set(range(len(machines))):
            raise ValueError(f"chosen must be among the {len(machines)} machines, got {chosen}")
        if len(accuracies) not in (0, len(machines)):
            raise ValueError(f"wanted an accuracy of each of {len(machines)} machines, got {len(accuracies)}")
        return cls(machines, chosen, accuracies, together, str(saved["note"]))


def _list(name: str, values: Any, kinds: tuple[type, ...]) -> tuple[Any, ...]:
    """Return a list as JSON gave it; no text for a list, and no true for a 1."""
    if not isinstance(values, list | tuple) or any(type(value) not in kinds for value in values):
        wanted = " or ".join(kind.__name__ for kind in kinds)
        raise TypeError(f"{name} must be a list of {wanted}, got {values!r:.80}")
    return tuple(values)
