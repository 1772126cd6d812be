"""The monitor's page is closed by default, and no browser can hold up a capture."""

import contextlib
import http.client
import json
import socket
import threading
import time
from urllib.parse import urlsplit

import pytest

import granular_id as gid
from granular_id.live import LiveIdentifier, MonitorServer, SimSource, Snapshot, Views, opened
from live_view_cases import listening

BIG = listening(1.0, step=50)[1]


@pytest.fixture
def monitor():
    with MonitorServer() as running:
        yield running


def connected(monitor):
    return socket.create_connection(("127.0.0.1", monitor.port), timeout=10)


def ask(monitor, path, method="GET", **headers):
    connection = http.client.HTTPConnection("127.0.0.1", monitor.port, timeout=10)
    try:
        connection.request(method, path, headers=headers)
        response = connection.getresponse()
        return response.status, dict(response.getheaders()), response.read()
    finally:
        connection.close()


def stream(monitor, buffer_bytes=None):
    """A browser that opens the stream; what it reads is up to the caller."""
    browser = socket.socket()
    browser.settimeout(10)
    if buffer_bytes is not None:
        browser.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer_bytes)
    browser.connect(("127.0.0.1", monitor.port))
    browser.sendall(f"GET {urlsplit(monitor.url).path}events HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
    return browser


def events(browser, until):
    """Read events until one satisfies `until`; returns pairs of kind and data."""
    found, text = [], b""
    while True:
        text += browser.recv(1 << 16)
        *whole, text = text.split(b"\n\n")
        for part in whole:
            lines = part.decode().split("\r\n\r\n")[-1].split("\n")
            kind, data = (line.partition(": ")[2] for line in lines)
            found.append((kind, json.loads(data)))
            if until(*found[-1]):
                return found


def is_snapshot(kind, _):
    return kind == "snapshot"


def test_the_page_is_there_with_all_its_parts(monitor):
    path = urlsplit(monitor.url).path
    status, headers, body = ask(monitor, path)
    assert (status, headers["Content-Type"]) == (200, "text/html; charset=utf-8")
    assert b"http://" not in body
    assert b"https://" not in body
    for name, kind in (("style.css", "css"), ("page.css", "css"), ("page.js", "javascript")):
        status, headers, body = ask(monitor, path + name)
        assert (status, headers["Content-Type"]) == (200, f"text/{kind}; charset=utf-8")
        assert int(headers["Content-Length"]) == len(body) > 0
    assert ask(monitor, path, "HEAD")[::2] == (200, b"")
    status, headers, _ = ask(monitor, path.rstrip("/"))
    assert (status, headers["Location"]) == (308, path)


@pytest.mark.parametrize("method", ["GET", "POST"])
@pytest.mark.parametrize("name", ["", "page.js", "nothing", "..", None])
def test_every_answer_carries_the_security_headers(monitor, name, method):
    asked = "/" if name is None else urlsplit(monitor.url).path + name
    _, headers, _ = ask(monitor, asked, method)
    policy = dict(part.strip().split(" ", 1) for part in headers["Content-Security-Policy"].split(";"))
    assert policy["default-src"] == "'none'"
    assert policy["script-src"] == policy["style-src"] == policy["connect-src"] == "'self'"
    assert policy["frame-ancestors"] == policy["base-uri"] == policy["form-action"] == "'none'"
    assert "unsafe" not in headers["Content-Security-Policy"]
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["X-Frame-Options"] == "DENY"
    assert headers["Referrer-Policy"] == "no-referrer"
    assert headers["Cache-Control"] == "no-store"
    assert headers["Cross-Origin-Resource-Policy"] == "same-origin"
    assert not {"Server", "Access-Control-Allow-Origin"} & set(headers)


def test_without_the_token_there_is_nothing(monitor):
    token = urlsplit(monitor.url).path.strip("/")
    paths = (
        "/",
        "/events",
        "/page.js",
        f"/{token[:-1]}/",
        f"/{token}x/",
        f"/x/{token}/",
        "/?token=x",
        "/%C3/",
    )
    for path in paths:
        status, headers, body = ask(monitor, path)
        assert status == 401, path
        assert headers["WWW-Authenticate"] == "Bearer"
        assert token.encode() not in body
    assert len(token) >= 32
    with MonitorServer() as other:
        assert token not in other.url


@pytest.mark.parametrize(
    ("host", "status"),
    [("evil.example", 403), ("127.0.0.1.evil.example", 403), ("localhost.evil.example:80", 403), ("0.0.0.0", 403),
     ("", 403), ("127.0.0.1", 200), ("localhost", 200), ("LocalHost:8000", 200), ("127.0.0.1:1", 200)],
)  # fmt: skip
def test_only_this_machine_is_answered_through_any_tunnel(monitor, host, status):
    assert ask(monitor, urlsplit(monitor.url).path, Host=host)[0] == status


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE"])
def test_it_is_for_reading_only(monitor, method):
    status, headers, _ = ask(monitor, urlsplit(monitor.url).path, method)
    assert (status, headers["Allow"]) == (405, "GET, HEAD")


@pytest.mark.parametrize(
    "name",
    ["../monitor.py", "..%2fmonitor.py", "....//monitor.py", "/etc/passwd", "monitor.py", "page.html", "page.js/",
     "page.js%00", "\\..\\monitor.py", "events/"],
)  # fmt: skip
def test_there_are_no_other_files(monitor, name):
    assert ask(monitor, urlsplit(monitor.url).path + name)[0] == 404


@pytest.mark.parametrize(
    ("head", "why"),
    [(b"GET", b"no request"), (b"GET / FTP/1.0", b"no request"), (b"\x16\x03\x01\x02\x00", b"no request"),
     (b"G E T / HTTP/1.1", b"no request"), (b"GET / HTTP/1.1", b"machine it runs on"),
     (b"GET / HTTP/1.1\r\nHost: localhost\r\nHost: localhost", b"machine it runs on"),
     (b"GET http://x/ HTTP/1.1\r\nHost: localhost", b"lacks its secret")],
)  # fmt: skip
def test_what_no_browser_sends_is_refused(monitor, head, why):
    with connected(monitor) as browser:
        browser.sendall(head + b"\r\n\r\n")
        assert why in b"".join(iter(lambda: browser.recv(4096), b""))


def test_an_endless_request_is_cut_off(monitor):
    def talk_for_ever(browser):
        for _ in range(10_000):
            browser.sendall(b"GET /" + b"x" * 10_000)

    with connected(monitor) as browser, pytest.raises((ConnectionResetError, BrokenPipeError)):
        talk_for_ever(browser)
    assert ask(monitor, "/")[0] == 401


def test_who_asks_nothing_is_cut_off_and_holds_up_nobody(monitor, monkeypatch):
    monkeypatch.setattr("granular_id.live.monitor._Handler.timeout", 0.3)
    with contextlib.ExitStack() as silent:
        browsers = [silent.enter_context(connected(monitor)) for _ in range(80)]
        assert ask(monitor, "/")[0] == 401
        assert {browser.recv(1) for browser in browsers} == {b""}


def test_no_other_interface_listens(monitor):
    addresses = {entry[4][0] for entry in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)}
    # Loopback has more addresses than one, so there is another to try on any machine.
    for address in {"127.0.0.2", *addresses} - {"127.0.0.1"}:
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection((address, monitor.port), timeout=10)


