"""Sources and robots that other packages bring: entry points, found by the scheme of a URL."""

from __future__ import annotations

from importlib.metadata import EntryPoint, entry_points
from typing import Any

from granular_id._checks import argument_error
from granular_id.live.robot import Robot
from granular_id.live.source_url import SourceUrl

__all__ = ["ROBOTS", "SOURCES", "known_schemes", "open_plugin", "open_robot"]

SOURCES, ROBOTS = "granular_id.sources", "granular_id.robots"
"""Groups of entry points: scheme -> function that makes a source, or a robot, of a `SourceUrl`."""

_CONTRIBUTED = {SOURCES: ("bota", "franka", "ros2", "ur"), ROBOTS: ("franka", "ur")}
"""Schemes of ``contrib/`` in the repository."""


def _found(group: str) -> dict[str, EntryPoint]:
    return {point.name: point for point in entry_points(group=group)}


def known_schemes(group: str) -> set[str]:
    """Return the schemes that are installed, or could be from the repository."""
    return {*_found(group), *_CONTRIBUTED[group]}


def open_plugin(group: str, url: SourceUrl) -> Any:
    """Make what a URL names; None where nothing is known of its scheme.

    Raises
    ------
    ImportError
        The scheme is one of ``contrib/``, which is not installed.
    """
    point = _found(group).get(url.scheme)
    if point is not None:
        return point.load()(url)
    if url.scheme in _CONTRIBUTED[group]:
        raise ImportError(
            f"url {url.text!r} needs granular-id-contrib, which is not installed: pip install ./contrib "
            "in a clone of the repository of granular-id"
        )
    return None


def open_robot(url: str, **options: object) -> Robot:
    """Connect to a robot by its URL; nothing moves.

    Robots come from other packages, as entry points of the group ``granular_id.robots``: ``ur://HOST`` and
    ``franka://HOST`` from ``contrib/`` in the repository.

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
    ValueError: robot 'gantry://here' has the scheme 'gantry'; known: franka, ur
    """
    parsed = SourceUrl.parse(url, options)
    robot: Robot | None = open_plugin(ROBOTS, parsed)
    if robot is None:
        known = ", ".join(sorted(known_schemes(ROBOTS)))
        raise argument_error(ValueError, "robot", f"{url!r} has the scheme {parsed.scheme!r}; known: {known}")
    return robot
