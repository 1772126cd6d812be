"""The monitor's page in a real browser: quiet, true to what was published, readable everywhere. One page is opened."""

from dataclasses import replace
from urllib.parse import urlsplit

import numpy as np
import pytest

from browser_cases import CONTRAST, watch
from granular_id.live import FailureReason, MonitorServer, Push, Snapshot, SnapshotBuilder
from live_view_cases import CLASSES, answer, block, listening

HOSTILE = (
    '<script>document.title = "owned"</script>',
    "<img src=x onerror=alert(1)>",
    "a name " * 20,
    "süß 糖",
    "日本の玄米とうもろこし粉小麦粉大豆粉黒砂糖白砂糖塩胡椒唐辛子山椒",
    "W" * 60,
    "رمل ناعم مغسول من الشاطئ الشمالي للمدينة القديمة",
)
BUILDER, FINISHED = listening(3.2)
LABEL = FINISHED.decision.label
LISTENING = listening(1.7)[1]
for k in range(50):
    failed = Push(None, FailureReason.GAP, "12 rows are missing")
    decision = replace(FINISHED.decision, unknown=k % 3 == 2, warnings=("lag",) * (k % 2))
    BUILDER.end_capture(failed if k % 7 == 0 else Push(decision, truth="rice"))
NAMED = listening(3.2, classes=HOSTILE)[1]
CASES = {
    "idle": Snapshot("idle", source="rdt://192.168.1.1", classes=CLASSES),
    "listening": LISTENING,
    "finished": FINISHED,
    "in trouble": replace(
        LISTENING,
        warnings=("gap", "saturation"),
        lag_s=0.043,
        counters={"missing": 14, "gaps": 2, "saturated": 3},
    ),
    "waiting": BUILDER.build("armed", hint="push now"),
    "like none": replace(FINISHED, decision=replace(FINISHED.decision, unknown=True)),
    "huge": replace(
        FINISHED,
        latest=np.full(6, -1e300),
        wrench=FINISHED.wrench * 1e300,
        residual=FINISHED.residual * 1e300,
        ranking_history=(FINISHED.ranking_history[0], FINISHED.ranking_history[1] * 1e300),
        decision=replace(FINISHED.decision, margin=1e300, ranking=tuple((n, 1e300) for n in CLASSES)),
        lag_s=1e300,
    ),
    "failed": Snapshot("failed", hint="12 rows are missing", source="sim:rice", synthetic=True),
    "hostile names": replace(NAMED, source=HOSTILE[0], warnings=HOSTILE),
}


class Watched:
    """The page, whatever it says or asks for, and the session that it shows."""

    def __init__(self, browser):
        self.monitor = MonitorServer()
        self.page = browser.new_page(viewport={"width": 1280, "height": 800})
        watch(self.page)
        self.page.goto(self.monitor.url, wait_until="load")

    def close(self):
        self.page.close()
        self.monitor.close()

    def show(self, snapshot):
        """Publish a snapshot and wait until the page has it."""
        before = self.monitor._number
        self.monitor.publish(snapshot)
        self.page.wait_for_function(f"() => Number(document.body.dataset.number ?? 0) > {before}")
        return self.page

    def look(self, width=1280, scheme="light"):
        self.page.set_viewport_size({"width": width, "height": 800})
        self.page.emulate_media(color_scheme=scheme)


@pytest.fixture(scope="module")
def opened_once(browser):
    opened = Watched(browser)
    yield opened
    opened.close()


@pytest.fixture
def watched(opened_once):
    opened_once.look()
    return opened_once


def test_another_sensor_has_its_own_axes_and_units_and_answers_that_go_on_a_time_before_now(browser):
    builder = SnapshotBuilder(
        100.0,
        classes=CLASSES,
        n_samples=170,
        axes=("ax", "ay", "gyro"),
        units=("m/s2", "m/s2", ""),
        hop_s=0.5,
    )
    for k in range(40):
        builder.rows(block(np.ones((50, 3)) * k, 50 * k))
        builder.build("answering", replace(answer(3.2, final=True), seconds=1.7))
    last = builder.build("answering", replace(answer(3.2, final=True), seconds=1.7))
    opened = Watched(browser)
    try:
        page = opened.show(last)
        page.wait_for_selector(".axis .name")
        assert page.locator("#axes .name").all_inner_texts() == ["ax", "ay", "gyro"]
        assert page.locator("#axes .unit").all_inner_texts()[:2] == ["m/s2", "m/s2"]
        assert page.locator("#stage").inner_text() == "about the last 1.70 s"
        assert {"\u221230", "0 s"} <= set(page.locator("#ranking .tick").all_text_contents())
    finally:
        opened.close()


