"""What can be chosen: which blocks of columns, whether they are whitened, how hard the margin is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

from granular_id._numbers import positive_number

__all__ = ["Machine", "plan_machines"]


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
