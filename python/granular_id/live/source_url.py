"""URLs of sources: parts and options, checked with errors that name the URL."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from urllib.parse import parse_qsl, unquote, urlsplit

__all__ = ["SourceUrl"]


@dataclass(frozen=True)
class SourceUrl:
    """A URL taken apart: ``scheme://host:port/path?options`` or ``scheme:path?options``.

    Attributes
    ----------
    text : str
        As it was given; what errors call it.
    scheme : str
    host : str
        Empty in the second form.
    port : int or None
    path : str
        Decoded. In the first form it begins with a slash or is empty.
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
            raise TypeError(
                f"url must be a str like 'sim:rice' or 'rdt://192.168.1.1', got {type(url).__name__}"
            )
        scheme, colon, rest = url.partition(":")
        if not colon or not scheme or not rest:
            raise ValueError(
                f"url {url!r} names no source; wanted something like 'sim:rice' or 'rdt://192.168.1.1'"
            )
        place, _, query = rest.partition("?")
        host, port, path = "", None, unquote(place)
        if place.startswith("//"):
            try:
                split = urlsplit(place)
                port, path = split.port, unquote(split.path)
                host = split.netloc if port is None else split.netloc.rpartition(":")[0]
                host = host.strip("[]")
            except ValueError as error:
                raise ValueError(f"url {url!r} has no proper host and port: {error}") from error
        return cls(url, scheme.lower(), host, port, path, _merged(url, query, options))

    def allow(self, *names: str) -> None:
        """Refuse every option but these; the error names them."""
        unknown = sorted(set(self.options) - set(names))
        if unknown:
            known = ", ".join(sorted(names)) or "none"
            raise ValueError(f"url {self.text!r} has no option {unknown[0]!r}; known: {known}")

    def need_host(self) -> str:
        """Return the host, or say that there is none."""
        if not self.host:
            raise ValueError(f"url {self.text!r} has no host; wanted {self.scheme}://HOST")
        return self.host

    def number(self, name: str, default: float, *, positive: bool = True) -> float:
        """Return an option as a finite number, above zero or at least zero."""
        value = self.options.get(name, default)
        if isinstance(value, str | int | float) and not isinstance(value, bool):
            with suppress(ValueError, OverflowError):
                number = float(value)
                if math.isfinite(number) and number >= 0 and (number > 0 or not positive):
                    return number
        raise self._refused(name, value, "a number above 0" if positive else "a number of at least 0")

    def whole(self, name: str, default: int | None) -> int | None:
        """Return an option as a whole number of at least 0."""
        value = self.options.get(name, default)
        if isinstance(value, str) and value.isascii() and value.isdigit():
            return int(value)
        if value is None or (isinstance(value, int) and not isinstance(value, bool) and value >= 0):
            return value
        raise self._refused(name, value, "a whole number of at least 0")

    def choice(self, name: str, default: str, known: Sequence[str]) -> str:
        """Return an option that is one of a few words."""
        value = self.options.get(name, default)
        if value not in known:
            raise self._refused(name, value, "one of " + ", ".join(known))
        return str(value)

    def words(self, name: str) -> tuple[str, ...] | None:
        """Return an option that is a list, in a URL divided by commas; None where it is not given."""
        value = self.options.get(name)
        if value is None:
            return None
        parts = value.split(",") if isinstance(value, str) else value
        if not isinstance(parts, list | tuple) or not parts or not all(isinstance(p, str) for p in parts):
            raise self._refused(name, value, "texts, divided by commas")
        return tuple(part.strip() for part in parts)

    def _refused(self, name: str, value: object, wanted: str) -> ValueError:
        return ValueError(f"option {name}={value!r} of url {self.text!r}; wanted {wanted}")


def _merged(url: str, query: str, options: Mapping[str, object]) -> dict[str, object]:
    try:
        pairs = parse_qsl(query, keep_blank_values=True, strict_parsing=True) if query else []
    except ValueError as error:
        raise ValueError(
            f"url {url!r} has options that cannot be read: {error}; wanted ?name=value&name=value"
        ) from error
    merged: dict[str, object] = {}
    for name, value in [*pairs, *options.items()]:
        if name in merged:
            raise ValueError(f"option {name!r} of url {url!r} is given twice")
        merged[name] = value
    return merged