@pytest.mark.parametrize("case", CASES)
def test_the_page_is_quiet_breaks_no_rule_and_can_be_read(watched, case):
    page = watched.show(CASES[case])
    for width, scheme in [(1280, "light"), (1280, "dark"), (768, "light"), (360, "dark")]:
        watched.look(width, scheme)
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert page.evaluate(CONTRAST.replace("svg text'", "svg text, span, button, dt'")) == []
    assert page.said == []
    assert page.evaluate("window.violations") == []
    hosts = {urlsplit(url).netloc for url in page.asked if not url.startswith("data:")}
    assert hosts == {f"127.0.0.1:{watched.monitor.port}"}
    assert "owned" not in page.title().replace("<script>document.title", "")


@pytest.mark.parametrize("case", ["listening", "finished"])
def test_values_and_ranking_are_those_published(watched, case):
    snapshot = CASES[case]
    page = watched.show(snapshot)
    seen = page.locator(".axis .value").all_inner_texts()
    wanted = [f"{value:.{3 + i // 3}f}" for i, value in enumerate(snapshot.latest)]
    assert [text.replace("\u2212", "-") for text in seen] == wanted
    told = [(name, f"{loss:.3f}") for name, loss in snapshot.decision.ranking]
    assert page.locator("#ranking-list li").all_text_contents() == [", ".join(pair) for pair in told]
    drawn = page.locator("#ranking text:not(.tick)").all_text_contents()
    assert set(drawn) == {text for pair in told for text in pair}
    lines = page.eval_on_selector_all("#ranking polyline:not(.tie)", "all => all.map((p) => p.points.length)")
    assert lines == [len(snapshot.ranking_history[0])] * len(CLASSES)


def test_curves_are_drawn_and_paused(watched):
    ink = """() => [...document.querySelectorAll('canvas')].map((c) => {
        const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
        let sum = 0; for (let i = 3; i < d.length; i += 4) sum += d[i] * (i % 9973); return sum; })"""
    page = watched.show(LISTENING)
    page.wait_for_timeout(300)  # drawings follow the words
    before = page.evaluate(ink)
    assert len(before) == 18
    assert min(before) > 0
    page.click("#pause")
    assert page.get_attribute("#pause", "aria-pressed") == "true"
    watched.show(FINISHED)
    assert page.evaluate(ink) == before
    assert page.inner_text("#stage").startswith("final")  # the answer is never held back
    page.click("#pause")
    page.wait_for_function(f"() => JSON.stringify(({ink})()) !== '{str(before).replace(' ', '')}'")


@pytest.mark.parametrize(("width", "case"), [(360, "in trouble"), (400, "finished"), (1280, "in trouble")])
def test_answer_lag_and_loss_are_always_in_sight(watched, width, case):
    watched.look(width)
    page = watched.show(CASES[case])
    page.evaluate("window.scrollTo(0, document.body.scrollHeight)")
    for place in ("#title", "#figures", "#state"):
        box = page.locator(place).bounding_box()
        assert box["y"] >= 0
        assert box["y"] + box["height"] <= 800, place
    figures = page.locator("#figures div").all_inner_texts()
    assert [text.split()[0] for text in figures[:2]] == ["lag", "lost"]
    assert ("43.0 ms" in figures[0]) == (case == "in trouble")
    assert page.locator("#figures .alarm").count() == (4 if case == "in trouble" else 0)
    assert "SYNTHETIC" in page.inner_text("#source")


PLACES = """all => all.map((n) => {
    const box = n.getBoundingClientRect(); return [n.textContent, box.left, box.right]; })"""


@pytest.mark.parametrize("longest", range(len(HOSTILE)))
def test_long_names_leave_room_for_their_values_and_for_the_rest_of_the_page(watched, longest):
    ranking = sorted(NAMED.decision.ranking, key=lambda pair: pair[0] != HOSTILE[longest])
    decision = replace(NAMED.decision, label=HOSTILE[longest], ranking=tuple(ranking), candidates=HOSTILE)
    for width in (390, 1280):
        watched.look(width)
        page = watched.show(replace(NAMED, source=HOSTILE[0], decision=decision))
        assert page.locator("#top").bounding_box()["height"] < 300
        drawn = page.eval_on_selector_all("#ranking text:not(.tick)", PLACES)
        assert len(drawn) == 2 * len(HOSTILE)
        for (name, _, end), (value, begin, right) in zip(drawn[::2], drawn[1::2], strict=True):
            assert float(value) >= 0
            assert end <= begin, name
            assert right <= width


