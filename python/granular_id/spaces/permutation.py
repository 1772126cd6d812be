"""The control that destroys the order in time."""

from __future__ import annotations

import hashlib
from typing import ClassVar

import numpy as np
import numpy.typing as npt
from sklearn.utils import check_random_state

from granular_id.spaces.base import RecordingFilter

__all__ = ["TimePermutation"]

FloatArray = npt.NDArray[np.float64]


class TimePermutation(RecordingFilter):
    """Put the instants of each recording into a random order of its own, all axes together.

    A control, to stand in front of `RawSignal`: what is still told apart does not come from the course in time.
    One order for all recordings would be no control: to a linear classifier of raw samples it is a renaming of
    columns. So each recording has its own, drawn from the seed and from its samples. The same recording is
    shuffled in the same way whatever batch it comes in, in training and in testing, in any process
    and on any machine.

    Parameters
    ----------
    random_state : int, RandomState or None, default 0
        Seed of the orders. A control must repeat, hence the fixed default; None draws a new seed at each `fit`.

    Attributes
    ----------
    seed_ : int
        The seed in use.
    n_features_in_, n_axes_in_ : int
        Samples T of a recording, and its axes C.

    Notes
    -----
    The paper reports about 20 % for permuted signals. What a linear classifier of permuted raw samples still has
    are the mean levels of the axes, and how far it falls depends on what those tell. On the synthetic recordings of
    ``synthesize()``, in the paper's protocol, from 78 % to 48 %, where six means alone give 51 %; to 10 %, chance
    being 9 %, with the mean of each recording subtracted first. (Synthetic: no evidence about real materials.)

    In front of `HFMH` it is another experiment: noise in random order has all its variance in the pass band, so that
    the histogram of a permuted recording tells how its forces are distributed, which is a lot. raw+HFMH falls from
    99 % to no less than 96 % on the same recordings.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.spaces import TimePermutation
    >>> X = np.arange(12.0).reshape(2, 3, 2)
    >>> shuffled = TimePermutation().fit_transform(X)
    >>> bool((np.sort(shuffled, axis=1) == X).all())  # the same instants
    True
    """

    keeps_time: ClassVar[bool] = False

    seed_: int

    def __init__(self, random_state: int | np.random.RandomState | None = 0) -> None:
        self.random_state = random_state

    def _learn(self, recordings: FloatArray) -> None:  # noqa: ARG002
        self.seed_ = int(check_random_state(self.random_state).randint(2**31 - 1))

    def _filtered(self, recordings: FloatArray) -> FloatArray:
        key = self.seed_.to_bytes(8, "little")
        shuffled = np.empty_like(recordings, order="C")
        for one, target in zip(recordings, shuffled, strict=True):
            # Adding zero turns -0.0 into 0.0: equal recordings have equal digests on every machine.
            content = np.ascontiguousarray(one + 0.0, dtype="<f8")
            digest = hashlib.blake2b(content.data, digest_size=16, key=key).digest()
            # RandomState: its streams are frozen, those of newer generators may change with numpy.
            order = np.random.RandomState(np.frombuffer(digest, dtype="<u4")).permutation(len(one))
            target[...] = one[order]
        return shuffled
