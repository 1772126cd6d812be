"""A matplotlib figure as SVG that can stand inside a page beside others.

matplotlib writes an SVG for a file of its own: ids that the next figure uses too, a style for every element
of the page, metadata with addresses, coordinates to a millionth. Here text stays text (it can be searched,
takes the page's font, and is smaller than outlines), colours become variables of the page so that a dark page
stays readable, and ids carry the name of the figure.
"""

from __future__ import annotations

import io
import re
import warnings
from threading import Lock
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

from granular_id.plotting import FAINT, INK
from granular_id.recording import AXIS_COLOURS

if TYPE_CHECKING:
    from matplotlib.figure import Figure
COLOURS = {INK.lower(): "ink", FAINT.lower(): "faint"} | {
    colour.lower(): f"okabe-{number}" for number, colour in enumerate(AXIS_COLOURS)
}
"""Colour of a figure to the page's variable for it."""

_SVG, _LINK = "{http://www.w3.org/2000/svg}", "{http://www.w3.org/1999/xlink}href"
_REFERENCE = re.compile(r"url\(#([^)]+)\)")
# Two forms, of older and of newer versions of matplotlib.
_FONT = re.compile(r"font: (?:(italic|oblique) )?(?:(\w+) )?([\d.]+)px [^;]+")
_FAMILY = re.compile(r" ?font-family: [^;]+;")
_DECIMALS = re.compile(r"-?\d+\.\d{2,}")
_NUMBERS = ("d", "points", "transform", "x", "y", "width", "height")

# The switch for text is global to matplotlib: it is thrown for one drawing at a time, and put back.
_switch = Lock()


def inline_svg(figure: Figure, key: str, alt: str) -> str:
    """Return the figure as one ``<svg>`` element for a page of HTML.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    key : str
        Name of the figure on its page, letters, digits and dashes: ids begin with it.
    alt : str
        What the figure shows, for those who cannot see it.

    Returns
    -------
    str
        Without metadata, scripts or anything that is fetched.
    """
    root = ElementTree.fromstring(_drawn(figure))  # written by matplotlib one line above
    for parent in list(root.iter()):
        for child in list(parent):
            if child.tag in {f"{_SVG}metadata", f"{_SVG}style"}:
                parent.remove(child)
    names = _new_ids(root, key)
    for element in root.iter():
        element.tag = element.tag.removeprefix(_SVG)
        element.attrib = {
            name.removeprefix("{http://www.w3.org/1999/xlink}"): _plain(name, value, names)
            for name, value in element.attrib.items()
            if name != "id" or value in names
        }
        # Line breaks between elements; those inside a text are the text's own.
        element.text = element.text if (element.text or "").strip() else None
        element.tail = element.tail if (element.tail or "").strip() else None
    _, _, width, height = root.attrib["viewBox"].split()
    root.attrib = {
        "class": "plot",
        "id": key,
        "role": "img",
        "aria-label": alt,
        "viewBox": f"0 0 {float(width):.6g} {float(height):.6g}",
        # points to the pixels of a page
        "width": f"{float(width) * 4 / 3:.0f}",
        "height": f"{float(height) * 4 / 3:.0f}",
    }
    _drop_empty(root)
    return ElementTree.tostring(root, encoding="unicode")


def _drawn(figure: Figure) -> bytes:
    import matplotlib as mpl  # an extra
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    for patch in (figure.patch, *(panel.patch for panel in figure.axes)):
        patch.set_visible(False)  # the page shows through
    stream = io.BytesIO()
    with _switch, warnings.catch_warnings():
        # The page's fonts draw the letters; what matplotlib's own font lacks does not matter.
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        before = mpl.rcParams["svg.fonttype"]
        mpl.rcParams["svg.fonttype"] = "none"
        try:
            # Not savefig: it draws every figure twice, the first time for the layout alone.
            canvas: Any = FigureCanvasSVG(figure)
            canvas.print_svg(stream)
        finally:
            mpl.rcParams["svg.fonttype"] = before
    return stream.getvalue()


def _drop_empty(element: ElementTree.Element) -> None:
    for child in list(element):
        _drop_empty(child)
        if child.tag in {"g", "defs"} and not len(child):
            element.remove(child)


def _new_ids(root: ElementTree.Element, key: str) -> dict[str, str]:
    """Map the ids that something refers to; the others are dropped."""
    used: list[str] = []
    for element in root.iter():
        for name, value in element.attrib.items():
            used += _REFERENCE.findall(value)
            if name == _LINK and value.startswith("#"):
                used.append(value[1:])
    return {old: f"{key}-{number}" for number, old in enumerate(dict.fromkeys(used))}


def _plain(name: str, value: str, names: dict[str, str]) -> str:
    if name == "id":
        return names[value]
    if name == _LINK:
        return f"#{names[value[1:]]}" if value.startswith("#") else value
    if name in _NUMBERS:
        return " ".join(_DECIMALS.sub(_short, value).split())
    value = _REFERENCE.sub(lambda match: f"url(#{names[match[1]]})", value)
    if name == "style":
        value = _FAMILY.sub("", _FONT.sub(_font, value))
        for colour, variable in COLOURS.items():
            value = value.replace(colour, f"var(--{variable})")
    return value


def _short(match: re.Match[str]) -> str:
    """Write a number to a hundredth of a point, which no screen resolves; scales below 1 keep four digits."""
    number = float(match[0])
    text = f"{number:.4g}" if abs(number) < 1 else f"{number:.2f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def _font(match: re.Match[str]) -> str:
    """Keep size, weight and slant; the family is the page's."""
    slant, weight, size = match.groups()
    parts = [f"font-size: {float(size):g}px"]
    if weight:
        parts.append(f"font-weight: {weight}")
    if slant:
        parts.append("font-style: italic")
    return "; ".join(parts)
