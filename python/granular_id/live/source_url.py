"""URLs of sources: parts and options, checked with errors that name the URL."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TypeVar
from urllib.parse import parse_qsl, unquote, urlsplit

__all__ = ["SourceUrl"]

Default = TypeVar("Default")


@dataclass(frozen=True)
class SourceUrl:
    """A URL taken apart: ``scheme://host:port/path?options`` or ``scheme:path?options``.

    Attributes
    ----------
    text : str
        As it was given; what errors call it.
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
            raise ValueError(f"url {url!r} cannot be read: {error}; {wanted}") from error
        if not split.scheme or not url.partition(":")[2]:
            raise ValueError(
                f"url {url!r} names no source; wanted one like 'sim:rice' or 'rdt://192.168.1.1'"
            )
        merged = dict(options)
        for name, value in pairs:
            if name in merged:
                raise ValueError(f"option {name!r} of url {url!r} is given twice")
            merged[name] = value
        host = split.netloc if port is None else split.netloc.rpartition(":")[0]
        return cls(url, split.scheme, host.strip("[]"), port, unquote(split.path), merged)

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

    def number(self, name: str, default: Default, *, positive: bool = True) -> float | Default:
        """Return an option as a finite number, above zero or at least zero; `default` where it is not given."""
        if name not in self.options:
            return default
        value = self.options[name]
        with suppress(ValueError, TypeError, OverflowError):
            number = math.nan if isinstance(value, bool) else float(value)  # type: ignore[arg-type]
            if math.isfinite(number) and (number > 0 or (number == 0 and not positive)):
                return number
        raise self._refused(name, "a number above 0" if positive else "a number of at least 0")

    def whole(self, name: str, default: Default) -> int | Default:
        """Return an option as a whole number of at least 0."""
        if name not in self.options:
            return default
        text = str(self.options[name])
        if not (text.isascii() and text.isdigit()):
            raise self._refused(name, "a whole number of at least 0")
        return int(text)

    def choice(self, name: str, default: Default, known: Sequence[Default]) -> Default:
        """Return an option that is one of a few values."""
        value = self.options.get(name, default)
        if value not in known:
            raise self._refused(name, "one of " + ", ".join(map(str, known)))
        return known[known.index(value)]

    def words(self, name: str) -> tuple[str, ...] | None:
        """Return an option that is a list, in a URL divided by commas; None where it is not given."""
        value = self.options.get(name)
        parts = value.split(",") if isinstance(value, str) else value
        if parts is None:
            return None
        if (
            not isinstance(parts, list | tuple)
            or not parts
            or not all(isinstance(part, str) for part in parts)
        ):
            raise self._refused(name, "texts, divided by commas")
        return tuple(part.strip() for part in parts)

    def _refused(self, name: str, wanted: str) -> ValueError:
        return ValueError(f"option {name}={self.options[name]!r} of url {self.text!r}; wanted {wanted}")
