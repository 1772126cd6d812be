"""A browser that stops reading changes nothing in what is captured."""

import socket
from urllib.parse import urlsplit

import pytest

import granular_id as gid
from granular_id.live import LiveIdentifier, MonitorServer, SimSource, Views, opened


@pytest.fixture(scope="module")
def model():
    data = gid.synthesize(["rice", "fine sugar"], n_per_class=8, duration_s=1.3, seed=5)
    return gid.Identifier.fit(
        data.align(trigger="recorded", lead_s=0.1, n_samples=500), "hfmh", estimate=False
    )


def captured(model, views):
    """Answers and the counters of the stream after three pushes."""
    with opened(SimSource("rice", seed=2, speed=4)) as stream:
        live = LiveIdentifier(stream, model, views=views)
        answers = [live.push().decision for _ in range(3)]
        return answers, stream.health().counters


def stalled_browser(monitor):
    """Opens the stream of events with the smallest of buffers and never reads."""
    parts = urlsplit(monitor.url)
    browser = socket.socket()
    browser.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)
    browser.connect(("127.0.0.1", monitor.port))
    browser.sendall(f"GET {parts.path}events HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
    return browser


def test_a_stalled_browser_changes_neither_answers_nor_counters(model):
    alone, before = captured(model, Views([]))
    with MonitorServer() as monitor, stalled_browser(monitor):
        watched, after = captured(model, Views([monitor]))
    assert [decision.ranking for decision in watched] == [decision.ranking for decision in alone]
    for counters in (before, after):
        troubles = {name: n for name, n in counters.items() if name not in ("written", "epochs") and n}
        assert troubles == {}
        assert counters["written"] >= 3 * model.n_samples
    assert before["epochs"] == after["epochs"]
