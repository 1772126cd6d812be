"""One thread for linear algebra, where the last bit of a product would otherwise depend on their number."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from threadpoolctl import threadpool_limits

__all__ = ["single_threaded_blas"]

_lock = threading.Lock()
_inside = 0
_limits: threadpool_limits | None = None


@contextmanager
def single_threaded_blas() -> Iterator[None]:
    """Keep BLAS to one thread inside the block.

    An iterative method that rounds differently with two threads than with one ends elsewhere. The limit
    belongs to the process, so the first thread that enters sets it and the last that leaves takes it back:
    a limit of its own for each thread would be lifted under the feet of those still at work, or stay for ever.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id._blas import single_threaded_blas
    >>> with single_threaded_blas():
    ...     float(np.ones((2, 2)).dot(np.ones(2)).sum())
    4.0
    """
    global _inside, _limits  # noqa: PLW0603 - what they count belongs to the process
    with _lock:
        if _inside == 0:
            _limits = threadpool_limits(limits=1, user_api="blas")
        _inside += 1
    try:
        yield
    finally:
        with _lock:
            _inside -= 1
            if _inside == 0 and _limits is not None:
                _limits.restore_original_limits()
                _limits = None
