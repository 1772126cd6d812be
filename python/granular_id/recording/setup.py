"""``Setup``: what recordings were made with, as far as their metadata say, and what follows where it differs."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Literal

from granular_id._checks import argument_error, thaw
from granular_id._core import GranularIdError
from granular_id._text import in_both
from granular_id.recording.columns import same_unit
from granular_id.recording.recording import unit_of

# What is refused where it differs, unless somebody says that it may.
ACCEPTABLE = ("frame", "transform", "sign", "units")
_LONGEST = 200  # characters of a value that are stored and compared
# A thing with more values than this in one training varied there, and says nothing about another set-up.
_MOST_VALUES = 8
# Masses this close are one payload, identified twice.
_SAME_MASS = 0.05

UNSTATED = "not stated"
"""What a side says of a thing that it does not name."""


@dataclass(frozen=True)
class Difference:
    """One thing that is not as in the training.

    Attributes
    ----------
    name : str
        Field of `Setup`, or ``"units"``.
    trained : tuple of str
        Values in the training; "not stated" where it says nothing, and that is a difference.
    now : str
    consequence : {"refuse", "warn"}
        Whether no answer can be right, or one may be worse.
    """

    name: str
    trained: tuple[str, ...]
    now: str
    consequence: Literal["refuse", "warn"]

    def __str__(self) -> str:
        return f"{self.name} {quoted(self.now)}, in training {' or '.join(map(quoted, self.trained))}"


def quoted(value: str) -> str:
    """Return a value as it is shown."""
    return value if value == UNSTATED else repr(value)


@dataclass(frozen=True)
class Setup:
    """What a recording was made with; None where that is not known.

    Values are compared as they stand: two names for the same frame are two frames, and a sensor that was turned under
    the same name of its frame is not noticed. Masses of payloads agree within 5 %, as when one is identified twice.

    Parameters
    ----------
    frame : str, optional
        Axes and origin that the wrench refers to. Another one is refused.
    transform : str, optional
        How a Net F/T box turns and moves the wrench of its sensor (``cfgtfx``). Another one is refused.
    sign : str, optional
        Whose force on whom. Another one is refused.
    sensor, serial : str, optional
        What people call it; serial number or calibration. Where the serial number is the same, the sensor is.
    filter : str, optional
        Low-pass within the sensor: its cut-off, or what the metadata call it.
    compensated, tare, payload : str, optional
        Whether the tool's weight is taken off ("yes", "no"); zero point and load, where somebody noted them.
    tool : str, optional
    mount_rotation, lever_arm_m : str, optional
        How the sensor is turned on the robot, and how far the tip of the tool is from its origin.
    trigger : str, optional
        What the recording's motion begins at: "motion", "force", "manual", "onset".
    motion : str, optional
        Speed of the push.
    read_as : str, optional
        What had to be chosen to read the file: an array, a topic, columns. Another array of the same file is another
        signal.

    Examples
    --------
    >>> from granular_id.recording import Setup
    >>> monday = Setup.of({"frame": "flange", "trigger": "motion"})
    >>> for difference in monday.differences(Setup(frame="flange, turned", sign="on the tool", trigger="force")):
    ...     print(difference.consequence, difference)
    refuse frame 'flange, turned', in training 'flange'
    warn trigger 'force', in training 'motion'
    """

    frame: str | None = None
    transform: str | None = None
    sign: str | None = None
    sensor: str | None = None
    serial: str | None = None
    filter: str | None = None
    compensated: str | None = None
    tare: str | None = None
    payload: str | None = None
    tool: str | None = None
    mount_rotation: str | None = None
    lever_arm_m: str | None = None
    trigger: str | None = None
    motion: str | None = None
    read_as: str | None = None

    @classmethod
    def of(cls, meta: Mapping[str, Any]) -> Setup:
        """Take what the metadata of a recording say: ``meta`` itself, its ``source``, and the source's ``meta``.

        Parameters
        ----------
        meta : mapping
            As of a `Recording`: of a file with entries of these names, or as a recorder leaves it.
        """
        source = _tree(meta.get("source"))
        within = _tree(source.get("meta"))
        places, page, robot = (meta, source, within), _tree(within.get("page")), _tree(meta.get("robot"))
        known = {f.name: _text(_first(places, f.name)) for f in fields(cls)}
        known["serial"] = known["serial"] or _text(_first(places, "calibration"))
        if not source.get("synthetic") and not any("sensor" in place for place in places):
            known["sensor"] = _text(source.get("name"))
        if known["trigger"] == "time":  # of a replay; what the recordings began at is in its source
            known["trigger"] = _text(_first(places[1:], "trigger"))
        number = _text(page.get("setuserfilter"))  # of a Net F/T box; 0 is none
        by_number = None if number in (None, "0") else f"setuserfilter {number}"
        rig = (robot, _tree(robot.get("rig")), meta, _tree(meta.get("rig")))
        known["transform"] = known["transform"] or _text(page.get("cfgtfx"))
        known["filter"] = known["filter"] or _text(_first(places, "filter_hz"), " Hz") or by_number
        known["motion"] = known["motion"] or _text(_first(rig, "speed_m_s"), " m/s")
        topic = _text(meta.get("topic"))  # of a bag: another is another signal, the only one of its bag too
        if topic is not None and re.fullmatch(r"topic=[^,]*", known["read_as"] or "topic="):
            known["read_as"] = f"topic={topic}"
        return cls(**known)

    def completed(self, other: Setup) -> Setup:
        """Take from another set-up what this one does not know."""
        known = {f.name: value for f in fields(self) if (value := getattr(self, f.name)) is not None}
        return replace(other, **known)

    def differences(self, other: Setup) -> list[Difference]:
        """Compare the set-up of a training with another one.

        What either does not know is no difference, but for what a step of this library takes off the samples: a tare
        from rest (``tare`` "rest") is warned of where the other side does not name it, and a ``payload`` that was
        compensated where the other side is not ``compensated``, unless both are tared from rest.

        Examples
        --------
        >>> from granular_id import synthesize
        >>> from granular_id.recording import Setup
        >>> data = synthesize(["rice"], n_per_class=1)
        >>> tared = data.tare(lead_s=0.1)
        >>> print(*Setup.of(data[0].meta).differences(Setup.of(tared[0].meta)))
        tare 'rest', in training not stated
        """
        return setup_differences(values_in([self]), other)


def values_in(setups: Iterable[Setup]) -> dict[str, list[str]]:
    """Gather the values of each thing, sorted, each once, unless very many; of what was taken off also "not stated"."""
    every = list(setups)
    found = {f.name: {getattr(one, f.name) for one in every} for f in fields(Setup)}
    known = {name: sorted(values - {None}) for name, values in found.items()}
    payloads: list[str] = []
    for value in known["payload"]:
        payloads += [] if _agrees("payload", value, payloads) else [value]
    known["payload"] = payloads
    for name in taken_off(known):
        known[name] += [UNSTATED] * (None in found[name])
    return {name: values for name, values in known.items() if 0 < len(values) <= _MOST_VALUES}


_TAKEN_OFF = ("tare", "payload")


def taken_off(known: Mapping[str, Sequence[str]]) -> set[str]:
    """Name what says that a step took something off samples: who does not say it has samples that hold it."""
    tared = "rest" in known.get("tare", ())
    compensated = bool(known.get("payload")) and "yes" in known.get("compensated", ())
    return {name for name, is_ in zip(_TAKEN_OFF, (tared, compensated), strict=True) if is_}


def _with_unstated(known: Mapping[str, Sequence[str]], off: set[str]) -> dict[str, Sequence[str]]:
    """Put in what a side does not state, of what was taken off its own samples or those of another side."""
    # The weight is gone, too, where a driver took it off.
    missed = off - {"payload"} if "yes" in known.get("compensated", ()) else off
    return {**{name: [UNSTATED] for name in missed}, **known}


def _agrees(name: str, value: str, values: Iterable[str]) -> bool:
    """Whether a value is one of several; of payloads, whether a mass is about one of theirs."""
    kg = _mass(value) if name == "payload" else math.nan
    return value in values or any(abs(kg - _mass(one)) <= _SAME_MASS * kg for one in values)


def _mass(text: str) -> float:
    """Return the mass in a payload's text; NaN, which is near none, where it states none."""
    try:
        return float(text.removesuffix(" kg")) if text.endswith(" kg") else math.nan
    except ValueError:  # 1.2.3 kg
        return math.nan


