"""The monitor's page is closed by default, and no browser can hold up a capture."""

import contextlib
import http.client
import json
import socket
import threading
import time
from urllib.parse import urlsplit

import pytest

from granular_id.live import LiveIdentifier, MonitorServer, SimSource, Snapshot, Views, opened
from granular_id.live.monitor import _Handler
from live_view_cases import listening, pushes_and_model
from sink_cases import eventually

BIG = listening(1.0, step=50)[1]


@pytest.fixture
def monitor():
    with MonitorServer() as running:
        yield running


@pytest.fixture(scope="module")
def served():
    """A monitor that is only asked."""
    with MonitorServer() as running:
        yield running


def connected(monitor):
    return socket.create_connection(("127.0.0.1", monitor.port), timeout=10)


def ask(monitor, path, method="GET", **headers):
    """Ask for a path below the token, or for another one that begins with a slash."""
    connection = http.client.HTTPConnection("127.0.0.1", monitor.port, timeout=10)
    path = path if path.startswith("/") else urlsplit(monitor.url).path + path
    with contextlib.closing(connection):
        connection.request(method, path, headers=headers)
        response = connection.getresponse()
        return response.status, dict(response.getheaders()), response.read()


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


def has_number(number):
    return lambda kind, data: kind == "snapshot" and data["number"] >= number


def test_the_page_is_there_with_all_its_parts(served):
    parts = {"": "html", "style.css": "css", "page.css": "css", "page.js": "javascript"}
    for name, kind in parts.items():
        status, headers, body = ask(served, name)
        assert (status, headers["Content-Type"]) == (200, f"text/{kind}; charset=utf-8")
        assert int(headers["Content-Length"]) == len(body) > 0
        assert ask(served, name, "HEAD")[::2] == (200, b"")
    page = ask(served, "")[2]
    assert b"http://" not in page
    assert b"https://" not in page
    path = urlsplit(served.url).path
    status, headers, _ = ask(served, path.rstrip("/"))
    assert (status, headers["Location"]) == (308, path)


@pytest.mark.parametrize("method", ["GET", "POST"])
@pytest.mark.parametrize("path", ["", "page.js", "nothing", "..", "/"])
def test_every_answer_carries_the_security_headers(served, path, method):
    """Whatever it is, it may not be framed, read by others, or bring in anything from elsewhere."""
    _, headers, _ = ask(served, path, method)
    policy = dict(part.strip().split(" ", 1) for part in headers["Content-Security-Policy"].split(";"))
    assert policy["default-src"] == "'none'"
    assert policy["script-src"] == policy["style-src"] == policy["connect-src"] == "'self'"
    assert policy["frame-ancestors"] == policy["base-uri"] == policy["form-action"] == "'none'"
    assert "unsafe" not in headers["Content-Security-Policy"]
    guards = {
        "X-Content-Type-Options": "nosniff",
        "X-Frame-Options": "DENY",
        "Referrer-Policy": "no-referrer",
        "Cache-Control": "no-store",
        "Cross-Origin-Resource-Policy": "same-origin",
    }
    assert {name: headers[name] for name in guards} == guards
    assert not {"Server", "Access-Control-Allow-Origin"} & set(headers)


def test_without_the_token_there_is_nothing(served, monitor):
    token = urlsplit(served.url).path.strip("/")
    almost = (f"/{token[:-1]}/", f"/{token}x/", f"/x/{token}/", f"/?token={token}")
    for path in ("/", "/events", "/page.js", "/%C3/", *almost):
        status, headers, body = ask(served, path)
        assert (status, headers["WWW-Authenticate"]) == (401, "Bearer"), path
        assert token.encode() not in body
    assert len(token) >= 32
    assert token not in monitor.url, "another session has another one"


@pytest.mark.parametrize(
    ("host", "status"),
    [("evil.example", 403), ("127.0.0.1.evil.example", 403), ("localhost.evil.example:80", 403), ("0.0.0.0", 403),
     ("", 403), ("127.0.0.1", 200), ("localhost", 200), ("LocalHost:8000", 200), ("127.0.0.1:1", 200)],
)  # fmt: skip
def test_only_this_machine_is_answered_through_any_tunnel(served, host, status):
    assert ask(served, "", Host=host)[0] == status


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE"])
def test_it_is_for_reading_only(served, method):
    status, headers, _ = ask(served, "", method)
    assert (status, headers["Allow"]) == (405, "GET, HEAD")


@pytest.mark.parametrize(
    "name",
    ["../monitor.py", "..%2fmonitor.py", "....//monitor.py", "./etc/passwd", "monitor.py", "page.html", "page.js/",
     "page.js%00", "\\..\\monitor.py", "events/"],
)  # fmt: skip
def test_there_are_no_other_files(served, name):
    assert ask(served, name)[0] == 404


