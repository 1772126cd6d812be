"""``Onset``: where the motion of one recording begins, or why that cannot be said."""

from __future__ import annotations

from dataclasses import dataclass

from granular_id.recording._values import FloatArray

__all__ = ["Onset"]


@dataclass(frozen=True, eq=False)
class Onset:
    """Where the motion of one recording begins, or why that cannot be said.

    Attributes
    ----------
    index : int or None
        Sample at which the change is estimated to have begun; None where none was found.
    time_s : float or None
        The same in seconds from the first sample.
    detected_index, detected_s : int or None, float or None
        The sample with which the change became certain: later than `index`, it is when an alarm that watches
        the signal as it comes would have rung.
    statistic : ndarray, shape (T,)
        How much changes at each sample, over the smallest change that counts: the second largest of the axes
        (or one axis, by what must be asked of it alone); 0 where not judged.
    threshold : float
        What the statistic must exceed: 1.
    axes : tuple of str
        Axes that carry the change, the strongest first.
    strength : float
        Largest statistic around the onset (the largest anywhere where none was found).
    rest_level, rest_sd : ndarray, shape (C,)
        Mean and standard deviation of the axes at rest; of all samples where the recording is too short.
    critical : ndarray, shape (C,)
        Smallest change that counts where another axis changes too, in the unit of the axis; infinite where an
        axis cannot show any.
    rest_samples, window_samples : int
        Samples taken for rest, and samples averaged before they are compared.
    why : str
        Why there is no onset, in words; empty where there is one.
    """

    index: int | None
    time_s: float | None
    detected_index: int | None
    detected_s: float | None
    statistic: FloatArray
    threshold: float
    axes: tuple[str, ...]
    strength: float
    rest_level: FloatArray
    rest_sd: FloatArray
    critical: FloatArray
    rest_samples: int
    window_samples: int
    why: str = ""

    def __repr__(self) -> str:
        if self.index is None:
            return f"Onset(None, why={self.why!r})"
        return (
            f"Onset({self.time_s:.6g} s, sample {self.index}, seen at {self.detected_s:.6g} s on "
            f"{' '.join(self.axes)}, {self.strength:.3g} times the threshold)"
        )