def setup_differences(trained: Mapping[str, Sequence[str]], now: Setup) -> list[Difference]:
    """Compare what the recordings of a training had, as `values_in` gives it, with a set-up."""
    same_sensor = now.serial is not None and now.serial in trained.get("serial", ())
    own = values_in([now])
    off = taken_off(trained) | taken_off(own)
    if list(trained.get("tare", ())) == list(own.get("tare", ())) == ["rest"]:
        off -= {"payload"}  # a tare took the weight off where no payload did
    before, after = _with_unstated(trained, off), _with_unstated(own, off)
    return [
        Difference(f.name, tuple(values), value, "refuse" if f.name in ACCEPTABLE else "warn")
        for f in fields(Setup)
        if (values := before.get(f.name))
        for value in after.get(f.name, ())
        if not _agrees(f.name, value, values) and not (f.name == "sensor" and same_sensor)
    ]


def unit_differences(trained: Mapping[str, str], meta: Mapping[str, Any]) -> list[Difference]:
    """Compare units of axes with those of a recording; what nobody stated agrees."""
    return [
        Difference("units", (f"{axis}: {unit}",), f"{axis}: {now}", "refuse")
        for axis, unit in trained.items()
        if (now := unit_of(axis, meta)) and not same_unit(now, unit) and unit
    ]


def refuse_or_list(
    found: Iterable[Difference], accept: str | Sequence[str] = (), where: str = ""
) -> tuple[str, ...]:
    """Refuse what cannot work unless it is accepted, and return the rest in words; `where` begins a message."""
    accepted = (accept,) if isinstance(accept, str) else tuple(accept)
    other = next((name for name in accepted if name not in ACCEPTABLE), None)
    if other is not None:
        raise argument_error(GranularIdError, "accept", f"must be of {', '.join(ACCEPTABLE)}, got {other!r}")
    found = list(found)
    for difference in found:
        if difference.consequence == "refuse" and difference.name not in accepted:
            raise GranularIdError(
                f"{where}{setup_mismatch(str(difference))}; nothing is turned or converted unasked: bring recordings "
                f"into the {difference.name} of the training, train on such of this set-up, or where only the name is "
                f"another, pass {in_both(accept=difference.name)}"
            )
    return tuple(str(difference) for difference in found)


def setup_mismatch(*differences: str) -> str:
    """Say that recordings or a sensor are not of the set-up of a training, for messages and warnings."""
    return f"another set-up than in the training: {'; '.join(differences)}"


def _first(places: Sequence[Mapping[str, Any]], key: str) -> Any:
    return next((value for place in places if (value := place.get(key)) is not None), None)


def _tree(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _text(value: Any, unit: str = "") -> str | None:
    """Return a value of the metadata as it is compared and shown."""
    if value is None or value == "":
        return None
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, (int, float)):
        return f"{str(value).removesuffix('.0')}{unit}"  # all digits: a serial number may have many
    text = value if isinstance(value, str) else json.dumps(thaw(value), sort_keys=True)
    return text.strip()[:_LONGEST] or None
