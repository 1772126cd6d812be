"""What a classifier that chooses its own preparation took, as that of ``"best"`` does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

from sklearn.pipeline import Pipeline

__all__ = ["Chosen"]


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

        Only the `choice_` of a `granular_id.best.BestClassifier` counts: another classifier's may be anything.

        Examples
        --------
        >>> from sklearn.datasets import load_iris
        >>> from granular_id.best import BestClassifier
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
