"""The monitor's page in a real browser: quiet, true to what was published, readable everywhere."""

from dataclasses import replace
from urllib.parse import urlsplit

import numpy as np
import pytest

from browser_cases import CONTRAST, watch
from granular_id.live import FailureReason, MonitorServer, Push, Snapshot
from live_view_cases import CLASSES, answer, listening

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
for k in range(50):
    failed = Push(None, FailureReason.GAP, "12 rows are missing")
    decision = replace(FINISHED.decision, unknown=k % 3 == 2, warnings=("lag",) * (k % 2))
    BUILDER.end_capture(failed if k % 7 == 0 else Push(decision, truth="rice"))
CASES = {
    "idle": Snapshot("idle", source="rdt://192.168.1.1", classes=CLASSES),
    "listening": listening(1.7)[1],
    "finished": FINISHED,
    "in trouble": replace(
        listening(1.7)[1],
        warnings=("gap", "saturation"),
        lag_s=0.043,
        counters={"missing": 14, "gaps": 2, "saturated": 3},
    ),
    "waiting": BUILDER.build("armed", hint="push now"),
    "stranger": replace(FINISHED, decision=replace(FINISHED.decision, unknown=True)),
    "unearthly": replace(
        FINISHED,
        latest=np.full(6, -1e300),
        wrench=FINISHED.wrench * 1e300,
        residual=FINISHED.residual * 1e300,
        ranking_history=(FINISHED.ranking_history[0], FINISHED.ranking_history[1] * 1e300),
        decision=replace(FINISHED.decision, margin=1e300, ranking=tuple((n, 1e300) for n in CLASSES)),
        lag_s=1e300,
    ),
    "failed": Snapshot("failed", hint="12 rows are missing", source="sim:rice", synthetic=True),
    "hostile names": replace(listening(3.2, classes=HOSTILE)[1], source=HOSTILE[0], warnings=HOSTILE),
}


@pytest.fixture
def monitor():
    with MonitorServer() as running:
        yield running


@pytest.fixture
def opened(browser, monitor):
    """Return a function that shows a snapshot; everything the page says or asks for is collected."""
    contexts = []

    def open_page(snapshot, width=1280, scheme="light", **options):
        monitor.publish(snapshot)
        context = browser.new_context(
            viewport={"width": width, "height": 800}, color_scheme=scheme, **options
        )
        contexts.append(context)
        page = context.new_page()
        watch(page)
        page.goto(monitor.url, wait_until="load")
        page.wait_for_selector("body[data-number]")
        return page

    yield open_page
    for context in contexts:
        context.close()


def shows(page, number):
    page.wait_for_selector(f"body[data-number='{number}']")


@pytest.mark.parametrize(
    ("width", "scheme"), [(1280, "light"), (1280, "dark"), (768, "light"), (360, "dark")]
)
@pytest.mark.parametrize("case", CASES)
def test_the_page_is_quiet_breaks_no_rule_and_can_be_read(opened, monitor, case, width, scheme):
    page = opened(CASES[case], width, scheme)
    page.wait_for_selector("#axes .axis")
    assert page.said == []
    assert page.evaluate("window.violations") == []
    hosts = {urlsplit(url).netloc for url in page.asked if not url.startswith("data:")}
    assert hosts == {f"127.0.0.1:{monitor.port}"}
    assert "owned" not in page.title().replace("<script>document.title", "")
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert page.evaluate(CONTRAST.replace("svg text'", "svg text, span, button, dt'")) == []


def test_axis_values_are_those_published(opened, monitor):
    page = opened(CASES["listening"])
    for number, case in enumerate(("listening", "finished"), 1):
        monitor.publish(CASES[case])
        shows(page, number + 1)
        seen = page.locator(".axis .value").all_inner_texts()
        wanted = [f"{value:.{3 + i // 3}f}" for i, value in enumerate(CASES[case].latest)]
        assert [text.replace("\u2212", "-") for text in seen] == wanted


