"""The topics of a bag, and which of them holds the wrench."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from granular_id.io.errors import RecordingFileError
from granular_id.io.ros.message_type import MessageType, may_hold_wrench, message_type
from granular_id.io.ros.wrench import STAMPED, WRENCH_TYPES

__all__ = ["Topic", "chosen_topic"]

_LISTED = 12
_ENCODINGS = ("cdr", "ros1")


@dataclass
class Topic:
    """One topic: its type without the ``/msg/`` of ROS 2; its messages (log time in ns, bytes), where they are kept."""

    name: str
    type_name: str
    encoding: str
    definition: str = ""
    node: str | None = None
    messages: Iterable[tuple[int, bytes]] = ()
    count: int = 0
    span_ns: int = 0

    @property
    def is_wrench(self) -> bool:
        """Whether the messages are wrenches, of the plain types."""
        return self.type_name in WRENCH_TYPES and self.encoding in _ENCODINGS

    @property
    def may_hold_wrench(self) -> bool:
        """Whether the messages are wrenches, or may have them as fields."""
        return self.is_wrench or (self.encoding in _ENCODINGS and may_hold_wrench(self.definition))

    @property
    def message_type(self) -> MessageType:
        """The type of the messages, by its definition; ValueError where that is no proper one."""
        return message_type(self.type_name, self.definition, self.encoding)

    def field_asked(self, asked: str | None) -> str | None:
        """Return the field of its messages that was asked for ("": any); None where another topic was."""
        name, asked = self.name.strip("/"), None if asked is None else asked.strip("/")
        if asked in (None, name):
            return ""
        return asked[len(name) + 1 :] or None if asked.startswith(f"{name}.") else None

    def __str__(self) -> str:
        rate = f", {(self.count - 1) * 1e9 / self.span_ns:.4g} Hz" if self.span_ns > 0 else ""
        encoding = "" if self.encoding in _ENCODINGS else f" in {self.encoding[:80]}"
        return f"{self.name[:80]} ({self.type_name[:80]}{encoding}, {self.count} messages{rate})"


def chosen_topic(topics: Iterable[Topic], path: Path, asked: str | None) -> tuple[Topic, str, list[str]]:
    """Return the one topic to read, which field of its messages is the wrench ("" the whole), and notes."""
    every = [topic for topic in topics if topic.count]
    # the name itself first: MCAP may have dots in names of topics
    named = [topic for topic in every if topic.field_asked(asked) == ""]
    named = named or [topic for topic in every if topic.field_asked(asked) and not topic.is_wrench]
    holding = [topic for topic in named if topic.may_hold_wrench]
    if asked is not None and (len(named) != 1 or not holding):
        what = "messages of two types" if len(named) > 1 else "no wrenches" if named else "no messages"
        raise RecordingFileError(path, f"has {what} on topic {asked!r}; it has {_listed(every)}")
    plain = [topic for topic in holding if topic.is_wrench]
    others = [topic for topic in holding if not topic.is_wrench]
    if len(plain) > 1:
        problem = f"has {len(plain)} topics with wrenches: {_listed(plain)}; choose by topic="
        raise RecordingFileError(path, problem)
    if not plain:
        return _chosen_inside(others, every, path, asked)
    beside = [f"wrenches in {_listed(others)} are not read; topic= chooses them"] if others else []
    return plain[0], "", beside


def _chosen_inside(
    topics: Sequence[Topic], every: Sequence[Topic], path: Path, asked: str | None
) -> tuple[Topic, str, list[str]]:
    """Choose among the wrenches inside messages of other types."""
    inside = [(topic, field) for topic in topics for field in _fields_of(topic, path)]
    field_asked = topics[0].field_asked(asked) if topics else ""
    found = [pair for pair in inside if not field_asked or pair[1] == field_asked]
    if len(found) == 1:
        topic, field = found[0]
        return topic, field, [f"the wrench is the field {field} of {topic.type_name}"]
    if not inside:
        problem = (
            f"has no messages of type {STAMPED} or Wrench, nor with one as a field; it has {_listed(every)}"
        )
        if any(not topic.definition for topic in every):
            problem += "; `ros2 bag convert` to mcap, where the types are installed, adds definitions that are missing"
        raise RecordingFileError(path, problem)
    listed = ", ".join(f"{topic.name[:80]}.{field[:80]}" for topic, field in inside[:_LISTED])
    more = f" and {len(inside) - _LISTED} more" if len(inside) > _LISTED else ""
    some = f"no wrench {asked!r}" if field_asked else f"{len(inside)} wrenches"
    raise RecordingFileError(path, f"has {some} inside its messages: {listed}{more}; choose by topic=")


def _fields_of(topic: Topic, path: Path) -> list[str]:
    try:
        return list(topic.message_type.wrenches)
    except (ValueError, KeyError, RecursionError) as error:
        raise RecordingFileError(path, f"has {topic}, but {error}") from error


def _listed(topics: Sequence[Topic]) -> str:
    more = f" and {len(topics) - _LISTED} more" if len(topics) > _LISTED else ""
    return ", ".join(map(str, topics[:_LISTED])) + more or "no messages at all"
