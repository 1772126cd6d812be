"""Sensor boxes that speak RDT: ATI Net F/T and Ethernet Axia, OnRobot HEX; ``rdt://HOST``.

Records are received by a thread of the core, which Python's work cannot delay; see docs/sensors/rdt.md.
"""

from __future__ import annotations

import math
import weakref
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal, get_args

from granular_id._checks import argument_error, finite_number, positive_number
from granular_id._core import RDT_PORT, GranularIdError, RdtReceiver, WrenchBuffer
from granular_id.live.netft_page import RECORDED_FIELDS, SYNTHETIC_FIELD, NetftPage, NetftPageError, read_page
from granular_id.live.source import Health, SourceInfo, SourceUrl

__all__ = ["RdtSource", "open_url"]

Variant = Literal["auto", "netft", "axia", "onrobot"]
VARIANTS: tuple[Variant, ...] = get_args(Variant)

# What the core calls the thread that receives; the system keeps 15 characters of a name.
_THREAD = "granular-id-rdt"
# Times the range of the calibration: a sensor breaks before it reads so much.
_BEYOND_SENSE = 10.0
# Per newton and newton metre; OnRobot boxes have no page, and no other scale.
_ON_ROBOT_COUNTS = (10_000.0, 100_000.0)
# Cut-off by the number of ``setuserfilter``, Net F/T manual; none for 0.
_NET_FT_FILTER_HZ = {
    str(n): float(hz) for n, hz in enumerate((838, 326, 152, 73, 35, 18, 8, 5, 1500, 2000, 2500, 3000), 1)
}


class RdtSource:
    """A sensor box as a source of wrenches.

    Making one reads the box's page over HTTP (but for OnRobot, which has none): scale, units and rates are never
    assumed, and no setting of the box is changed.

    Parameters
    ----------
    host : str
        Name or address of the box.
    port : int, default 49152
        UDP port of RDT.
    http_port : int, default 80
        Where the page is.
    variant : {"auto", "netft", "axia", "onrobot"}
        Kind of box: they share the framing, not the status word. "auto" tells Net F/T and Axia apart by the page.
    rate_hz : float, optional
        Records per second. The page of ATI boxes has it, and another one here is refused; OnRobot boxes are set
        to it (default 500).
    tick_hz : float, optional
        Samples per second within the sensor, which records are stamped with; only where the page does not say.
    buffered : bool, default False
        Ask for up to 40 records per datagram: fewer datagrams, later samples.

    Raises
    ------
    NetftPageError, OSError
        The page says too little, or does not come; with its address and the field.
    ValueError
        A rate that contradicts the page.

    Examples
    --------
    >>> from granular_id.testing import FakeNetft
    >>> from granular_id.live import RdtSource
    >>> with FakeNetft() as box:
    ...     source = RdtSource("127.0.0.1", box.port, http_port=box.http_port)
    >>> source.info.rate_hz, source.info.tick_hz, source.info.serial
    (500.0, 7000.0, 'FT00000')
    """

    def __init__(
        self,
        host: str,
        port: int = RDT_PORT,
        *,
        http_port: int = 80,
        variant: Variant = "auto",
        rate_hz: float | None = None,
        tick_hz: float | None = None,
        buffered: bool = False,
    ) -> None:
        if variant not in VARIANTS:
            raise GranularIdError(f"variant must be one of {', '.join(VARIANTS)}, got {variant!r}")
        finite_number("http_port", http_port, least=1, most=65535)
        self._place = f"{host}:{port}"
        if variant == "onrobot":
            kind, (force, torque) = "onrobot", _ON_ROBOT_COUNTS
            self._info = _on_robot(host, 500.0 if rate_hz is None else rate_hz, tick_hz)
        else:
            page = read_page(host, http_port)
            kind = variant if variant != "auto" else "axia" if page.is_axia else "netft"
            force, torque = page.counts_per_newton, page.counts_per_newton_metre
            self._info = _of_page(page, host, kind, rate_hz, tick_hz)
        full_scale = self._info.full_scale or (math.inf,) * 6
        self._receiver = RdtReceiver(
            host,
            port,
            variant=kind,
            counts_per_newton=force,
            counts_per_newton_metre=torque,
            limits=tuple(_BEYOND_SENSE * value for value in full_scale),
            rate_hz=self._info.rate_hz,
            buffered=buffered,
        )
        # also when the interpreter ends: a box goes on sending until it is commanded to stop
        self._finalizer = weakref.finalize(self, self._receiver.stop)

    @property
    def info(self) -> SourceInfo:
        """What the box measures."""
        return self._info

    def start(self, buffer: WrenchBuffer) -> None:
        """Ask for the stream; from then on rows arrive in `buffer`, which nobody else may push into.

        Raises
        ------
        TypeError, ValueError
            `buffer` is no `WrenchBuffer`, or its `tick_hz` is not the sensor's.
        RuntimeError
            The source runs already, or another sensor has the buffer.
        ConnectionError, TimeoutError
            Nobody listens there; no record within a second: another client may own the stream.
        """
        tick_hz = self._info.tick_hz
        if getattr(buffer, "tick_hz", tick_hz) != tick_hz:
            problem = f"must have tick_hz={tick_hz:g}, as info.tick_hz says, got {buffer.tick_hz:g}"
            raise argument_error(GranularIdError, "buffer", problem)
        self._receiver.start(buffer)

    def stop(self) -> None:
        """End the stream, and tell the box to stop sending."""
        self._receiver.stop()

    def health(self) -> Health:
        """Say how the stream is. Silence of a second is an error, which ends when records come again."""
        state, silent_s = self._receiver.state()
        error = {
            "silent": f"no record from {self._place} for {silent_s:.1f} s: another client may own the stream, or the "
            "box has no power or no cable",
            "broken": f"the system cannot receive from {self._place}: is the network up?",
            "forked": "this process was forked from the one that receives; open a source of its own here",
        }.get(state)
        return Health(state in ("streaming", "silent"), error, False, self._receiver.counters())

    @property
    def threads(self) -> list[int]:
        """Native ids of the threads that receive, also those of other boxes; none where nobody lists them."""
        found = []
        for task in Path("/proc/self/task").glob("*/comm"):
            with suppress(OSError):  # a thread that has ended
                if task.read_text().strip() == _THREAD:
                    found.append(int(task.parent.name))
        return found

    def bias(self) -> None:
        """Make the present load the new zero, for every client of the box; it does not answer.

        Never done unless you call this: what the sensor carries at that moment disappears from all samples that follow.
        A source that does not run raises RuntimeError.
        """
        self._receiver.bias()


