"""The report in a real browser: quiet, complete, and readable on a phone, in the dark and on paper."""

from __future__ import annotations

import pytest

from browser_cases import CONTRAST, watch
from report_cases import CASES, page_of, result_of


@pytest.fixture(scope="module", params=CASES)
def case(request, browser, tmp_path_factory):
    """A result and its page on disk."""
    result, text = result_of(request.param), page_of(request.param)
    path = tmp_path_factory.mktemp("report") / "report.html"
    path.write_text(text, encoding="utf-8")
    return result, path


@pytest.fixture
def opened(case, browser):
    """Return a function that opens the page; everything it says or asks for is collected."""
    contexts = []

    def open_page(width=1280, scheme="light"):
        context = browser.new_context(viewport={"width": width, "height": 800}, color_scheme=scheme)
        contexts.append(context)
        page = context.new_page()
        watch(page)
        page.on("requestfailed", lambda request: page.messages.append(f"failed: {request.url}"))
        page.goto(case[1].as_uri(), wait_until="load")
        return page

    yield open_page
    for context in contexts:
        context.close()


def test_page_is_quiet_complete_and_loads_itself_only(case, opened):
    result, path = case
    page = opened()
    assert page.messages == []
    assert [url for url in page.requests if not url.startswith("data:")] == [path.as_uri()]
    assert page.title() != "owned"
    wanted = 3 + len(result.labels) + 6  # accuracy, confusion, recall; forces by material; histograms by axis
    boxes = page.eval_on_selector_all(
        "svg.plot", "all => all.map((svg) => svg.getBoundingClientRect().toJSON())"
    )
    assert len(boxes) == wanted
    assert min(box["width"] for box in boxes) > 150
    assert min(box["height"] for box in boxes) > 60
    # every id that a figure refers to is its own
    assert page.evaluate(
        "() => [...document.querySelectorAll('[clip-path]')].every((node) => node.closest('svg').contains("
        "document.getElementById(node.getAttribute('clip-path').slice(5, -1))))"
    )


@pytest.mark.parametrize("width", [400, 768, 1280])
def test_nothing_sticks_out(opened, width):
    page = opened(width)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    # what is wider than the screen scrolls inside a box that can be reached by keyboard, or is a figure
    assert page.evaluate(
        "() => [...document.querySelectorAll('main *')].filter((node) => node.scrollWidth > node.clientWidth + 1 "
        "&& ['auto', 'scroll'].includes(getComputedStyle(node).overflowX)).every((node) => "
        "node.tabIndex === 0 || node.querySelector('svg.plot'))"
    )


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_stands_out_from_its_ground(opened, scheme):
    page = opened(scheme=scheme)
    ground = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (ground == "rgb(255, 255, 255)") == (scheme == "light")
    assert page.evaluate(CONTRAST) == []


def test_it_prints(opened):
    page = opened()
    pdf = page.pdf(format="A4")
    assert pdf.startswith(b"%PDF")
    assert pdf.count(b"/Type /Page\n") + pdf.count(b"/Type /Page ") >= 4
    page.emulate_media(media="print", color_scheme="dark")
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