def test_the_ranking_is_that_published(opened):
    snapshot = CASES["finished"]
    page = opened(snapshot)
    page.wait_for_selector("#ranking text.first")
    wanted = [f"{name}, {loss:.3f}" for name, loss in snapshot.decision.ranking]
    assert page.locator("#ranking-list li").all_text_contents() == wanted
    drawn = page.locator("#ranking text:not(.tick)").all_text_contents()
    assert set(drawn) == {text for name, loss in snapshot.decision.ranking for text in (name, f"{loss:.3f}")}
    lines = page.eval_on_selector_all("#ranking polyline:not(.tie)", "all => all.map((p) => p.points.length)")
    assert lines == [len(snapshot.ranking_history[0])] * len(CLASSES)


def test_curves_are_drawn_and_paused(opened, monitor):
    ink = """() => [...document.querySelectorAll('canvas')].map((c) => {
        const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
        let sum = 0; for (let i = 3; i < d.length; i += 4) sum += d[i] * (i % 9973); return sum; })"""
    page = opened(CASES["listening"])
    page.wait_for_selector("#ranking text.first")
    page.wait_for_timeout(300)
    before = page.evaluate(ink)
    assert len(before) == 18
    assert min(before) > 0
    page.click("#pause")
    assert page.get_attribute("#pause", "aria-pressed") == "true"
    monitor.publish(CASES["finished"])
    shows(page, 2)
    assert page.evaluate(ink) == before
    assert page.inner_text("#stage").startswith("final")  # the answer is never held back
    page.click("#pause")
    page.wait_for_function(f"() => JSON.stringify(({ink})()) !== '{str(before).replace(' ', '')}'")


@pytest.mark.parametrize(("width", "case"), [(360, "in trouble"), (400, "finished"), (1280, "in trouble")])
def test_answer_lag_and_loss_are_always_in_sight(opened, width, case):
    page = opened(CASES[case], width)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
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


@pytest.mark.parametrize("width", [390, 1280])
@pytest.mark.parametrize("longest", range(len(HOSTILE)))
def test_long_names_leave_room_for_their_values_and_for_the_rest_of_the_page(opened, width, longest):
    shown = CASES["hostile names"]
    ranking = sorted(shown.decision.ranking, key=lambda pair: pair[0] != HOSTILE[longest])
    decision = replace(shown.decision, label=HOSTILE[longest], ranking=tuple(ranking), candidates=HOSTILE)
    page = opened(replace(shown, decision=decision, warnings=()), width)
    page.wait_for_selector("#ranking text.first")
    assert page.locator("#top").bounding_box()["height"] < 300
    texts = page.locator("#ranking text:not(.tick)").all()
    boxes = [(text.text_content(), text.bounding_box()) for text in texts]
    for (name, left), (value, right) in zip(boxes[::2], boxes[1::2], strict=True):
        assert float(value) >= 0
        assert left["x"] + left["width"] <= right["x"], name
        assert right["x"] + right["width"] <= width


SPOKEN = """() => { window.spoken = [];
    const place = document.getElementById('spoken');
    new MutationObserver(() => window.spoken.push(place.textContent)).observe(place, { childList: true }); }"""


def test_what_came_of_a_push_is_spoken_once_and_provisional_answers_never(opened, monitor):
    page = opened(CASES["idle"])
    assert page.get_attribute("#spoken", "aria-live") == "polite"
    page.evaluate(SPOKEN)
    builder, _ = listening(1.0)
    label = FINISHED.decision.label
    for number in (1, 2):
        for k in range(40):  # two seconds: longer than states are silent
            monitor.publish(builder.build("triggered", answer(1.0 + k / 20)))
            page.wait_for_timeout(50)
        assert page.inner_text("#title") == label
        assert "italic" in page.eval_on_selector("#title", "(n) => getComputedStyle(n).fontStyle")
        builder.end_capture(Push(FINISHED.decision))  # the same answer twice is news
        for _ in range(2):
            monitor.publish(builder.build("complete", FINISHED.decision))
            page.wait_for_function(f"() => window.spoken.some((s) => s.startsWith('Push {number}. Final'))")
    said = page.evaluate("window.spoken")
    assert [text for text in said if label in text] == [
        f"Push {number}. Final answer: {label}, margin {FINISHED.decision.margin:.3f} ahead of cat litter"
        for number in (1, 2)
    ]
    assert set(said) - {text for text in said if label in text} <= {"Listening"}
    assert page.evaluate(
        "[...document.querySelectorAll('canvas, svg')].every((n) => n.getAttribute('aria-label'))"
    )


