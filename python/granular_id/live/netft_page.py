"""Scale, units and rate of a Net F/T box, from the XML page that it serves: small, soon, or not at all.

A record holds counts; what they mean is told by ``http://HOST/netftapi2.xml``. Scale and units are never
assumed: a page that does not give them, or gives what no sensor has, is refused.
"""

from __future__ import annotations

import time
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from http.client import HTTPConnection, HTTPException, HTTPResponse

from granular_id._core import RDT_SCALE_LIMITS

__all__ = [
    "FORCE_UNITS",
    "MAX_PAGE_BYTES",
    "PATH",
    "SYNTHETIC_FIELD",
    "TORQUE_UNITS",
    "NetftPage",
    "NetftPageError",
    "parse_page",
    "read_page",
]

PATH = "/netftapi2.xml"
MAX_PAGE_BYTES = 64 * 1024
"""A page has some 4 KiB."""
TIMEOUT_S = 2.0
"""A box on the same network answers within hundredths of a second."""

_LBF = Fraction("4.4482216152605")
_KGF = Fraction("9.80665")
_INCH, _FOOT = Fraction("0.0254"), Fraction("0.3048")

FORCE_UNITS: Mapping[str, Fraction] = {
    "N": Fraction(1),
    "kN": Fraction(1000),
    "lbf": _LBF,
    "klbf": 1000 * _LBF,
    "kgf": _KGF,
    "g": _KGF / 1000,
}
"""Newton per unit of force, exact by definition of the units (``g`` is gram-force)."""

TORQUE_UNITS: Mapping[str, Fraction] = {
    "Nm": Fraction(1),
    "N-m": Fraction(1),
    "Nmm": Fraction(1, 1000),
    "N-mm": Fraction(1, 1000),
    "kg-cm": _KGF / 100,
    "kgf-cm": _KGF / 100,
    "lbf-in": _LBF * _INCH,
    "lbf-ft": _LBF * _FOOT,
    "kN-m": Fraction(1000),
    "kNm": Fraction(1000),
}
"""Newton metre per unit of torque, exact."""

_TICK_HZ = (100.0, 1e6)
"""Internal rates that are believed: Net F/T 7000 Hz, Axia 488 to 7912 Hz. Some firmware gives a mere index there."""


class NetftPageError(ValueError):
    """A page that does not say what the counts mean; the message has its address and the field."""


@dataclass(frozen=True)
class NetftPage:
    """What the page says.

    Parameters
    ----------
    url : str
        Where it was read.
    counts_per_newton, counts_per_newton_metre : float
        Scale of the records, units taken into account; rounded once.
    rate_hz : float
        Records per second that the box is set to send (``comrdtrate``).
    tick_hz : float or None
        Samples per second within the sensor, which `ft_sequence` counts (``runrate``, or ``setrate``); None: not told.
    full_scale : tuple of 6 float, or None
        Range of the calibration, N and N m (``cfgmr``).
    product, serial : str
        Name of the product, and serial number of the calibration (``cfgcalsn``); empty where not told.
    is_axia : bool
        Whether it is an Ethernet Axia, whose status word has other bits.
    synthetic : bool
        Whether the page is that of a fake box whose wrenches come from a model (``simulated``).
    fields : mapping of str to str
        Settings that a recording should keep, as they stand there.
    """

    url: str
    counts_per_newton: float
    counts_per_newton_metre: float
    rate_hz: float
    tick_hz: float | None
    full_scale: tuple[float, ...] | None
    product: str
    serial: str
    is_axia: bool
    synthetic: bool
    fields: Mapping[str, str]


SYNTHETIC_FIELD = "simulated"
"""Field of the page of a fake box; no real box has it."""

KEPT = (
    "cfgnam", "cfgcpf", "cfgcpt", "scfgfu", "scfgtu", "cfgtfx", "cfgcalsn", "setbias", "setuserfilter", "runrate",
    "setrate", "comrdtrate", "comrdtbsiz", "mfgdigsn", "mfgdigver", "prodname",
)  # fmt: skip
"""Fields that `NetftPage.fields` keeps, where they are there."""


def read_page(host: str, port: int = 80, *, timeout_s: float = TIMEOUT_S) -> NetftPage:
    """Ask a box for its page, which must be there within `timeout_s`.

    Raises
    ------
    NetftPageError
        The page is none, is too long, or says too little.
    OSError
        The box does not answer; with the address.

    Examples
    --------
    >>> from granular_id.live.netft_page import read_page
    >>> from granular_id.testing import FakeNetft
    >>> with FakeNetft(force_unit="lbf") as box:
    ...     page = read_page("127.0.0.1", box.http_port)
    >>> page.rate_hz, round(page.counts_per_newton, 3)
    (500.0, 224808.943)
    """
    url = f"http://{host}{PATH}" if port == 80 else f"http://{host}:{port}{PATH}"
    connection = HTTPConnection(host, port, timeout=timeout_s)
    until_s = time.monotonic() + timeout_s
    try:
        connection.request("GET", PATH, headers={"Connection": "close"})
        response = connection.getresponse()
        text = _read(response, until_s)
    except TimeoutError as error:
        raise TimeoutError(f"{url} did not answer within {timeout_s:g} s") from error
    except (OSError, HTTPException) as error:
        raise ConnectionError(
            f"{url} cannot be read: {error or type(error).__name__}; is the address that of the sensor box? "
            "(its page may be at another port: http_port)"
        ) from error
    finally:
        connection.close()
    if response.status != 200:
        raise NetftPageError(
            f"{url} answers {response.status} {response.reason}; wanted the page of a Net F/T box"
        )
    if len(text) > MAX_PAGE_BYTES:
        raise NetftPageError(f"{url} is longer than {MAX_PAGE_BYTES} bytes; wanted the page of a Net F/T box")
    return parse_page(text, url)


