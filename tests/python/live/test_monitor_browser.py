"""The monitor's page in a real browser: quiet, true to what was published, readable everywhere."""

from dataclasses import replace
from urllib.parse import urlsplit

import numpy as np
import pytest

from browser_cases import CONTRAST, watch
from granular_id.live import MonitorServer
from granular_id.live.snapshot import Snapshot
from live_view_cases import CLASSES, answer, hopping, listening, session

HOSTILE = ('<script>document.title = "owned"</script>', "a name " * 20, "日本の玄米とうもろこし粉", "W" * 60)
FINISHED, LISTENING, NAMED = listening(3.2)[1], listening(1.7)[1], listening(3.2, classes=HOSTILE)[1]
LABEL = FINISHED.decision.label
TROUBLE = {"missing": 14, "gaps": 2, "saturated": 3}
CASES = {
    "idle": Snapshot("idle", source="rdt://192.168.1.1", classes=CLASSES),
    "listening": LISTENING,
    "in trouble": replace(LISTENING, warnings=("gap", "saturation"), lag_s=0.043, counters=TROUBLE),
    "waiting": session(50).build("armed", hint="push now"),
    "like none": replace(FINISHED, decision=replace(FINISHED.decision, unknown=True)),
    "huge": replace(FINISHED, latest=np.full(6, -1e300), wrench=FINISHED.wrench * 1e300, lag_s=1e300),
    "failed": Snapshot("failed", hint="12 rows are missing", source="sim:rice", synthetic=True),
    "hostile names": replace(NAMED, source=HOSTILE[0], warnings=HOSTILE),
    "finished": FINISHED,
    "other sensor": hopping(axes=("ax", "ay", "gyro"), units=("m/s2", "m/s2", "")),
}


class Watched:
    """The page, whatever it logs or asks for, and the session that it shows."""

    def __init__(self, browser):
        self.monitor, self.number = MonitorServer(), 0
        self.page = browser.new_page(viewport={"width": 1280, "height": 800})
        watch(self.page)
        self.page.goto(self.monitor.url, wait_until="load")

    def show(self, snapshot):
        """Show a snapshot and wait until the page has drawn it."""
        self.monitor.show(snapshot)
        self.number += 1
        self.page.wait_for_function(f"() => document.body.dataset.drawn === '{self.number}'")
        return self.page


@pytest.fixture(scope="module")
def watched(browser):
    opened = Watched(browser)
    yield opened
    opened.page.close()
    opened.monitor.close()


@pytest.mark.parametrize("case", CASES)
def test_page_any_state_is_quiet_readable_and_fits(watched, case):
    page = watched.show(CASES[case])
    for width, scheme in [(1280, "light"), (1280, "dark"), (390, "light"), (390, "dark")]:
        page.set_viewport_size({"width": width, "height": 800})
        page.emulate_media(color_scheme=scheme)
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert page.evaluate(CONTRAST.replace("svg text'", "span, bdi, button, dt'")) == []
        page.evaluate("window.scrollTo(0, document.body.scrollHeight)")
        for place in ("#title", "#figures", "#state"):
            box = page.locator(place).bounding_box()
            assert 0 <= box["y"] <= box["y"] + box["height"] <= 800, place
    assert (page.messages, page.evaluate("window.violations")) == ([], [])
    hosts = {urlsplit(url).netloc for url in page.requests if not url.startswith("data:")}
    assert hosts == {f"127.0.0.1:{watched.monitor.server_address[1]}"}
    assert not page.title().startswith("owned")
    assert page.locator("svg[role=img]:not([aria-label])").count() == 0


@pytest.mark.parametrize("case", ["listening", "finished", "in trouble", "other sensor"])
def test_page_words_and_numbers_are_those_of_the_snapshot(watched, case):
    snapshot = CASES[case]
    page, words = watched.show(snapshot), snapshot.words
    assert [text.lower() for text in page.locator("#axes .name").all_inner_texts()] == list(snapshot.axes)
    values = page.locator(".axis .value").all_inner_texts()
    assert [text.replace("\u2212", "-") for text in values] == words.values
    ranking = [f"{name}\n{loss:.3f}" for name, loss in snapshot.decision.ranking]
    assert page.locator("#ranking li").all_inner_texts() == ranking
    n_answers = len(snapshot.ranking_history[0])
    curves = [page.get_attribute(f"#{name}", "d") for name in ("best", "second", "others")]
    assert [d.count(",") for d in curves] == [n_answers, n_answers, n_answers * (len(CLASSES) - 2)]
    assert page.locator("#figures .alarm").count() == sum(alarm for *_, alarm in words.figures)
    assert page.locator("#warnings li").all_inner_texts() == words.warnings
    style = page.eval_on_selector("#title", "(n) => getComputedStyle(n).fontStyle")
    assert (style == "italic") == (words.answer.kind == "provisional")


def test_page_pause_holds_drawings_but_not_the_answer(watched):
    page = watched.show(LISTENING)
    curve = page.get_attribute(".wrench .line", "d")
    assert len(curve) > 1000
    page.click("#pause")
    watched.monitor.show(FINISHED)
    watched.number += 1
    page.wait_for_function("() => document.getElementById('stage').textContent.startsWith('final')")
    assert page.get_attribute(".wrench .line", "d") == curve
    page.click("#pause")
    page.wait_for_function(f"() => document.body.dataset.drawn === '{watched.number}'")
    assert page.get_attribute(".wrench .line", "d") != curve


def test_page_answer_stays_history_grows_and_outcomes_are_spoken(watched):
    builder, finished = listening(3.2)
    page = watched.show(finished)
    assert page.inner_text("#spoken").startswith(f"Push 1. Final answer: {LABEL}, margin")
    builder.begin_capture()
    watched.show(builder.build("armed", hint="push now"))
    assert (page.inner_text("#title"), page.inner_text("#state")) == (LABEL, "Armed: push now")
    watched.show(builder.build("triggered", answer(1.0)))
    assert page.inner_text("#spoken").startswith("Push 1. "), "provisional answers are not spoken"
    watched.show(CASES["waiting"])
    entries = page.locator("#history li").all_inner_texts()
    assert (len(entries), entries[0][:2], entries[0].split("\n")[1]) == (40, "50", "fine sugar")


def test_page_silence_lost_line_and_end_are_shown(watched, monkeypatch):
    def broken(*_):
        raise ConnectionResetError

    page = watched.show(FINISHED)
    page.wait_for_selector("body[data-link=quiet]")
    assert "nothing new for" in page.inner_text("#quiet")
    with monkeypatch.context() as breaking:
        breaking.setattr("granular_id.live.monitor._event", broken)
        page.wait_for_selector("body[data-link=lost]")
        assert "lost" in page.inner_text("#trouble")
    page.wait_for_selector("#trouble", state="hidden", timeout=15_000)
    page.messages.clear()
    watched.monitor.close()
    page.wait_for_selector("body[data-link=ended]")
    assert page.messages == [], "the line does not break, it ends"
    assert (page.inner_text("#title"), page.is_visible("#trouble")) == (LABEL, True)
