"""What a source of wrenches is, and how a URL becomes one, or a robot.

A sensor, a file played again and a simulation are all the same to the rest of the program: something that says
what it measures (`SourceInfo`), writes rows into a buffer from `start` to `stop`, and tells how it is (`Health`).
"""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field, fields
from importlib import import_module
from importlib.metadata import entry_points
from typing import Any, Protocol, runtime_checkable

from numpy.typing import ArrayLike

from granular_id._checks import (
    argument_error,
    checked_text,
    finite_number,
    freeze,
    items_of,
    positive_number,
    thaw,
)
from granular_id._core import AXES, UNITS
from granular_id.live.robot import Robot
from granular_id.live.source_url import SourceUrl

__all__ = [
    "SCHEMES",
    "Health",
    "SourceInfo",
    "ThreadedSource",
    "WrenchSink",
    "WrenchSource",
    "open_robot",
    "open_source",
]

SCHEMES: Mapping[str, tuple[str, str]] = {
    "rdt": ("granular_id.live.rdt", "rdt://HOST[:PORT], an ATI Net F/T or OnRobot box"),
    "replay": ("granular_id.live.replay", "replay:PATH[?speed=10], recordings played again"),
    "sim": ("granular_id.live.sim", "sim:MATERIAL[?speed=10&seed=1] or sim:unknown, a simulated sensor"),
}
"""Scheme of a URL -> module with ``open_url(url: SourceUrl) -> WrenchSource``, loaded when asked for, and its form.

Other packages bring more as entry points: scheme -> function that makes a source, or a robot, of a `SourceUrl`.
"""

_SOURCES, _ROBOTS = "granular_id.sources", "granular_id.robots"

_CONTRIBUTED = {_SOURCES: ("bota", "ros2", "ur"), _ROBOTS: ("ur",)}
"""Schemes of ``contrib/`` in the repository: known, installed or not."""

_STOP_S = 5.0
"""How long `stop` waits for the thread: longer than any driver call should take to return."""


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
        Unit of its device time: ticks per second.
    device_clock : bool
        Whether samples carry the sensor's own time; False: they are counted, and times follow from the rate.
    frame : str, optional
        Axes and origin that the wrench refers to.
    sign : str, optional
        Whose force on whom.
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
    axes : tuple of str, default fx fy fz tx ty tz
        Names of the columns of its rows.
    units : tuple of str, optional
        Unit of each axis, empty where it is not known. Default: N and N m of a wrench, else not known.

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

    def __post_init__(self) -> None:
        checked_text(self.name, "name")
        axes = items_of("axes", self.axes, str)
        units = items_of("units", self.units, str) or (UNITS if axes == AXES else ("",) * len(axes))
        if len(units) != len(axes):
            raise argument_error(
                ValueError, "units", f"must be one for each of {len(axes)} axes, got {len(units)}"
            )
        object.__setattr__(self, "axes", axes)
        object.__setattr__(self, "units", units)
        object.__setattr__(self, "rate_hz", finite_number("rate_hz", self.rate_hz, positive=True))
        object.__setattr__(self, "tick_hz", finite_number("tick_hz", self.tick_hz, positive=True))
        if self.full_scale is not None:
            full_scale = tuple(positive_number("full_scale", value) for value in self.full_scale)
            if len(full_scale) != len(axes):
                raise ValueError(
                    f"full_scale must hold {len(axes)} numbers, one an axis, got {len(full_scale)}"
                )
            object.__setattr__(self, "full_scale", full_scale)
        object.__setattr__(self, "speed", positive_number("speed", self.speed))
        object.__setattr__(self, "meta", freeze(self.meta, "meta"))

    def to_dict(self) -> dict[str, Any]:
        """Return everything that is known as plain JSON-like values; what is unknown (None) is left out.

        So are the axes of a wrench and their units.
        """
        known = ((f.name, thaw(getattr(self, f.name))) for f in fields(self))
        usual = {"axes"} | ({"units"} if self.units == UNITS else set()) if self.axes == AXES else set()
        return {
            name: value for name, value in known if value is not None and value != {} and name not in usual
        }

    @property
    def units_of_axes(self) -> dict[str, str]:
        """Unit of each axis that is not as in a wrench, by its name, as recordings keep them."""
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


class WrenchSink(Protocol):
    """Where a source writes its rows: a `WrenchBuffer`, or anything with these three methods."""

    def push(
        self, wrench: ArrayLike, t: float | None = None, *, flags: int = 0, host_ns: int | None = None
    ) -> Any:
        """Write one row (C,); `t` is device time in seconds, None: one period after the last row."""

    def push_block(
        self,
        wrench: ArrayLike,
        t: ArrayLike | None = None,
        *,
        flags: ArrayLike | None = None,
        host_ns: ArrayLike | None = None,
    ) -> Any:
        """Write rows (n, C) with their times (n,)."""

    def new_epoch(self) -> Any:
        """Say that device time begins anew: nothing that follows joins what came before."""