def test_a_browser_gets_what_was_published(monitor):
    monitor.publish(BIG)
    with stream(monitor) as browser:
        ((_, data),) = events(browser, is_snapshot)
        assert data["values"] == [f"{value:.{3 + i // 3}f}" for i, value in enumerate(BIG.latest)]
        assert data["answer"]["title"] == BIG.decision.label
        assert data["ranking"] == [[name, f"{loss:.3f}"] for name, loss in BIG.decision.ranking]
        assert data["synthetic"].startswith("SYNTHETIC")
        assert data["figures"][:2] == [["lag", "1.2 ms", False], ["lost", "0", False]]
        monitor.publish(Snapshot("failed", hint="12 rows are missing"))
        *_, (_, data) = events(browser, lambda kind, data: kind == "snapshot" and data["number"] == 2)
        assert data["answer"]["detail"] == "12 rows are missing"
        assert data["values"] == ["-"] * 6


def test_a_silent_session_says_so_and_an_ended_one_too(monitor):
    monitor.publish(Snapshot("armed"))
    with stream(monitor) as browser:
        found = events(browser, lambda kind, _: kind == "quiet")
        assert [kind for kind, _ in found] == ["snapshot", "quiet"]
        assert found[-1][1]["for_s"] >= 0.9
        monitor.publish(Snapshot("failed", hint="the last one"))
        monitor.close()
        found = events(browser, lambda kind, _: kind == "end")
        assert "the last one" in [data["answer"]["detail"] for kind, data in found if kind == "snapshot"]
    with pytest.raises(RuntimeError, match="closed"):
        monitor.publish(BIG)
    with pytest.raises(ConnectionRefusedError):
        connected(monitor)


