"""URLs of sources: parts and options."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import parse_qsl, unquote, urlsplit

__all__ = ["SourceUrl"]


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
        for name in self.options:
            if name not in names:
                known = ", ".join(sorted(names)) or "none"
                raise ValueError(f"there is no option {name!r}; known: {known}")

    def need_host(self) -> str:
        """Return the host, or say that there is none."""
        if not self.host:
            raise ValueError(f"there is no host; wanted {self.scheme}://HOST")
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
            raise ValueError(f"option {name}={value!r}; wanted {wanted}") from None