def _read(response: HTTPResponse, until_s: float) -> bytes:
    text = b""
    while len(text) <= MAX_PAGE_BYTES and (piece := response.read1(MAX_PAGE_BYTES)):
        text += piece
        if time.monotonic() > until_s:  # the socket's time-out begins anew with every piece
            raise TimeoutError
    return text


def parse_page(text: bytes, url: str) -> NetftPage:
    """Read the page's text; `url` is what errors call it.

    Raises
    ------
    NetftPageError
        No XML, or a field that is missing, stands there twice or makes no sense.

    Examples
    --------
    >>> from granular_id.live.netft_page import parse_page
    >>> text = b"<netft><cfgcpf>0</cfgcpf></netft>"
    >>> parse_page(text, "http://192.168.1.1/netftapi2.xml")
    Traceback (most recent call last):
    ...
    granular_id.live.netft_page.NetftPageError: http://192.168.1.1/netftapi2.xml: field cfgcpf is '0'; \
wanted a number above 0 (counts per unit of force)
    """
    fields = _Fields(_values(text, url), url)
    force_counts = fields.positive("cfgcpf", "counts per unit of force")
    torque_counts = fields.positive("cfgcpt", "counts per unit of torque")
    force_unit = fields.unit("scfgfu", FORCE_UNITS)
    torque_unit = fields.unit("scfgtu", TORQUE_UNITS)
    force_limits, torque_limits = RDT_SCALE_LIMITS
    product = fields.text("prodname")
    return NetftPage(
        url=url,
        counts_per_newton=fields.scale("cfgcpf", force_counts / force_unit, "newton", force_limits),
        counts_per_newton_metre=fields.scale(
            "cfgcpt", torque_counts / torque_unit, "newton metre", torque_limits
        ),
        rate_hz=float(fields.positive("comrdtrate", "records per second")),
        tick_hz=fields.tick_hz(),
        full_scale=fields.full_scale(force_unit, torque_unit),
        product=product,
        serial=fields.text("cfgcalsn"),
        is_axia="axia" in product.lower() or ("setrate" in fields.values and "runrate" not in fields.values),
        synthetic=bool(fields.text(SYNTHETIC_FIELD)),
        fields={name: fields.values[name] for name in KEPT if fields.values.get(name)},
    )


def _values(text: bytes, url: str) -> dict[str, str]:
    try:
        root = ET.fromstring(text)
    except (ET.ParseError, ValueError, LookupError) as error:  # an encoding that is none is a LookupError
        raise NetftPageError(f"{url} is no XML: {error}; wanted the page of a Net F/T box") from error
    values: dict[str, str] = {}
    for element in root.iter():
        name, value = str(element.tag).rpartition("}")[2], (element.text or "").strip()
        if values.setdefault(name, value) != value:
            raise NetftPageError(f"{url}: field {name} is {values[name]!r} and {value!r}; wanted one")
    return values


@dataclass(frozen=True)
class _Fields:
    """The page's fields with checks that name them."""

    values: Mapping[str, str]
    url: str

    def refuse(self, name: str, wanted: str) -> NetftPageError:
        value = self.values.get(name)
        came = "missing" if value is None else repr(value[:60])
        return NetftPageError(f"{self.url}: field {name} is {came}; wanted {wanted}")

    def text(self, name: str) -> str:
        """Return a field that may be missing, without what would steer a terminal."""
        return "".join(c for c in self.values.get(name, "") if c.isprintable())[:100]

    def positive(self, name: str, what: str) -> Fraction:
        value = _number(self.values.get(name, ""))
        if value is None or value <= 0:
            raise self.refuse(name, f"a number above 0 ({what})")
        return value

    def unit(self, name: str, units: Mapping[str, Fraction]) -> Fraction:
        value = units.get(self.values.get(name, ""))
        if value is None:
            raise self.refuse(name, "one of " + ", ".join(units))
        return value

    def scale(self, name: str, value: Fraction, unit: str, limits: tuple[float, float]) -> float:
        """Return counts per unit of SI, if a sensor can have so many."""
        low, high = limits
        if not low <= value <= high:
            raise self.refuse(name, f"{low:g} to {high:g} counts per {unit}, got {float(value):g}")
        return float(value)

    def tick_hz(self) -> float | None:
        for name in ("runrate", "setrate"):
            value = _number(self.values.get(name, ""))
            if value is not None and _TICK_HZ[0] <= value <= _TICK_HZ[1]:
                return float(value)
        return None

    def full_scale(self, force_unit: Fraction, torque_unit: Fraction) -> tuple[float, ...] | None:
        """Return the range of the six axes, if it is told: texts divided by semicolons, commas or blanks."""
        parts = self.values.get("cfgmr", "").replace(";", " ").replace(",", " ").split()
        numbers = [_number(part) for part in parts]
        units = [force_unit] * 3 + [torque_unit] * 3
        known = [n * unit for n, unit in zip(numbers, units, strict=False) if n is not None and n > 0]
        return tuple(float(n) for n in known) if len(known) == len(parts) == 6 else None


def _number(text: str) -> Fraction | None:
    # float keeps out the huge powers of ten that Fraction would write out in full
    try:
        number = float(text)
        return Fraction(text) if abs(number) < 1e15 and "/" not in text and "_" not in text else None
    except (ValueError, OverflowError):
        return None