@runtime_checkable
class WrenchSource(Protocol):
    """Anything that delivers wrenches.

    :doc:`/sensors/own_sensor` shows how to write one in a few lines.
    """

    @property
    def info(self) -> SourceInfo:
        """What it measures; known before `start`."""

    def start(self, buffer: WrenchSink) -> None:
        """Begin to write rows into `buffer`, from a thread of its own; returns at once, or raises."""

    def stop(self) -> None:
        """End it; after that no row is written. Safe to call twice."""

    def health(self) -> Health:
        """Tell how it is; never raises, never waits."""


class ThreadedSource(ABC):
    """A source that writes rows from one Python thread.

    Subclasses implement `deliver`; start, stop, errors and health are kept here. What `deliver` raises ends the
    source and becomes the error in `health`; when it returns by itself, the source has finished.

    Parameters
    ----------
    info : SourceInfo

    Notes
    -----
    A Python thread shares the interpreter with everything else, and can be late by tens of milliseconds when
    others compute: good enough for drivers that queue, for simulations and replays. `rdt` has a thread in Rust.
    """

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
        """Native ids of the threads that read the sensor: they may get real-time priority, see `drive`."""
        native = None if self._thread is None else self._thread.native_id
        return [] if native is None else [native]

    @abstractmethod
    def deliver(self, buffer: WrenchSink, stopping: threading.Event) -> None:
        """Write rows until there are no more or `stopping` is set; runs in the source's own thread."""

    def counters(self) -> dict[str, int]:
        """Return what `health` is to tell beside; nothing by default."""
        return {}

    def start(self, buffer: WrenchSink) -> None:
        """Begin to write rows into `buffer`.

        Raises
        ------
        RuntimeError
            It has been started or stopped before: every source runs once.
        """
        if self._thread is not None or self._stopping.is_set():
            how = "stopped" if self._thread is None else "started"
            raise RuntimeError(f"{self._info.name} was {how} before; open the source anew")
        self._thread = threading.Thread(
            target=self._work, args=(buffer,), name=f"source {self._info.name}", daemon=True
        )
        self._thread.start()

    def stop(self) -> None:
        """End the thread and wait for it.

        Raises
        ------
        RuntimeError
            The thread does not end within 5 s: a driver hangs.
        """
        self._stopping.set()
        if self._thread is None or self._thread is threading.current_thread():
            return
        self._thread.join(_STOP_S)
        if self._thread.is_alive():
            raise RuntimeError(f"{self._info.name} did not stop within {_STOP_S:g} s: its driver hangs")

    def health(self) -> Health:
        """Tell how the source is."""
        error, finished = self._error, self._finished
        over = finished or error is not None or self._stopping.is_set()
        alive = self._thread is not None and self._thread.is_alive()
        return Health(alive and not over, error, finished, self.counters())

    def _work(self, buffer: WrenchSink) -> None:
        try:
            self.deliver(buffer, self._stopping)
        except Exception as error:  # whatever a driver raises: `health` tells it
            self._error = f"{type(error).__name__}: {error}"
        else:
            self._finished = not self._stopping.is_set()


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

    Returns
    -------
    WrenchSource

    Raises
    ------
    ValueError, TypeError
        No URL, an unknown scheme (the known ones are listed), an unknown option (the scheme's are listed) or a
        value that is none.
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
    ValueError: url 'simm:rice' has the scheme 'simm'; known: bota, rdt, replay, ros2, sim, ur
    """
    parsed = SourceUrl.parse(url, options)
    if parsed.scheme in SCHEMES:
        source: WrenchSource = import_module(SCHEMES[parsed.scheme][0]).open_url(parsed)
    else:
        source = _opened_plugin(_SOURCES, "url", parsed)
    return source


def open_robot(url: str, **options: object) -> Robot:
    """Connect to a robot by its URL; nothing moves.

    Robots come from other packages, as entry points of the group ``granular_id.robots``: ``ur://HOST``
    from ``contrib/`` in the repository.

    Parameters
    ----------
    url : str
        ``ur://192.168.0.3``.
    **options
        The same options as after the ``?``, as values of Python.

    Returns
    -------
    Robot

    Raises
    ------
    ValueError, TypeError
        No URL, an unknown scheme (the known ones are listed), or options that the robot does not have.
    ImportError
        The package of that robot, or its library, is not installed; says which.

    Examples
    --------
    >>> from granular_id.live import open_robot
    >>> open_robot("gantry://here")
    Traceback (most recent call last):
    ...
    ValueError: robot 'gantry://here' has the scheme 'gantry'; known: ur
    """
    robot: Robot = _opened_plugin(_ROBOTS, "robot", SourceUrl.parse(url, options))
    return robot


def _opened_plugin(group: str, argument: str, url: SourceUrl) -> Any:
    found = {point.name: point for point in entry_points(group=group)}
    if url.scheme in found:
        return found[url.scheme].load()(url)
    if url.scheme in _CONTRIBUTED[group]:
        raise ImportError(
            f"url {url.text!r} needs granular-id-contrib, which is not installed: pip install ./contrib "
            "in a clone of the repository of granular-id"
        )
    known = {*found, *_CONTRIBUTED[group], *(SCHEMES if group == _SOURCES else ())}
    text = f"{url.text!r} has the scheme {url.scheme!r}; known: {', '.join(sorted(known))}"
    raise argument_error(ValueError, argument, text)