def test_what_came_of_a_push_is_spoken_once_and_provisional_answers_never(watched):
    page = watched.show(CASES["idle"])
    assert page.get_attribute("#spoken", "aria-live") == "polite"
    page.evaluate("""() => { window.spoken = [];
        const place = document.getElementById('spoken');
        new MutationObserver(() => window.spoken.push(place.textContent)).observe(place, { childList: true }); }""")
    builder, _ = listening(0.1)
    for n_moments in (40, 4):
        for k in range(n_moments):  # two seconds at first: longer than states are silent
            watched.monitor.publish(builder.build("triggered", answer(1.0 + k / 20)))
            page.wait_for_timeout(50)
        assert page.inner_text("#title") == LABEL
        assert "italic" in page.eval_on_selector("#title", "(n) => getComputedStyle(n).fontStyle")
        builder.end_capture(Push(FINISHED.decision))  # the same answer twice is news
        for _ in range(2):
            watched.show(builder.build("complete", FINISHED.decision))
    said = page.evaluate("window.spoken")
    assert [text for text in said if LABEL in text] == [
        f"Push {number}. Final answer: {LABEL}, margin {FINISHED.decision.margin:.3f} ahead of cat litter"
        for number in (1, 2)
    ]
    assert {text for text in said if LABEL not in text} <= {"Listening"}
    labelled = "[...document.querySelectorAll('canvas, svg')].every((n) => n.getAttribute('aria-label'))"
    assert page.evaluate(labelled)


def test_the_answer_stays_and_the_history_grows_while_the_next_push_is_awaited(watched):
    watched.show(CASES["idle"])
    builder, finished = listening(3.2)
    page = watched.show(finished)
    for state in ("arming", "armed"):
        builder.begin_capture()
        watched.show(builder.build(state, hint="push now"))
        assert page.inner_text("#title") == LABEL
        assert page.get_attribute("#top", "data-kind") == "final"
        assert page.inner_text("#state").endswith(": push now")
        assert page.locator("#ranking-list li").count() == len(CLASSES)
        assert page.locator("#ranking polyline.first").count() == 1
        assert page.locator("#history li").count() == 1
    watched.show(CASES["waiting"])
    assert page.locator("#history li").count() == 40
    assert "the last 40 of 51" in page.inner_text("#history-note")
    first = page.locator("#history li").nth(0).inner_text().split("\n")
    assert first[0].startswith("51 ")
    assert first[1:] == ["no answer", "12 rows are missing"]
    assert page.get_attribute("#top", "data-kind") == "failed"
    kinds = page.eval_on_selector_all("#history li", "all => all.map((n) => n.dataset.kind)")
    assert set(kinds) == {"final", "unknown", "failed"}
    assert "lag: rows were read late" in page.locator("#history li").nth(2).inner_text()


def test_what_is_like_none_is_not_called_by_the_nearest_name(watched):
    page = watched.show(CASES["like none"])
    assert page.inner_text("#title") == "like no known material"
    assert page.inner_text("#detail").startswith(f"nearest: {LABEL}, margin ")
    assert page.get_attribute("#top", "data-kind") == "unknown"


def test_reduced_motion_is_respected(watched):
    page = watched.show(LISTENING)
    page.emulate_media(reduced_motion="reduce")
    assert page.evaluate("document.getAnimations().length") == 0
    watched.show(FINISHED)
    best = "document.querySelector('#ranking text.first').textContent"
    page.wait_for_function(f"() => {best} === {LABEL!r}")
    page.emulate_media(reduced_motion="no-preference")


def test_silence_a_lost_connection_and_the_end_of_the_session_are_shown_and_the_answer_stays(
    watched, monkeypatch
):
    def broken(*_):
        raise ConnectionResetError

    page = watched.show(LISTENING)
    page.wait_for_selector("body[data-link=quiet]")
    assert "nothing new for" in page.inner_text("#quiet")
    monkeypatch.setattr("granular_id.live.monitor._event", broken)
    page.wait_for_selector("#trouble:not([hidden])")
    assert "lost" in page.inner_text("#trouble")
    monkeypatch.undo()
    assert page.inner_text("#title") == LISTENING.decision.label
    page.wait_for_selector("#trouble", state="hidden", timeout=15_000)
    watched.show(FINISHED)
    page.said.clear()
    watched.monitor.close()
    page.wait_for_selector("body[data-link=ended]")
    assert page.said == [], "the line does not break, it ends"
    assert "ended" in page.inner_text("#trouble")
    assert page.inner_text("#title") == LABEL