def test_at_most_thirty_updates_a_second(monitor):
    done = threading.Event()

    def flood():
        while not done.wait(0.001):
            monitor.publish(Snapshot("triggered"))

    thread = threading.Thread(target=flood)
    with stream(monitor) as browser:
        thread.start()
        try:
            found = []
            events(browser, lambda kind, data: found.append(time.monotonic()) or len(found) > 20)
        finally:
            done.set()
            thread.join()
    # Twenty steps of a thirtieth; unbridled they would take twenty milliseconds. A late first one may shorten them.
    assert found[-1] - found[0] > 0.5 * 20 / 30


def test_stalled_browsers_hold_up_neither_the_publisher_nor_others_nor_the_end():
    with MonitorServer() as monitor, contextlib.ExitStack() as stalled:
        for _ in range(10):
            stalled.enter_context(stream(monitor, buffer_bytes=1))
        with stream(monitor) as reading:
            # Frames of 50 kB: more of them than the kernel holds for a browser that never reads.
            for number in range(1, 31):
                monitor.publish(BIG)
                events(reading, lambda kind, data, n=number: kind == "snapshot" and data["number"] >= n)
            begun = time.monotonic()
            for _ in range(10_000):
                monitor.publish(BIG)
            assert time.monotonic() - begun < 5
            begun = time.monotonic()
            monitor.close()
            assert time.monotonic() - begun < 5
            assert events(reading, lambda kind, _: kind == "end")


def test_a_snapshot_that_cannot_be_sent_is_told_to_the_publisher():
    monitor = MonitorServer()
    with stream(monitor) as browser:
        monitor.publish(Snapshot("armed"))
        events(browser, is_snapshot)
        monitor.publish(Snapshot("armed", cutoff_hz=float("nan")))
        while browser.recv(1 << 16):  # the line breaks: nobody says that the session has ended
            pass
        with pytest.raises(RuntimeError, match="the monitor has stopped"):
            monitor.publish(BIG)
    with pytest.raises(RuntimeError, match="the monitor has stopped"):
        monitor.close()


def test_a_taken_port_is_named(monitor):
    with pytest.raises(OSError, match=f"cannot serve the monitor on port {monitor.port}: .*in use"):
        MonitorServer(monitor.port)


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"port": -1}, ValueError),
        ({"port": 65536}, ValueError),
        ({"port": "80"}, TypeError),
        ({"max_hz": 31}, ValueError),
    ],
)
def test_what_cannot_be_is_refused(options, error):
    with pytest.raises(error, match=f"{next(iter(options))} must be"):
        MonitorServer(**options)


def captured(model, views):
    """Answers and the counters of the stream after three pushes."""
    with opened(SimSource("rice", seed=2, speed=4)) as stream:
        live = LiveIdentifier(stream, model, views=views)
        answers = [live.push().decision for _ in range(3)]
        return answers, stream.health().counters


def test_a_stalled_browser_changes_neither_answers_nor_counters():
    data = gid.synthesize(["rice", "fine sugar"], n_per_class=8, duration_s=1.3, seed=5)
    model = gid.Identifier.fit(
        data.align(trigger="recorded", lead_s=0.1, n_samples=500), "hfmh", estimate=False
    )
    alone, before = captured(model, Views([]))
    with MonitorServer() as monitor, stream(monitor, buffer_bytes=1):
        watched, after = captured(model, Views([monitor]))
    assert [decision.ranking for decision in watched] == [decision.ranking for decision in alone]
    for counters in (before, after):
        troubles = {name: n for name, n in counters.items() if name not in ("written", "epochs") and n}
        assert troubles == {}
        assert counters["written"] >= 3 * model.n_samples
    assert before["epochs"] == after["epochs"]
