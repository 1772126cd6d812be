from typing import Any, Literal, SupportsIndex, TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray
from typing_extensions import Self

__all__ = [
    "AXES",
    "MAX_LINE_BYTES",
    "SIMD",
    "UNITS",
    "FeatureSpec",
    "NumberTableError",
    "StreamingExtractor",
    "__version__",
    "butter",
    "extract_features",
    "histogram",
    "parse_number_table",
    "sosfilt",
    "sosfilt_zi",
    "sosfiltfilt",
    "write_number_table",
]

__version__: str
AXES: tuple[str, ...]
UNITS: tuple[str, ...]
SIMD: str
MAX_LINE_BYTES: int

_Floats: TypeAlias = NDArray[np.float64]

def butter(order: int, band: str, low_hz: float, high_hz: float, rate_hz: float) -> _Floats: ...
def sosfilt(
    sos: ArrayLike, x: ArrayLike, axis: SupportsIndex, zi: ArrayLike | None
) -> tuple[_Floats, _Floats | None]: ...
def sosfilt_zi(sos: ArrayLike) -> _Floats: ...
def sosfiltfilt(
    sos: ArrayLike, x: ArrayLike, axis: SupportsIndex, padtype: str | None, padlen: SupportsIndex | None
) -> _Floats: ...

@final
class FeatureSpec:
    def __new__(
        cls,
        *,
        rate_hz: float = 500.0,
        cutoff_hz: float = 23.0,
        order: SupportsIndex = 8,
        n_bins: SupportsIndex = 100,
        bin_range: ArrayLike = (-1.5, 1.5),
        raw: bool = True,
        hfmh: bool = True,
        outside: Literal["drop", "clip"] = "drop",
        density: bool = False,
        initial: Literal["zero", "steady"] = "zero",
    ) -> Self: ...
    @property
    def rate_hz(self) -> float: ...
    @property
    def cutoff_hz(self) -> float: ...
    @property
    def order(self) -> int: ...
    @property
    def n_bins(self) -> int: ...
    @property
    def bin_range(self) -> tuple[float, float] | tuple[tuple[float, float], ...]: ...
    @property
    def raw(self) -> bool: ...
    @property
    def hfmh(self) -> bool: ...
    @property
    def outside(self) -> Literal["drop", "clip"]: ...
    @property
    def density(self) -> bool: ...
    @property
    def initial(self) -> Literal["zero", "steady"]: ...
    def n_features(self, n_samples: SupportsIndex, n_axes: SupportsIndex) -> int: ...
    def feature_names(self, n_samples: SupportsIndex, n_axes: SupportsIndex) -> list[str]: ...
    def __getnewargs_ex__(self) -> tuple[tuple[()], dict[str, Any]]: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...

def extract_features(
    wrench: ArrayLike,
    spec: FeatureSpec,
    threads: SupportsIndex | None,
    out: NDArray[Any] | None,
    dtype: DTypeLike,
) -> NDArray[Any]: ...
def histogram(
    values: ArrayLike, n_bins: SupportsIndex, low: float, high: float
) -> tuple[list[float], list[float]]: ...

@final
class StreamingExtractor:
    def __new__(
        cls,
        spec: FeatureSpec,
        *,
        n_samples: SupportsIndex = 1600,
        n_axes: SupportsIndex = 6,
        hop: SupportsIndex | None = None,
    ) -> Self: ...
    @property
    def spec(self) -> FeatureSpec: ...
    @property
    def n_samples(self) -> int: ...
    @property
    def n_axes(self) -> int: ...
    @property
    def hop(self) -> int | None: ...
    @property
    def n_features(self) -> int: ...
    @property
    def n_seen(self) -> int: ...
    @property
    def is_complete(self) -> bool: ...
    @property
    def first_row(self) -> int: ...
    def push(self, wrench: ArrayLike) -> int: ...
    def features(self, out: _Floats | None = None) -> _Floats: ...
    def next(self) -> None: ...
    def reset(self) -> None: ...

class NumberTableError(ValueError):
    args: tuple[int, int | None, str]

def parse_number_table(text: bytes, start: SupportsIndex, n_columns: SupportsIndex) -> _Floats: ...
def write_number_table(columns: list[_Floats | NDArray[np.uint8]]) -> bytes: ...
