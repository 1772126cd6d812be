"""What a source of wrenches is, and how a URL becomes one, or a robot.

A sensor, a file played again and a simulation are the same to the rest of the program: they say what they measure
(`SourceInfo`), write rows into a buffer from `start` to `stop`, and say how they are (`Health`).
"""

from __future__ import annotations

import logging
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass, field, fields
from importlib import import_module
from importlib.metadata import entry_points
from typing import Any, Protocol, runtime_checkable
from urllib.parse import parse_qsl, unquote, urlsplit

from granular_id._checks import (
    argument_error,
    checked_text,
    finite_number,
    freeze,
    items_of,
    positive_number,
    thaw,
)
from granular_id._core import AXES, UNITS, GranularIdError, WrenchBuffer, host_ns
from granular_id.live.robot import Robot

__all__ = ["Health", "SourceInfo", "SourceUrl", "ThreadedSource", "WrenchSource", "open_robot", "open_source"]

_LOG = logging.getLogger(__name__)

# Schemes of this package: modules of these names, with ``open_url(url: SourceUrl) -> WrenchSource``.
_MOST_SPEED = 1000.0
"""A push takes 4 ms then; buffers hold seconds of their source, and grow with it."""

_OWN = ("rdt", "replay", "sim")
# Groups of entry points by which other packages bring more: scheme -> function of a `SourceUrl`.
_SOURCES, _ROBOTS = "granular_id.sources", "granular_id.robots"
# Schemes of ``contrib/`` in the repository: known, installed or not.
_CONTRIBUTED = {_SOURCES: ("bota", "ros2", "ur"), _ROBOTS: ("ur",)}
_MISSING = "granular-id-contrib, which is not installed: pip install ./contrib in a clone of the repository"

_STOP_S = 1.0
# How often samples without a sensor are handed over, two at a time at 500 Hz as packets come, and how much of them.
_PERIOD_S, _MOST_S = 0.004, 0.1


@dataclass(frozen=True)
class SourceInfo:
    """What a source measures; stored with every recording made from it.

    Parameters
    ----------
    name : str
        What people call it: ``"ATI Net F/T 192.168.1.1"``.
    rate_hz : float
        Samples per second of device time.
    tick_hz : float, default 1e9
        Ticks per second of its device time.
    device_clock : bool
        Whether samples carry the sensor's own time; False: they are counted, and times follow from the rate.
    frame, sign : str, optional
        Axes and origin that the wrench refers to; whose force on whom.
    compensated : bool, optional
        Whether the tool's weight is taken off; None: not known.
    filter_hz : float, optional
        Cut-off of the low-pass filter within the sensor; None: not known, or none.
    full_scale : tuple of float, optional
        Range of each axis, in its unit, above 0.
    serial : str, optional
        Serial number or calibration.
    synthetic : bool, default False
        True for everything that no sensor has measured; shown wherever its samples or results are.
    speed : float, default 1
        Device seconds per second: another number for simulations and replays that run faster or slower.
    meta : mapping, optional
        Whatever else is known, JSON-like.
    axes, units : tuple of str
        Names of the columns of its rows and their units, "" where not known. Default: those of a wrench, N and N m.
    repeats : bool, default False
        True where rows may be equal to the one before for long: a bus that holds its last value, a sensor coarser
        than its noise. Elsewhere a sensor whose rows repeat has failed.

    Examples
    --------
    >>> from granular_id.live import SourceInfo
    >>> SourceInfo("bench sensor", 500, device_clock=False).to_dict()["rate_hz"]
    500.0
    """

    name: str
    rate_hz: float
    _: KW_ONLY
    tick_hz: float = 1e9
    device_clock: bool
    frame: str | None = None
    sign: str | None = None
    compensated: bool | None = None
    filter_hz: float | None = None
    full_scale: tuple[float, ...] | None = None
    serial: str | None = None
    synthetic: bool = False
    speed: float = 1.0
    meta: Mapping[str, Any] = field(default_factory=dict)
    axes: tuple[str, ...] = AXES
    units: tuple[str, ...] = ()
    repeats: bool = False

    def __post_init__(self) -> None:
        checked_text(self.name, "name")
        axes = items_of("axes", self.axes, str)
        units = items_of("units", self.units, str) or (UNITS if axes == AXES else ("",) * len(axes))
        scale = self.full_scale
        if scale is not None:
            scale = tuple(positive_number("full_scale", value) for value in scale)
        for name, each in (("units", units), ("full_scale", scale)):
            if each is not None and len(each) != len(axes):
                problem = f"must be one for each of {len(axes)} axes, got {len(each)}"
                raise argument_error(GranularIdError, name, problem)
        checked = {"axes": axes, "units": units, "full_scale": scale, "meta": freeze(self.meta, "meta")}
        for name in ("rate_hz", "tick_hz"):
            checked[name] = positive_number(name, getattr(self, name))
        checked["speed"] = finite_number("speed", self.speed, positive=True, most=_MOST_SPEED)
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    def to_dict(self) -> dict[str, Any]:
        """Return what is known as JSON-like values, without what is None and the axes of a wrench."""
        known = ((each.name, thaw(getattr(self, each.name))) for each in fields(self))
        usual = () if self.axes != AXES else ("axes", "units") if self.units == UNITS else ("axes",)
        return {name: value for name, value in known if value is not None and name not in usual}

    @property
    def units_of_axes(self) -> dict[str, str]:
        """Unit of each axis that is not as in a wrench, by its name."""
        of_wrench = dict(zip(AXES, UNITS, strict=True))
        each = zip(self.axes, self.units, strict=True)
        return {axis: unit for axis, unit in each if unit and unit != of_wrench.get(axis)}


