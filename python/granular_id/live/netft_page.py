"""Scale, units and rate of a Net F/T box, from the XML page that it serves: small, soon, or not at all.

A record holds counts; ``http://HOST/netftapi2.xml`` says what they mean. Scale and units are never assumed: a page
that does not give them, or gives what no sensor has, is refused.
"""

from __future__ import annotations

import math
import time
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from http.client import HTTPConnection, HTTPException, HTTPResponse

from granular_id._core import RDT_SCALE_LIMITS, GranularIdError

__all__ = [
    "FORCE_UNITS", "PATH", "SYNTHETIC_FIELD", "TORQUE_UNITS", "NetftPage", "NetftPageError", "parse_page", "read_page",
]  # fmt: skip

PATH = "/netftapi2.xml"
MAX_PAGE_BYTES = 64 * 1024  # a page has some 4 KiB
TIMEOUT_S = 2.0  # a box on the same network answers within hundredths of a second

SYNTHETIC_FIELD = "simulated"
"""Field of the page of a fake box; no real box has it."""

RECORDED_FIELDS = (
    "cfgnam", "cfgcpf", "cfgcpt", "scfgfu", "scfgtu", "cfgtfx", "cfgcalsn", "setbias", "setuserfilter", "runrate",
    "setrate", "comrdtrate", "comrdtbsiz", "mfgdigsn", "mfgdigver", "prodname",
)  # fmt: skip
"""Fields that a recording should keep, where they are there."""

_KGF = 9.80665
_LBF = 0.45359237 * _KGF
_INCH = 0.0254

FORCE_UNITS: Mapping[str, float] = {
    "N": 1.0, "kN": 1e3, "lbf": _LBF, "klbf": 1e3 * _LBF, "kgf": _KGF, "g": 1e-3 * _KGF,
}  # fmt: skip
"""Newton per unit of force, by definition of the units (``g`` is gram-force)."""

TORQUE_UNITS: Mapping[str, float] = {
    "Nm": 1.0, "N-m": 1.0, "Nmm": 1e-3, "N-mm": 1e-3, "kN-m": 1e3, "kNm": 1e3, "kg-cm": 0.01 * _KGF,
    "kgf-cm": 0.01 * _KGF, "lbf-in": _LBF * _INCH, "lbf-ft": 12 * _INCH * _LBF,
}  # fmt: skip
"""Newton metre per unit of torque."""

# Internal rates that are believed: Net F/T 7000 Hz, Axia 488 to 7912 Hz. Some firmware gives a mere index there.
_TICK_HZ = (100.0, 1e6)


class NetftPageError(GranularIdError):
    """A page that does not say what the counts mean; the message has its address and the field."""


@dataclass(frozen=True)
class NetftPage:
    """What the page says, by the names of its fields, and what follows from it."""

    url: str
    fields: Mapping[str, str]
    counts_per_newton: float
    counts_per_newton_metre: float
    """Scale of the records, units taken into account."""
    rate_hz: float
    """Records per second that the box is set to send."""
    tick_hz: float | None
    """Samples per second within the sensor, which `ft_sequence` counts; None: not on the page."""
    full_scale: tuple[float, ...] | None
    """Range of the calibration, N and N m."""

    def text(self, name: str) -> str:
        """Return a field that may be missing, without what would steer a terminal."""
        return "".join(c for c in self.fields.get(name, "") if c.isprintable())[:100]

    @property
    def is_axia(self) -> bool:
        """Whether it is an Ethernet Axia, whose status word has other bits."""
        axia_rate = "setrate" in self.fields and "runrate" not in self.fields
        return axia_rate or "axia" in self.text("prodname").lower()


