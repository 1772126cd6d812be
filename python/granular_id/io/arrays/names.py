"""What the names of arrays say: the one table of names for labels, rates, times and the like."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, Literal

from granular_id.io.arrays.tree import is_leaf
from granular_id.io.columns import FLAGS, TIME, axis_of

Role = Literal[
    "labels", "class_names", "sessions", "names", "rate", "time", "start", "trigger", "axes", "flags"
]

_NAMES: dict[Role, str] = {
    "labels": "y label labels target targets material class classlabel classlabels materiallabel materiallabels",
    "class_names": "classes materials classnames labelnames materialnames targetnames categories",
    "sessions": "session sessions sessionid sessionids",
    "names": "name names recordingname recordingnames file files filename filenames id ids",
    "rate": "fs ratehz rate samplingrate samplerate samplingratehz sampleratehz samplingfrequency frequency freq hz",
    "time": "times timestamps stamps",
    "start": "starttime starttimes",
    "trigger": "triggerindex triggerindices",
    "axes": "axes axisnames channels channelnames",
}

_ROLES: dict[str, Role] = {name: role for role, names in _NAMES.items() for name in names.split()}

_GENERAL = (
    "x data dataset wrench wrenches recordings recording samples signal signals features ft force forces torque "
    "torques values raw filtered train test val validation xtrain xtest xval trainx testx datatrain datatest "
    "traindata testdata"
)
_GENERAL_NAMES = frozenset(_GENERAL.split())


@lru_cache(256)  # thousands of structs ask for the names of their few fields over and over
def plain_name(name: str) -> str:
    """Return a name in lower case with letters and digits only."""
    return "".join(c for c in name.lower() if c.isalnum())


@lru_cache(256)
def role_of(name: str) -> Role | None:
    """Tell what an array is for by its name; None where the name says nothing.

    Examples
    --------
    >>> role_of("sampling_rate"), role_of("Labels"), role_of("rice")
    ('rate', 'labels', None)
    """
    # columns like "t", "time_s", "timestamp [s]" and "flags" have a table of their own
    meaning = axis_of(name)
    if meaning in (TIME, FLAGS):
        return "time" if meaning == TIME else "flags"
    return _ROLES.get(plain_name(name))


def is_general(name: str) -> bool:
    """Tell whether a name is one for samples in general (``X``, ``data``), so that it cannot be a material's."""
    return plain_name(name) in _GENERAL_NAMES


def label_of_name(name: str) -> str | None:
    """Return the label in ``rice_01``: what stands before the last underscore, if a number follows.

    Examples
    --------
    >>> label_of_name("oat_flakes_01"), label_of_name("run1")
    ('oat_flakes', None)
    """
    label, _, rest = name.rpartition("_")
    return label if label and rest.isdecimal() else None


def without_tables(samples: dict[str, Any], n_axes: int, *, beside_parts: bool) -> dict[str, Any]:
    """Leave out what only looks like samples beside the recordings: calibration matrices, ranges, means per sample.

    Square matrices are left out wherever there is anything else; others of two dimensions where an array or list of
    recordings has a general name (``X``, ``data``) and they have names of their own.
    """
    flat = {key for key, node in samples.items() if is_leaf(node) and len(node.shape) == 2}
    square = {key for key in flat if tuple(samples[key].shape) == (n_axes, n_axes)}
    kept = {key: node for key, node in samples.items() if key not in square}
    if not kept and not beside_parts:
        kept = samples
    if any(is_general(key) and key not in flat for key in kept):
        return {key: node for key, node in kept.items() if is_general(key) or key not in flat}
    return kept