def test_the_answer_stays_and_the_history_grows_while_the_next_push_is_awaited(opened, monitor):
    builder, finished = listening(3.2)
    page = opened(finished)
    page.wait_for_selector("#history li")
    number = 1
    for state in ("arming", "armed"):
        builder.begin_capture()
        monitor.publish(builder.build(state, hint="push now"))
        number += 1
        shows(page, number)
        assert page.inner_text("#title") == FINISHED.decision.label
        assert page.get_attribute("#top", "data-kind") == "final"
        assert page.inner_text("#state").endswith(": push now")
        assert page.locator("#ranking-list li").count() == len(CLASSES)
        assert page.locator("#ranking polyline.first").count() == 1
        assert page.locator("#history li").count() == 1
    monitor.publish(CASES["waiting"])
    page.wait_for_function("() => document.querySelectorAll('#history li').length === 40")
    assert "the last 40 of 51" in page.inner_text("#history-note")
    first = page.locator("#history li").nth(0).inner_text().split("\n")
    assert first[0].startswith("51 ")
    assert first[1:] == ["no answer", "12 rows are missing"]
    assert page.get_attribute("#top", "data-kind") == "failed"
    kinds = page.eval_on_selector_all("#history li", "all => all.map((n) => n.dataset.kind)")
    assert set(kinds) == {"final", "unknown", "failed"}
    assert "lag: rows were read late" in page.locator("#history li").nth(2).inner_text()


def test_a_stranger_is_not_called_by_the_nearest_name(opened):
    page = opened(CASES["stranger"])
    assert page.inner_text("#title") == "like no known material"
    assert page.inner_text("#detail").startswith(f"nearest: {FINISHED.decision.label}, margin ")
    assert page.get_attribute("#top", "data-kind") == "unknown"


def test_reduced_motion_is_respected(opened, monitor):
    page = opened(CASES["listening"], reduced_motion="reduce")
    page.wait_for_selector("#ranking text.first")
    assert page.evaluate("document.getAnimations().length") == 0
    monitor.publish(CASES["finished"])
    shows(page, 2)
    page.wait_for_function(
        f"() => document.querySelector('#ranking text.first').textContent === {CASES['finished'].decision.label!r}"
    )


def test_a_lost_connection_is_shown_and_made_again(monitor, opened, monkeypatch):
    def broken(*_):
        raise ConnectionResetError

    page = opened(CASES["listening"])
    path = urlsplit(monitor.url).path
    monkeypatch.setattr("granular_id.live.monitor._event", broken)
    page.wait_for_selector("#trouble:not([hidden])")
    assert "lost" in page.inner_text("#trouble")
    monkeypatch.undo()
    assert page.inner_text("#title") == CASES["listening"].decision.label
    page.wait_for_selector("#trouble", state="hidden", timeout=15_000)
    monitor.publish(CASES["finished"])
    shows(page, 2)
    assert path in page.url


def test_the_end_of_the_session_is_shown_and_the_answer_stays(opened, monitor):
    page = opened(CASES["finished"])
    monitor.close()
    page.wait_for_selector("body[data-link=ended]")
    assert "ended" in page.inner_text("#trouble")
    assert page.inner_text("#title") == CASES["finished"].decision.label
    assert page.said == []


def test_a_silent_session_is_shown(opened):
    page = opened(CASES["idle"])
    page.wait_for_selector("body[data-link=quiet]")
    assert "nothing new for" in page.inner_text("#quiet")
