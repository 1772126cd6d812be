"""What a walk through a bag finds: its topics, and the messages of those that carry wrenches."""

from __future__ import annotations

from array import array
from dataclasses import dataclass, field
from pathlib import Path

from granular_id.io.errors import RecordingFileError
from granular_id.io.ros.wrench import STAMPED, WRENCH_TYPES

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
        Whether messages are kept: those of wrenches, unless another topic was asked for.
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
        """Whether the messages can be read as wrenches."""
        return self.type_name in WRENCH_TYPES and self.encoding in _ENCODINGS

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
            topic.kept = topic.is_wrench and self._wanted in (None, name.strip("/"))
            self._topics[key] = topic
        return self._topics[key]

    @property
    def n_kept(self) -> int:
        """Messages kept so far."""
        return sum(topic.count for topic in self._topics.values() if topic.kept)

    def chosen(self) -> Topic:
        """Return the one topic to read.

        Raises
        ------
        RecordingFileError
            None, or several; which there are.
        """
        every = [topic for topic in self._topics.values() if topic.count]
        wrenches = [topic for topic in every if topic.is_wrench]
        if self._wanted is None:
            if len(wrenches) > 1:
                problem = f"has {len(wrenches)} topics with wrenches: {_listed(wrenches)}; choose by topic="
                raise RecordingFileError(self._path, problem)
            if not wrenches:
                problem = f"has no messages of type {STAMPED} or Wrench; it has {_listed(every)}"
                raise RecordingFileError(self._path, problem)
            return wrenches[0]
        named = [topic for topic in every if topic.name.strip("/") == self._wanted]
        if len(named) != 1 or not named[0].is_wrench:
            what = (
                "no messages" if not named else "no wrenches" if len(named) == 1 else "messages of two types"
            )
            problem = f"has {what} on topic {self._asked!r}; it has {_listed(every)}"
            raise RecordingFileError(self._path, problem)
        return named[0]


def _listed(topics: list[Topic]) -> str:
    if not topics:
        return "no messages at all"
    more = f" and {len(topics) - _LISTED} more" if len(topics) > _LISTED else ""
    return ", ".join(map(str, topics[:_LISTED])) + more


def shown(text: str) -> str:
    """Make text from a file fit for a line of an error."""
    return (text if text.isprintable() else ascii(text))[:80] or "''"
