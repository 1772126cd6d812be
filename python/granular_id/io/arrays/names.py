"""What the names of arrays say: labels, rates, times; forces, torques, other signals; materials and recordings."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Literal

from granular_id.io.columns import FLAGS, MASKS, RATES, TIME, split_unit

Role = (
    Literal["labels", "class_names", "sessions", "names", "rate", "step", "time", "start", "trigger", "flags"]
    | Literal["axes", "units", "dimensions", "lengths", "mask", "scaling", "fill"]
)

_NAMES: dict[Role, str] = {
    "labels": "y label labels target targets material class classlabel classlabels materiallabel materiallabels",
    "class_names": "classes materials classnames labelnames materialnames targetnames categories",
    "sessions": "session sessions sessionid sessionids",
    "names": "name names recordingname recordingnames file files filename filenames id ids",
    "rate": RATES,
    "step": "dt timestep samplingperiod sampleperiod samplingtime sampletime samplinginterval sampleinterval",
    "time": "times timestamps stamps",
    "start": "starttime starttimes",
    "trigger": "triggerindex triggerindices",
    "axes": "axes axisnames axislabels channels channelnames columns columnnames colnames featurenames block0items",
    "units": "unit units",
    "dimensions": "dims dimnames dimensions dimensionnames dimensionlabels dimorder",
    "lengths": "lengths nsamples numsamples nsteps numsteps seqlen seqlens seqlengths sequencelengths",
    "mask": MASKS,
    "scaling": "scalefactor addoffset countsperforce countspertorque countspernewton cpf cpt",
    "fill": "fillvalue missingvalue",
}


def _set(words: str) -> frozenset[str]:
    return frozenset(words.split())


ROLES = frozenset({*_NAMES, "flags"})

_ROLES: dict[str, Role] = {name: role for role, names in _NAMES.items() for name in names.split()}

FORCES = frozenset(f"{word}{unit}" for word in ("f", "force", "forces", "eeforce") for unit in ("", "n"))
_TORQUE_WORDS = ("t", "m", "tau", "torque", "torques", "moment", "moments", "eetorque")
TORQUES = frozenset(f"{word}{unit}" for word in _TORQUE_WORDS for unit in ("", "nm"))
"""Plain names of halves of a wrench; other units in names (``force_mN``) are not known here."""

_GENERAL = _set(
    "x data dataset wrench wrenches recordings recording samples signal signals features ft force forces torque "
    "torques values raw filtered train test val validation xtrain xtest xval trainx testx datatrain datatest "
    "traindata testdata"
)

_SIGNALS = _set(
    "wrench wrenches ft ext force forces torque torques sensor sensors ati signal signals raw filtered obs left "
    "right mean std median"
)
"""Words for what a sensor gave: arrays called so beside others are no materials, but may each be the wrench."""

_COUNTED = _set(
    "recording recordings rec trial trials run runs push pushes demo demos episode episodes sample samples test "
    "tests experiment exp measurement meas trajectory traj sequence seq segment take rep repetition day session "
    "batch drive drives lap laps"
)
"""Words that stand before the number of a recording and are no material."""

_OTHER_THINGS = _set(
    "joint joints q qd qdd qpos qvel qacc dq ddq pos position positions pose poses vel velocity velocities speed "
    "speeds twist twists acc accel acceleration accelerations gyro gyroscope imu action actions command commands "
    "cmd setpoint setpoints quat quaternion orientation euler rpy angle angles jacobian effort efforts gauge "
    "gauges strain voltage voltages volts counts adc encoder encoders"
)
"""Words for what is never a wrench."""

_WORDS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
_NUMBER = re.compile(r"[\W_]*\d+$")
_LONGEST = 200
"""Characters of a name that are looked at."""


@lru_cache(256)  # thousands of structs ask for the names of their few fields over and over
def plain_name(name: str) -> str:
    """Return a name in lower case with letters and digits only."""
    return "".join(c for c in name.lower() if c.isalnum())


@lru_cache(256)
def role_of(name: str) -> Role | None:
    """Tell what an array is for by its name; None where the name says nothing."""
    # columns like "t", "time_ms", "timestamp [s]" and "flags" have a table of their own
    meaning, unit = split_unit(name)
    if meaning in (TIME, FLAGS):
        return "time" if meaning == TIME else "flags"
    plain = plain_name(name)
    return _ROLES.get(plain) or (_ROLES.get(plain.removesuffix(plain_name(unit))) if unit else None)


def is_general(name: str) -> bool:
    """Tell whether a name is one for samples in general (``X``, ``data``), so that it cannot be a material's."""
    return plain_name(name) in _GENERAL


@lru_cache(256)
def is_signal(name: str) -> bool:
    """Tell whether a name, whatever its number, is one for what a sensor gave: ``wrench``, ``ft_left``, ``X2``."""
    return is_general(_without_number(name)) or not _SIGNALS.isdisjoint(_words(name))


@lru_cache(256)
def is_other_thing(name: str) -> bool:
    """Tell whether what is called so is no wrench, or none whose axes can be told."""
    # pandas' values_block_0 has its names of columns in a pickle
    return not _OTHER_THINGS.isdisjoint(_words(name)) or plain_name(name).startswith("valuesblock")


def is_no_label(name: str) -> bool:
    """Tell whether a name is that of a signal, of a count or of a setting: ``ft``, ``trial_01``, ``speed_30``."""
    if is_signal(name) or not name[-1:].isdecimal():
        return is_signal(name)
    bare = _without_number(name.lower())
    return bare in _COUNTED or bare in _OTHER_THINGS


def is_counted_group(name: str) -> bool:
    """Tell whether a struct or group called so is one recording of several: ``demo_0``, ``rice/3``, ``data[7]``."""
    last = name.rpartition("/")[2]
    return last.endswith("]") or (
        last[-1:].isdecimal() and _without_number(last.lower()) not in ("day", "session", "batch")
    )


def label_of_name(name: str) -> str | None:
    """Return the label in ``rice_01``: what stands before the last underscore, if a number follows."""
    label, _, rest = name.rpartition("_")
    return label if label and rest.isdecimal() and not is_no_label(name) else None


def _without_number(name: str) -> str:
    return _NUMBER.sub("", name[-_LONGEST:])


def _words(name: str) -> set[str]:
    return {word.lower() for word in _WORDS.findall(name[:_LONGEST])}
