"""What a walk through a bag finds: its topics, and the messages of those that carry wrenches."""

from __future__ import annotations

from array import array
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import cast

from granular_id.io.errors import RecordingFileError
from granular_id.io.ros.inside import Inside, may_hold_wrench
from granular_id.io.ros.wrench import STAMPED, WRENCH_TYPES, Encoding

__all__ = ["Topic", "Topics", "shown"]

_LISTED = 12
_ENCODINGS = ("cdr", "ros1")


@dataclass
class Topic:
    """One topic: how many messages, from when to when, and their bytes if they are wanted.

    Attributes
    ----------
    name : str
    type_name : str
        Like ``geometry_msgs/WrenchStamped``, without the ``/msg/`` of ROS 2.
    encoding : str
        ``"cdr"``, ``"ros1"`` or what else the file says.
    kept : bool
        Whether messages are kept: those that may hold wrenches, unless another topic was asked for.
    node : str or None
        Who published it, where the bag says (ROS 1).
    definition : str
        The message definition in the bag, empty where there is none.
    count, first_ns, last_ns : int
        Messages and their earliest and latest log time.
    data, lengths, log_ns
        Bytes of the messages kept, one after the other; length and log time of each.
    """

    name: str
    type_name: str
    encoding: str
    kept: bool = False
    node: str | None = None
    definition: str = ""
    count: int = 0
    first_ns: int = 0
    last_ns: int = 0
    data: bytearray = field(default_factory=bytearray)
    lengths: array[int] = field(default_factory=lambda: array("q"))
    log_ns: array[int] = field(default_factory=lambda: array("Q"))

    @property
    def is_wrench(self) -> bool:
        """Whether the messages are wrenches, of the plain types."""
        return self.type_name in WRENCH_TYPES and self.encoding in _ENCODINGS

    @property
    def may_hold_wrench(self) -> bool:
        """Whether the messages, of another type, may have wrenches as fields."""
        known = self.is_wrench or self.encoding not in _ENCODINGS
        return not known and may_hold_wrench(self.definition)

    @cached_property
    def inside(self) -> Inside:
        """Return the type of the messages, by its definition; ValueError where that is no proper one."""
        return Inside(self.definition, self.type_name, cast(Encoding, self.encoding))

    def seen(self, log_ns: int) -> None:
        """Count a message."""
        if not self.count:
            self.first_ns = self.last_ns = log_ns
        elif log_ns > self.last_ns:
            self.last_ns = log_ns
        elif log_ns < self.first_ns:
            self.first_ns = log_ns
        self.count += 1

    def keep(self, log_ns: int, message: bytes | memoryview) -> None:
        """Count a message and keep its bytes."""
        self.seen(log_ns)
        self.data += message
        self.lengths.append(len(message))
        self.log_ns.append(log_ns)

    def __str__(self) -> str:
        span_s = (self.last_ns - self.first_ns) / 1e9
        rate = f", {(self.count - 1) / span_s:.4g} Hz" if span_s > 0 else ""
        encoding = "" if self.encoding in _ENCODINGS else f" in {shown(self.encoding)}"
        return f"{shown(self.name)} ({shown(self.type_name)}{encoding}, {self.count} messages{rate})"