@dataclass(frozen=True)
class Health:
    """How a source is.

    Parameters
    ----------
    running : bool
        Between `start` and `stop`, and alive.
    error : str or None
        Why it died, if it did.
    finished : bool
        It has come to its end: no more rows will follow.
    counters : mapping
        What it has counted: packets, rejects, whatever it knows.
    """

    running: bool
    error: str | None = None
    finished: bool = False
    counters: Mapping[str, int] = field(default_factory=dict)


@runtime_checkable
class WrenchSource(Protocol):
    """Anything that delivers wrenches, as `ThreadedSource` does."""

    @property
    def info(self) -> SourceInfo:
        """What it measures; known before `start`."""

    def start(self, buffer: WrenchBuffer) -> None:
        """Begin to write rows, from a thread of its own; return at once, or raise."""

    def stop(self) -> None:
        """End it: no row is written after that. Safe to call twice."""

    def health(self) -> Health:
        """Say how it is; never raise, never wait."""


class ThreadedSource(ABC):
    """A source that writes rows from one Python thread.

    Subclasses implement `deliver`. What it raises ends the source and becomes the error in `health`; when it returns
    by itself, the source has finished. :doc:`/sensors/own_sensor` shows how to write one in a few lines.

    Parameters
    ----------
    info : SourceInfo

    Attributes
    ----------
    replays : bool
        True for a class whose rows are recordings of its own: they are looked at from the oldest on. Those of a
        sensor (False) count from the moment at which a push is requested.

    Notes
    -----
    A Python thread shares the interpreter with everything else, and can be late by tens of milliseconds when
    others compute: good enough for drivers that queue, for simulations and replays. `RdtSource` has a thread in Rust.
    """

    replays = False

    def __init__(self, info: SourceInfo) -> None:
        self._info = info
        self._thread: threading.Thread | None = None
        self._stopping = threading.Event()
        self._error: str | None = None
        self._finished = False

    @property
    def info(self) -> SourceInfo:
        """What the source measures."""
        return self._info

    @property
    def threads(self) -> list[int]:
        """Native ids of the threads that read the sensor: they get real-time priority while a robot moves."""
        native = None if self._thread is None else self._thread.native_id
        return [] if native is None else [native]

    @abstractmethod
    def deliver(self, buffer: WrenchBuffer, stopping: threading.Event) -> None:
        """Push rows into `buffer` until there are no more or `stopping` is set; runs in the source's own thread."""

    def start(self, buffer: WrenchBuffer) -> None:
        """Begin to write rows into `buffer`; every source runs once, else RuntimeError."""
        if self._thread is not None or self._stopping.is_set():
            raise RuntimeError(f"{self._info.name} runs once: open the source anew")
        name = f"source {self._info.name}"
        self._thread = threading.Thread(target=self._work, args=(buffer,), name=name, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End the source; safe to call again.

        Waits 1 s at most for the thread. One that still runs then, because the driver hangs, is left behind with an
        error in the log: it ends with the program.
        """
        self._stopping.set()
        if self._thread is None or self._thread is threading.current_thread():
            return
        self._thread.join(_STOP_S)
        if self._thread.is_alive():
            _LOG.error("%s did not stop within %g s: its driver hangs", self._info.name, _STOP_S)

    def health(self) -> Health:
        """Say how the source is; never raises, never waits."""
        error, finished = self._error, self._finished
        over = finished or error is not None or self._stopping.is_set()
        alive = self._thread is not None and self._thread.is_alive()
        return Health(alive and not over, error, finished)

    def _work(self, buffer: WrenchBuffer) -> None:
        try:
            self.deliver(buffer, self._stopping)
        except Exception as error:  # whatever a driver raises: `health` shows it
            self._error = f"{type(error).__name__}: {error}"
        else:
            self._finished = not self._stopping.is_set()


class Pace:
    """Which samples of a source without a sensor are due; at a speed that is not reached, its clock waits."""

    def __init__(self, info: SourceInfo) -> None:
        self.start_ns = host_ns()
        self.rows_per_s = info.rate_hz * info.speed
        self.period_s = max(_PERIOD_S, 1 / self.rows_per_s)
        self._may_wait = info.speed != 1
        self._most = max(1, round(_MOST_S * self.rows_per_s))

    def due(self, n_done: int) -> int:
        """Return how many samples are due after the first `n_done`."""
        late = 1e-9 * (host_ns() - self.start_ns) * self.rows_per_s + 1 - n_done
        if late > self._most and self._may_wait:
            self.start_ns += round(1e9 * (late - self._most) / self.rows_per_s)
        return max(0, min(int(late), self._most))


@dataclass(frozen=True)
class SourceUrl:
    """A URL taken apart: ``scheme://host:port/path?options`` or ``scheme:path?options``.

    Values of options are not checked here but by what takes them. `open_source` and `open_robot` put the URL before
    each ValueError.

    Attributes
    ----------
    text : str
        As it was given.
    scheme, host, path : str
        Decoded. The host is empty in the second form; in the first the path begins with a slash or is empty.
    port : int or None
    options : mapping
        Text where it stands in the URL, any value where it was given by keyword.
    """

    text: str
    scheme: str
    host: str
    port: int | None
    path: str
    options: Mapping[str, object]

    @classmethod
    def parse(cls, url: object, options: Mapping[str, object]) -> SourceUrl:
        """Take a URL apart, or say what cannot be read, is missing or stands there twice.

        Examples
        --------
        >>> from granular_id.live import SourceUrl
        >>> SourceUrl.parse("rdt://10.0.0.7:49153?variant=axia", {}).port
        49153
        """
        if not isinstance(url, str):
            raise TypeError(f"url must be a str like 'sim:rice', got {type(url).__name__}")
        try:
            split = urlsplit(url, allow_fragments=False)
            port = split.port
            pairs = parse_qsl(split.query, keep_blank_values=True, strict_parsing=True) if split.query else []
        except ValueError as error:
            wanted = "wanted scheme://HOST:PORT/PATH?name=value&name=value, or scheme:PATH?..."
            raise GranularIdError(f"url {url!r} cannot be read: {error}; {wanted}") from error
        if not split.scheme or not url.partition(":")[2]:
            raise GranularIdError(
                f"url {url!r} names no source; wanted one like 'sim:rice' or 'rdt://192.168.1.1'"
            )
        merged = dict(options)
        for name, value in pairs:
            if name in merged:
                raise GranularIdError(f"option {name!r} of url {url!r} is given twice")
            merged[name] = value
        host = split.netloc if port is None else split.netloc.rpartition(":")[0]
        return cls(url, split.scheme, host.strip("[]"), port, unquote(split.path), merged)

    def allow(self, *names: str) -> None:
        """Refuse every option but these; the error names them."""
        for name in self.options:
            if name not in names:
                known = ", ".join(sorted(names)) or "none"
                raise GranularIdError(f"there is no option {name!r}; known: {known}")

    def need_host(self) -> str:
        """Return the host, or say that there is none."""
        if not self.host:
            raise GranularIdError(f"there is no host; wanted {self.scheme}://HOST")
        return self.host

    def number(self, name: str, default: Any) -> Any:
        """Return an option, as a float where it is text; `default` where it is not given."""
        return self._value(name, default, float, "a number")

    def whole(self, name: str, default: Any) -> Any:
        """Return an option, as an int where it is text; `default` where it is not given."""
        return self._value(name, default, int, "a whole number")

    def words(self, name: str) -> Any:
        """Return an option that is a list, in a URL divided by commas; None where it is not given."""
        return self._value(name, None, lambda text: tuple(part.strip() for part in text.split(",")), "texts")

    def _value(self, name: str, default: Any, kind: Callable[[str], Any], wanted: str) -> Any:
        value = self.options.get(name, default)
        if not isinstance(value, str):
            return value  # whoever takes it checks it, as without a URL
        try:
            return kind(value)
        except ValueError:
            raise GranularIdError(f"option {name}={value!r}; wanted {wanted}") from None


def open_source(url: str, **options: object) -> WrenchSource:
    """Make a source of a URL; nothing moves and no row is read before its `start`.

    Parameters
    ----------
    url : str
        ``sim:rice?speed=10``, ``replay:recordings``, ``rdt://192.168.1.1``, or what other packages bring as entry
        points of the group ``granular_id.sources``: ``ur://HOST``, ``bota:config.json``,
        ``ros2://ft_sensor/wrench?rate_hz=500`` from ``contrib/`` in the repository. A ``?`` or ``%`` that belongs to
        a path is written ``%3F`` or ``%25``.
    **options
        The same options as after the ``?``, as values of Python.

    Raises
    ------
    ValueError, TypeError
        No URL, an unknown scheme or option (the known ones are listed), or a value that is none.
    ImportError
        The package of that sensor, or its library, is not installed; says which.
    OSError
        The sensor does not answer, or the file is not there.

    Examples
    --------
    >>> from granular_id.live import open_source
    >>> open_source("sim:rice?seed=1").info.synthetic
    True
    >>> open_source("simm:rice")
    Traceback (most recent call last):
    ...
    granular_id.GranularIdError: url 'simm:rice' has the scheme 'simm'; known: bota, rdt, replay, ros2, sim, ur
    """
    source: WrenchSource = _opened(_SOURCES, SourceUrl.parse(url, options))
    return source


def open_robot(url: str, **options: object) -> Robot:
    """Connect to a robot by its URL; nothing moves.

    Parameters
    ----------
    url : str
        ``ur://192.168.0.3``, from ``contrib/`` in the repository, or what other packages bring as entry points of the
        group ``granular_id.robots``.
    **options
        As in `open_source`, which raises the same errors.

    Examples
    --------
    >>> from granular_id.live import open_robot
    >>> open_robot("gantry://here")
    Traceback (most recent call last):
    ...
    granular_id.GranularIdError: robot 'gantry://here' has the scheme 'gantry'; known: ur
    """
    robot: Robot = _opened(_ROBOTS, SourceUrl.parse(url, options))
    return robot


def _opened(group: str, url: SourceUrl) -> Any:
    own = _OWN if group == _SOURCES else ()
    if url.scheme in own:
        open_url = import_module(f"granular_id.live.{url.scheme}").open_url
    else:
        found = {point.name: point for point in entry_points(group=group)}
        if url.scheme not in found:
            if url.scheme in _CONTRIBUTED[group]:
                raise ImportError(f"url {url.text!r} needs {_MISSING}")
            known = ", ".join(sorted({*own, *found, *_CONTRIBUTED[group]}))
            problem = f"{url.text!r} has the scheme {url.scheme!r}; known: {known}"
            raise argument_error(GranularIdError, "url" if group == _SOURCES else "robot", problem)
        open_url = found[url.scheme].load()
    try:
        return open_url(url)
    except ValueError as error:
        raise GranularIdError(f"url {url.text!r}: {error}") from error
