"""Arguments that must be numbers, as float64 arrays."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["float_array"]


def float_array(argument: str, values: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return an argument as float64, or name it in an error.

    Parameters
    ----------
    argument : str
        Its name, for the message.
    values : array-like
        Numbers. float64 arrays come back as they are, without a copy.

    Raises
    ------
    TypeError
        Complex numbers, whose imaginary part numpy would drop.
    ValueError
        No array of numbers: text, objects, rows of different lengths.

    Examples
    --------
    >>> from granular_id._arrays import float_array
    >>> float_array("gram", [[1, 2]])
    array([[1., 2.]])
    """
    try:
        given = np.asarray(values)
        if given.dtype.kind != "c":
            return given.astype(np.float64, copy=False)
    except (TypeError, ValueError) as reason:
        raise ValueError(f"{argument} must be an array of numbers: {reason}") from None
    raise TypeError(f"{argument} must hold real numbers, got {given.dtype}")