@pytest.mark.parametrize(
    ("head", "why"),
    [(b"GET", b"no request"), (b"GET / FTP/1.0", b"no request"), (b"\x16\x03\x01\x02\x00", b"no request"),
     (b"G E T / HTTP/1.1", b"no request"), (b"GET / HTTP/1.1", b"machine it runs on"),
     (b"GET / HTTP/1.1\r\nHost: localhost\r\nHost: localhost", b"machine it runs on"),
     (b"GET http://x/ HTTP/1.1\r\nHost: localhost", b"lacks its secret")],
)  # fmt: skip
def test_what_no_browser_sends_is_refused(served, head, why):
    with connected(served) as browser:
        browser.sendall(head + b"\r\n\r\n")
        assert why in b"".join(iter(lambda: browser.recv(4096), b""))


def test_an_endless_request_is_cut_off(served):
    def talk_for_ever(browser):
        for _ in range(10_000):
            browser.sendall(b"GET /" + b"x" * 10_000)

    with connected(served) as browser, pytest.raises((ConnectionResetError, BrokenPipeError)):
        talk_for_ever(browser)
    assert ask(served, "/")[0] == 401


def test_who_asks_nothing_is_cut_off_and_holds_up_nobody(served, monkeypatch):
    monkeypatch.setattr(_Handler, "timeout", 0.3)
    with contextlib.ExitStack() as silent:
        browsers = [silent.enter_context(connected(served)) for _ in range(80)]
        assert ask(served, "/")[0] == 401
        assert {browser.recv(1) for browser in browsers} == {b""}


def test_who_takes_nothing_is_dropped(monitor, monkeypatch):
    monkeypatch.setattr(_Handler, "stalled_s", 0.1)
    with stream(monitor, buffer_bytes=1):
        eventually(lambda: monitor._server.n_streams == 1)

        def is_dropped():
            monitor.publish(BIG)
            return not monitor._server.n_streams

        eventually(is_dropped)
    assert ask(monitor, "")[0] == 200


def test_no_other_interface_listens(served):
    addresses = {entry[4][0] for entry in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)}
    # Loopback has more addresses than one, so there is another to try on any machine.
    for address in {"127.0.0.2", *addresses} - {"127.0.0.1"}:
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection((address, served.port), timeout=10)


def test_a_browser_gets_what_was_published_as_it_comes(monitor, monkeypatch):
    monkeypatch.setattr("granular_id.live.monitor._QUIET_S", 60.0)  # nobody waits for that
    monitor.publish(BIG)
    with stream(monitor) as browser:
        ((_, data),) = events(browser, has_number(1))
        assert data["values"] == [f"{value:.{3 + i // 3}f}" for i, value in enumerate(BIG.latest)]
        assert data["answer"]["title"] == BIG.decision.label
        assert data["ranking"] == [[name, f"{loss:.3f}"] for name, loss in BIG.decision.ranking]
        assert data["synthetic"].startswith("SYNTHETIC")
        assert data["figures"][:2] == [["lag", "1.2 ms", False], ["lost", "0", False]]
        monitor.publish(Snapshot("failed", hint="12 rows are missing"))
        *_, (_, data) = events(browser, has_number(2))
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
                events(reading, has_number(number))
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
        events(browser, has_number(1))
        monitor.publish(Snapshot("armed", cutoff_hz=float("nan")))
        while browser.recv(1 << 16):  # the line breaks: nobody says that the session has ended
            pass
        with pytest.raises(RuntimeError, match="the monitor has stopped"):
            monitor.publish(BIG)
    with pytest.raises(RuntimeError, match="the monitor has stopped"):
        monitor.close()


def test_ports_and_rates_that_cannot_be_are_refused(served):
    with pytest.raises(OSError, match=f"cannot serve the monitor on port {served.port}: .*in use"):
        MonitorServer(served.port)
    for options, error in [
        ({"port": -1}, ValueError),
        ({"port": 65536}, ValueError),
        ({"port": "80"}, TypeError),
        ({"max_hz": 31}, ValueError),
    ]:
        with pytest.raises(error, match=f"{next(iter(options))} must be"):
            MonitorServer(**options)


def captured(model, views):
    """Answers and the counters of the stream after two pushes."""
    with opened(SimSource("rice", seed=2, speed=4)) as stream:
        live = LiveIdentifier(stream, model, views=views)
        answers = [live.push().decision for _ in range(2)]
        return answers, stream.health().counters


def test_a_stalled_browser_changes_neither_answers_nor_counters():
    _, model = pushes_and_model()
    alone, before = captured(model, Views([]))
    with MonitorServer() as monitor, stream(monitor, buffer_bytes=1):
        watched, after = captured(model, Views([monitor]))
    assert [decision.ranking for decision in watched] == [decision.ranking for decision in alone]
    for counters in (before, after):
        troubles = {name: n for name, n in counters.items() if name not in ("written", "epochs") and n}
        assert troubles == {}
        assert counters["written"] >= 2 * model.n_samples
    assert before["epochs"] == after["epochs"]