def open_url(url: SourceUrl) -> RdtSource:
    """Make a source of ``rdt://HOST[:PORT][?http_port=80&variant=auto&rate_hz=&tick_hz=&buffered=0]``."""
    url.allow("http_port", "variant", "rate_hz", "tick_hz", "buffered")
    if url.path not in ("", "/"):
        raise GranularIdError(f"it has the path {url.path!r}; wanted rdt://HOST[:PORT][?OPTIONS]")
    variant: Any = url.options.get("variant", "auto")
    return RdtSource(
        url.need_host(),
        RDT_PORT if url.port is None else url.port,
        http_port=url.whole("http_port", 80),
        variant=variant,
        rate_hz=url.number("rate_hz", None),
        tick_hz=url.number("tick_hz", None),
        buffered=bool(url.whole("buffered", 0)),
    )


def _on_robot(host: str, rate_hz: float, tick_hz: float | None) -> SourceInfo:
    period_ms = max(1, round(1000 / positive_number("rate_hz", rate_hz)))
    if not math.isclose(1000 / period_ms, rate_hz, rel_tol=1e-9):
        problem = f"must be 1000 Hz over a whole number of milliseconds for an OnRobot box, got {rate_hz:g}"
        raise argument_error(GranularIdError, "rate_hz", problem)
    # its second counter has no documented unit: taken as one per record unless stated
    ticks, meta = rate_hz if tick_hz is None else tick_hz, {"variant": "onrobot"}
    return SourceInfo(f"OnRobot {host}", rate_hz, tick_hz=ticks, device_clock=True, meta=meta)


def _of_page(
    page: NetftPage, host: str, variant: str, stated_hz: float | None, tick_hz: float | None
) -> SourceInfo:
    ticks = tick_hz if page.tick_hz is None else page.tick_hz
    if ticks is None:
        raise NetftPageError(
            f"{page.url}: fields runrate and setrate give no rate of the sensor in Hz, in which samples are stamped; "
            "state it: tick_hz=7000 for a Net F/T, for an Axia the ADC rate of its web page"
        )
    # The page rounds: a box sends every k-th sample, and 2333 is 7000 / 3. Other boxes send samples of uneven
    # distance: then what the page says is the mean.
    nearest = ticks / max(1, round(ticks / page.rate_hz))
    rate_hz = nearest if abs(nearest - page.rate_hz) < 1 else page.rate_hz
    for name, stated, found in (("rate_hz", stated_hz, rate_hz), ("tick_hz", tick_hz, ticks)):
        if stated is not None and not math.isclose(stated, found, rel_tol=1e-3):
            problem = f"={stated:g} was stated, {page.url} says {found:g}; leave it out, or set the box's rate there"
            raise argument_error(GranularIdError, name, problem)
    number = page.fields.get("setuserfilter", "")
    return SourceInfo(
        f"{page.text('prodname') or 'Net F/T'} {host}",
        rate_hz,
        tick_hz=ticks,
        device_clock=True,
        filter_hz=_NET_FT_FILTER_HZ.get(number) if variant == "netft" else None,
        full_scale=page.full_scale,
        serial=page.text("cfgcalsn") or None,
        synthetic=bool(page.text(SYNTHETIC_FIELD)),
        meta={
            "variant": variant,
            "page": {name: page.text(name) for name in RECORDED_FIELDS if page.fields.get(name)},
        },
    )
