"""Block sizes whose text keeps their order: it says which columns a block has."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

__all__ = ["BlockSizes", "OrderedSizes", "SizesParameter"]

BlockSizes = Mapping[str, int] | Sequence[int] | None


class OrderedSizes(dict[str, int]):
    """A dict that scikit-learn prints as it is.

    Printing an estimator, scikit-learn sorts the keys of a plain dict: typed in again, the sizes would belong to other
    columns.

    Examples
    --------
    >>> from granular_id.spaces import BlockScaler
    >>> BlockScaler({"spectrum": 192, "coupling": 624})
    BlockScaler(blocks={'spectrum': 192, 'coupling': 624})
    """

    def __repr__(self) -> str:  # any but that of dict: scikit-learn knows a dict by it
        return dict.__repr__(self)


class SizesParameter:
    """A parameter of an estimator that turns a plain dict into `OrderedSizes`, however it is set."""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(self, estimator: Any, owner: type) -> Any:
        return self if estimator is None else self._own(estimator)

    def __set__(self, estimator: Any, value: Any) -> None:
        # What is no plain dict stays the same object: clone() asks for that.
        estimator.__dict__[self.name] = OrderedSizes(value) if type(value) is dict else value

    def _own(self, estimator: Any) -> Any:
        try:
            return estimator.__dict__[self.name]
        except KeyError:
            raise AttributeError(f"{type(estimator).__name__} has no {self.name!r}") from None
