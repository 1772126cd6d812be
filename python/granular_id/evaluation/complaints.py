"""What feature spaces complain of: errors that say whose they are, and solvers that stop early in a line each."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

from sklearn.exceptions import ConvergenceWarning

__all__ = ["heard_complaints", "named_errors"]

AT_MOST = 3


@contextmanager
def named_errors(name: str, kind: str = "feature space") -> Iterator[None]:
    """Let errors say which space they are from: of eleven only one may not suit the recordings.

    Examples
    --------
    >>> with named_errors("raw"):
    ...     raise ValueError("no good")
    Traceback (most recent call last):
    ValueError: feature space 'raw': no good
    """
    try:
        yield
    except ValueError as error:
        if repr(name) in str(error):
            raise
        raise ValueError(f"{kind} {name!r}: {error}") from error


@contextmanager
def heard_complaints(who: str) -> Iterator[list[str]]:
    """Gather the convergence warnings of a block, whatever thread they come from.

    Parameters
    ----------
    who : str
        What begins each line, the name of a feature space.

    Yields
    ------
    list of str
        Filled when the block ends: the most frequent warnings with their number, three at most. Warnings of
        other kinds pass.

    Examples
    --------
    >>> with heard_complaints("raw") as lines:
    ...     for _ in range(2):
    ...         warnings.warn("stopped early", ConvergenceWarning, stacklevel=1)
    >>> lines
    ['raw: stopped early (2 times)']
    """
    lines: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ConvergenceWarning)
        yield lines
    for one in caught:
        if not issubclass(one.category, ConvergenceWarning):
            warnings.warn_explicit(one.message, one.category, one.filename, one.lineno)
    counts = Counter(str(one.message) for one in caught if issubclass(one.category, ConvergenceWarning))
    for text, count in counts.most_common(AT_MOST):
        lines.append(f"{who}: {text} ({count} times)" if count > 1 else f"{who}: {text}")
    if len(counts) > AT_MOST:
        lines.append(f"{who}: {len(counts) - AT_MOST} other warnings of this kind")
