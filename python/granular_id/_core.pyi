from typing import SupportsIndex, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["__version__", "butter", "sosfilt", "sosfilt_zi", "sosfiltfilt"]

__version__: str

_Floats: TypeAlias = NDArray[np.float64]

def butter(order: int, band: str, low_hz: float, high_hz: float, rate_hz: float) -> _Floats: ...
def sosfilt(
    sos: ArrayLike, x: ArrayLike, axis: SupportsIndex, zi: ArrayLike | None
) -> tuple[_Floats, _Floats | None]: ...
def sosfilt_zi(sos: ArrayLike) -> _Floats: ...
def sosfiltfilt(
    sos: ArrayLike, x: ArrayLike, axis: SupportsIndex, padtype: str | None, padlen: SupportsIndex | None
) -> _Floats: ...