class Topics:
    """All topics of one bag.

    Parameters
    ----------
    path : Path
        The bag, for errors.
    wanted : str or None
        The topic that was asked for.
    """

    def __init__(self, path: Path, wanted: str | None) -> None:
        self._path = path
        self._asked = wanted
        self._wanted = None if wanted is None else wanted.strip("/")
        self._topics: dict[tuple[str, str, str], Topic] = {}

    def add(
        self, name: str, type_name: str, encoding: str, *, node: str | None = None, definition: str = ""
    ) -> Topic:
        """Return the topic of this name and type, new or known."""
        type_name = type_name.replace("/msg/", "/")
        key = (name, type_name, encoding)
        if key not in self._topics:
            topic = Topic(name, type_name, encoding, node=node, definition=definition)
            asked = self._wanted is None or self._field_asked(topic) is not None
            topic.kept = asked and (topic.is_wrench or topic.may_hold_wrench)
            self._topics[key] = topic
        return self._topics[key]

    @property
    def n_kept(self) -> int:
        """Messages kept so far."""
        return sum(topic.count for topic in self._topics.values() if topic.kept)

    def chosen(self) -> tuple[Topic, str, list[str]]:
        """Return the one topic to read, which field of its messages is the wrench ("" the whole), and notes.

        Raises
        ------
        RecordingFileError
            None, or several; which there are.
        """
        every = [topic for topic in self._topics.values() if topic.count]
        if self._wanted is None:
            found = [topic for topic in every if topic.is_wrench]
            others = [topic for topic in every if topic.may_hold_wrench]
        else:
            fields = [(topic, self._field_asked(topic)) for topic in every]
            named = [topic for topic, field in fields if field == ""]  # MCAP may have dots in names of topics
            named = named or [topic for topic, field in fields if field and not topic.is_wrench]
            if len(named) != 1 or not (named[0].is_wrench or named[0].may_hold_wrench):
                what = (
                    "no messages"
                    if not named
                    else "no wrenches"
                    if len(named) == 1
                    else "messages of two types"
                )
                raise self._refusal(f"has {what} on topic {self._asked!r}; it has {_listed(every)}")
            found = [topic for topic in named if topic.is_wrench]
            others = [topic for topic in named if topic not in found]
        if len(found) > 1:
            raise self._refusal(f"has {len(found)} topics with wrenches: {_listed(found)}; choose by topic=")
        if found:
            beside = f"wrenches in {_listed(others)} are not read; topic= chooses them" if others else ""
            return found[0], "", [beside] if beside else []
        return self._chosen_inside(others, every)

    def _chosen_inside(self, topics: list[Topic], every: list[Topic]) -> tuple[Topic, str, list[str]]:
        """Choose among the wrenches inside messages of other types."""
        wrenches = [(topic, field) for topic in topics for field in self._fields_of(topic)]
        asked = None if self._wanted is None else self._field_asked(topics[0])
        if asked:
            wrenches = [pair for pair in wrenches if pair[1] == asked] or wrenches
        if len(wrenches) == 1 and asked in (None, "", wrenches[0][1]):
            topic, field = wrenches[0]
            return topic, field, [f"the wrench is the field {field} of {shown(topic.type_name)}"]
        if not wrenches:
            problem = f"has no messages of type {STAMPED} or Wrench, nor with one as a field"
            unknown = any(not topic.definition for topic in every)
            way_out = "; `ros2 bag convert` to mcap, where the types are installed, adds definitions that are missing"
            raise self._refusal(f"{problem}; it has {_listed(every)}{way_out * unknown}")
        fields = ", ".join(f"{shown(topic.name)}.{field[:80]}" for topic, field in wrenches[:_LISTED])
        more = f" and {len(wrenches) - _LISTED} more" if len(wrenches) > _LISTED else ""
        some = "no wrench" if asked else f"{len(wrenches)} wrenches"
        where = f" {self._asked!r}" if asked else ""
        raise self._refusal(f"has {some}{where} inside its messages: {fields}{more}; choose by topic=")

    def _fields_of(self, topic: Topic) -> list[str]:
        try:
            return list(topic.inside.places)
        except ValueError as error:
            raise self._refusal(f"has {topic}, but {error}") from error

    def _field_asked(self, topic: Topic) -> str | None:
        """Return the field of its messages that was asked for ("": any); None where another topic was."""
        name = topic.name.strip("/")
        if self._wanted is None or self._wanted == name:
            return ""
        return self._wanted[len(name) + 1 :] or None if self._wanted.startswith(f"{name}.") else None

    def _refusal(self, problem: str) -> RecordingFileError:
        return RecordingFileError(self._path, problem)


def _listed(topics: list[Topic]) -> str:
    if not topics:
        return "no messages at all"
    more = f" and {len(topics) - _LISTED} more" if len(topics) > _LISTED else ""
    return ", ".join(map(str, topics[:_LISTED])) + more


def shown(text: str) -> str:
    """Make text from a file fit for a line of an error."""
    return (text if text.isprintable() else ascii(text))[:80] or "''"
