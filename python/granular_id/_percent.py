"""Per cent without digits, for cells of a matrix."""

from __future__ import annotations

__all__ = ["whole_percent"]


def whole_percent(value: float) -> str:
    """Round so that neither the last error of a class nor its only hit is hidden.

    Parameters
    ----------
    value : float
        Per cent, in (0, 100].

    Returns
    -------
    str

    Examples
    --------
    >>> whole_percent(0.2), whole_percent(87.5), whole_percent(99.7), whole_percent(100.0)
    ('<1', '88', '>99', '100')
    """
    if value < 1.0:
        return "<1"
    if 99.0 < value < 100.0:
        return ">99"
    return f"{value:.0f}"
