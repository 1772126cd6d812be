"""Every link within the built site leads somewhere, and no page loads from elsewhere: python docs/links.py SITE."""

from __future__ import annotations

import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit


class Page(HTMLParser):
    """The links and the anchors of a page."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.anchors: set[str] = {""}
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name in ("id", "name") and value:
                self.anchors.add(value)
            elif name in ("href", "src") and value is not None and tag not in ("base",):
                self.links.append(value)
                if name == "src" or tag == "link":
                    self.loaded.append(value)


def main(site: Path) -> None:
    # rustdoc checks its own links; a template of the theme is no page.
    pages = {
        path.resolve(): Page(path)
        for path in site.rglob("*.html")
        if not {"rust", "_static"} & set(path.relative_to(site).parts)
    }
    broken = []
    for path, page in pages.items():
        broken += [
            f"{path.name}: loads {link}"
            for link in page.loaded
            if urlsplit(link).netloc
        ]
        for link in page.links:
            to = urlsplit(link)
            if to.scheme or to.netloc:
                continue
            target = (path.parent / unquote(to.path)).resolve() if to.path else path
            if not target.is_file():
                broken.append(f"{path.relative_to(site.resolve())}: {link}")
            elif (
                target in pages
                and to.fragment
                and unquote(to.fragment) not in pages[target].anchors
            ):
                broken.append(
                    f"{path.relative_to(site.resolve())}: {link}: no such place on that page"
                )
    print(
        f"{len(pages)} pages, {sum(len(page.links) for page in pages.values())} links, {len(broken)} broken"
    )
    if broken:
        sys.exit("\n".join(broken))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