def read_page(host: str, port: int) -> NetftPage:
    """Ask a box for its page, which must be there within `TIMEOUT_S`: else an OSError with the address."""
    url = f"http://{host}{PATH}" if port == 80 else f"http://{host}:{port}{PATH}"
    connection = HTTPConnection(host, port, timeout=TIMEOUT_S)
    until_s = time.monotonic() + TIMEOUT_S
    try:
        connection.request("GET", PATH, headers={"Connection": "close"})
        response = connection.getresponse()
        text = _read(response, until_s)
    except TimeoutError as error:
        raise TimeoutError(f"{url} did not answer within {TIMEOUT_S:g} s") from error
    except (OSError, HTTPException) as error:
        raise ConnectionError(
            f"{url} cannot be read: {error or type(error).__name__}; is the address that of the sensor box? "
            "(its page may be at another port: http_port)"
        ) from error
    finally:
        connection.close()
    wanted = "wanted the page of a Net F/T box"
    if response.status != 200:
        raise NetftPageError(f"{url} answers {response.status} {response.reason}; {wanted}")
    if len(text) > MAX_PAGE_BYTES:
        raise NetftPageError(f"{url} is longer than {MAX_PAGE_BYTES} bytes; {wanted}")
    return parse_page(text, url)


def _read(response: HTTPResponse, until_s: float) -> bytes:
    text = b""
    while len(text) <= MAX_PAGE_BYTES and (piece := response.read1(MAX_PAGE_BYTES)):
        text += piece
        if time.monotonic() > until_s:  # the socket's time-out begins anew with every piece
            raise TimeoutError
    return text


def parse_page(text: bytes, url: str) -> NetftPage:
    """Read the page's text; `url` is what errors call it."""
    fields = _fields(text, url)

    def refused(name: str, wanted: str) -> NetftPageError:
        came = repr(fields[name][:60]) if name in fields else "missing"
        return NetftPageError(f"{url}: field {name} is {came}; wanted {wanted}")

    def positive(name: str, what: str) -> float:
        value = _number(fields.get(name, ""))
        if not value > 0:
            raise refused(name, f"a number above 0 ({what})")
        return value

    def unit(name: str, units: Mapping[str, float]) -> float:
        if fields.get(name) not in units:
            raise refused(name, "one of " + ", ".join(units))
        return units[fields[name]]

    def scale(name: str, unit: float, of: str, limits: tuple[float, float]) -> float:
        value = positive(name, f"counts per unit of {'force' if of == 'newton' else 'torque'}") / unit
        if not limits[0] <= value <= limits[1]:
            raise refused(name, f"{limits[0]:g} to {limits[1]:g} counts per {of}, got {value:g}")
        return value

    force, torque = unit("scfgfu", FORCE_UNITS), unit("scfgtu", TORQUE_UNITS)
    ticks = (_number(fields.get(name, "")) for name in ("runrate", "setrate"))
    return NetftPage(
        url,
        fields,
        scale("cfgcpf", force, "newton", RDT_SCALE_LIMITS[0]),
        scale("cfgcpt", torque, "newton metre", RDT_SCALE_LIMITS[1]),
        rate_hz=positive("comrdtrate", "records per second"),
        tick_hz=next((n for n in ticks if _TICK_HZ[0] <= n <= _TICK_HZ[1]), None),
        full_scale=_full_scale(fields.get("cfgmr", ""), [force] * 3 + [torque] * 3),
    )


def _fields(text: bytes, url: str) -> dict[str, str]:
    try:
        root = ET.fromstring(text)
    except (ET.ParseError, ValueError, LookupError) as error:  # an encoding that is none is a LookupError
        raise NetftPageError(f"{url} is no XML: {error}; wanted the page of a Net F/T box") from error
    fields: dict[str, str] = {}
    for element in root.iter():
        name, value = str(element.tag).rpartition("}")[2], (element.text or "").strip()
        if fields.setdefault(name, value) != value:
            raise NetftPageError(f"{url}: field {name} is {fields[name]!r} and {value!r}; wanted one")
    return fields


def _full_scale(text: str, units: list[float]) -> tuple[float, ...] | None:
    """Return the range of the six axes, if it is there: numbers divided by semicolons, commas or blanks."""
    numbers = [_number(part) for part in text.replace(";", " ").replace(",", " ").split()]
    if len(numbers) != 6 or not all(number > 0 for number in numbers):
        return None
    return tuple(number * unit for number, unit in zip(numbers, units, strict=True))


def _number(text: str) -> float:
    """Return a finite number, NaN for everything else."""
    try:
        number = float(text)
    except ValueError:
        return math.nan
    return number if math.isfinite(number) else math.nan
