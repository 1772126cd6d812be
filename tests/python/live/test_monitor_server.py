"""The monitor's page is closed by default, and no browser can hold up a capture."""

import contextlib
import http.client
import json
import re
import socket
import threading
import time
from urllib.parse import urlsplit

import pytest
from hypothesis import given, strategies as st

from granular_id.live.monitor import MonitorServer
from granular_id.live.monitor.request import answer
from granular_id.live.snapshot import Snapshot
from live_view_cases import listening

BIG = listening(1.0, step=50)[1]


@pytest.fixture
def monitor():
    with MonitorServer() as running:
        yield running


def ask(monitor, path, method="GET", **headers):
    connection = http.client.HTTPConnection("127.0.0.1", monitor.port, timeout=10)
    try:
        connection.request(method, path, headers=headers)
        response = connection.getresponse()
        return response.status, dict(response.getheaders()), response.read()
    finally:
        connection.close()


def stream(monitor, timeout=10):
    """A browser that opens the stream; what it reads is up to the caller."""
    parts = urlsplit(monitor.url)
    browser = socket.create_connection(("127.0.0.1", monitor.port), timeout=timeout)
    browser.sendall(f"GET {parts.path}events HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
    return browser


def events(browser, until):
    """Read events until one satisfies `until`; returns pairs of kind and data."""
    found, text = [], b""
    while True:
        text += browser.recv(1 << 16)
        *whole, text = text.split(b"\n\n")
        for part in whole:
            lines = part.decode().split("\r\n\r\n")[-1].split("\n")
            kind = next((line[7:] for line in lines if line.startswith("event: ")), None)
            data = next((line[6:] for line in lines if line.startswith("data: ")), None)
            if kind:
                found.append((kind, json.loads(data)))
                if until(*found[-1]):
                    return found


def test_the_page_is_there_with_all_its_parts(monitor):
    path = urlsplit(monitor.url).path
    status, headers, body = ask(monitor, path)
    assert (status, headers["Content-Type"]) == (200, "text/html; charset=utf-8")
    assert b"http://" not in body
    assert b"https://" not in body
    for name in ("report.css", "page.css", "page.js", "frame.js", "traces.js", "ranking.js"):
        status, headers, body = ask(monitor, path + name)
        assert status == 200, name
        assert int(headers["Content-Length"]) == len(body) > 0
        assert headers["Content-Type"].split(";")[0] in ("text/css", "text/javascript")
    assert ask(monitor, path, "HEAD")[::2] == (200, b"")


def test_a_missing_slash_is_made_up_for(monitor):
    path = urlsplit(monitor.url).path
    status, headers, _ = ask(monitor, path.rstrip("/"))
    assert (status, headers["Location"]) == (308, path)


def test_every_answer_carries_the_security_headers(monitor):
    path = urlsplit(monitor.url).path
    for asked in (path, path + "page.js", path + "nothing", "/"):
        _, headers, _ = ask(monitor, asked)
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
        assert "Server" not in headers
        assert "Access-Control-Allow-Origin" not in headers


def test_without_the_token_there_is_nothing(monitor):
    token = urlsplit(monitor.url).path.strip("/")
    for path in (
        "/",
        "/events",
        "/page.js",
        f"/{token[:-1]}/",
        f"/{token}x/",
        f"/x/{token}/",
        "/?token=x",
    ):
        status, headers, body = ask(monitor, path)
        assert status == 401, path
        assert headers["WWW-Authenticate"] == "Bearer"
        assert token.encode() not in body
    assert len(token) >= 32
    with MonitorServer() as other:
        assert token not in other.url


@pytest.mark.parametrize(
    "host", ["evil.example", "127.0.0.1.evil.example", "localhost.evil.example:80", "0.0.0.0", ""]
)
def test_another_host_is_refused_with_the_token_too(monitor, host):
    assert ask(monitor, urlsplit(monitor.url).path, Host=host)[0] == 403


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "LocalHost:8000", "127.0.0.1:1"])
def test_this_machine_is_this_machine_through_any_tunnel(monitor, host):
    assert ask(monitor, urlsplit(monitor.url).path, Host=host)[0] == 200


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE"])
def test_it_is_for_reading_only(monitor, method):
    status, headers, _ = ask(monitor, urlsplit(monitor.url).path, method)
    assert (status, headers["Allow"]) == (405, "GET, HEAD")


@pytest.mark.parametrize(
    "name",
    ["../server.py", "..%2fserver.py", "%2e%2e/request.py", "....//server.py", "/etc/passwd", "server.py", "page.html",
     "page.js/", "page.js%00", "\\..\\server.py", "events/", "__init__.py"],
)  # fmt: skip
def test_there_are_no_other_files(monitor, name):
    assert ask(monitor, urlsplit(monitor.url).path + name)[0] == 404


@pytest.mark.parametrize(
    "head",
    [b"\r\n\r\n", b"GET\r\n\r\n", b"GET /\r\n\r\n", b"GET / FTP/1.0\r\n\r\n", b"GET http://x/ HTTP/1.1\r\n\r\n",
     b"\x16\x03\x01\x02\x00\r\n\r\n", b"G E T / HTTP/1.1\r\n\r\n"],
)  # fmt: skip
def test_what_is_no_request_is_refused(head):
    assert answer(head, "secret").head.startswith(b"HTTP/1.1 400 ")


def test_two_hosts_are_none():
    head = b"GET /secret/ HTTP/1.1\r\nHost: localhost\r\nHost: evil.example\r\n\r\n"
    assert answer(head, "secret").head.startswith(b"HTTP/1.1 403 ")


@given(st.binary(max_size=400), st.sampled_from([b"", b"GET /secret", b"GET /secret/ HTTP/1.1\r\nHost:"]))
def test_whatever_comes_gets_an_answer_and_nothing_without_token_and_host(noise, begin):
    head = begin + noise + b"\r\n\r\n"
    response = answer(head, "secret")
    assert re.match(rb"HTTP/1.1 (200|308|400|401|403|404|405) ", response.head)
    if response.head.startswith(b"HTTP/1.1 200 "):
        assert b"/secret/" in head
        assert re.search(rb"(?i)host:[ \t]*(127\.0\.0\.1|localhost)", head)


def test_an_endless_request_is_cut_off(monitor):
    def talk_for_ever(browser):
        for _ in range(10_000):
            browser.sendall(b"GET /" + b"x" * 10_000)

    browser = socket.create_connection(("127.0.0.1", monitor.port), timeout=10)
    with browser, pytest.raises((ConnectionResetError, BrokenPipeError)):
        talk_for_ever(browser)
    assert ask(monitor, "/")[0] == 401


def test_who_asks_too_slowly_is_cut_off(monitor, monkeypatch):
    monkeypatch.setattr("granular_id.live.monitor.server._HEAD_S", 0.1)
    with socket.create_connection(("127.0.0.1", monitor.port), timeout=10) as browser:
        browser.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\n")  # and never the empty line
        assert browser.recv(1) == b""
    assert ask(monitor, "/")[0] == 401


def test_many_that_ask_nothing_leave_no_room_only_for_a_while(monitor, monkeypatch):
    monkeypatch.setattr("granular_id.live.monitor.server._HEAD_S", 0.3)
    silent = [socket.create_connection(("127.0.0.1", monitor.port), timeout=10) for _ in range(80)]
    try:
        for browser in silent:  # some at once, for want of room, the others when their time is over
            with contextlib.suppress(ConnectionResetError):
                assert browser.recv(1) == b""
        assert ask(monitor, "/")[0] == 401
        assert len(monitor._connections) <= 1  # that of the question may not be over yet
    finally:
        for browser in silent:
            browser.close()


def test_no_other_interface_listens(monitor):
    addresses = {entry[4][0] for entry in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)}
    # Loopback has more addresses than one, so there is another to try on any machine.
    for address in {"127.0.0.2", *addresses} - {"127.0.0.1"}:
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection((address, monitor.port), timeout=10)


def test_a_browser_gets_what_was_published(monitor):
    monitor.publish(BIG)
    with stream(monitor) as browser:
        ((_, data),) = events(browser, lambda kind, _: kind == "snapshot")
        assert data["latest"] == BIG.latest.tolist()
        assert data["answer"]["title"] == BIG.decision.label
        assert data["ranking"] == [list(pair) for pair in BIG.decision.ranking]
        assert data["synthetic"].startswith("SYNTHETIC")
        assert data["figures"][:2] == [["lag", "1.2 ms", False], ["lost", "0", False]]
        monitor.publish(Snapshot("failed", hint="12 rows are missing"))
        *_, (_, data) = events(browser, lambda kind, data: kind == "snapshot" and data["number"] == 2)
        assert data["answer"]["detail"] == "12 rows are missing"
        assert data["latest"] == [None] * 6


def test_a_silent_session_says_so_and_an_ended_one_too(monitor):
    monitor.publish(Snapshot("armed"))
    with stream(monitor) as browser:
        found = events(browser, lambda kind, _: kind == "quiet")
        assert [kind for kind, _ in found] == ["snapshot", "quiet"]
        assert found[-1][1]["for_s"] >= 1
        monitor.publish(Snapshot("complete"))
        monitor.close()
        found = events(browser, lambda kind, _: kind == "end")
        assert ("snapshot", "complete") in [(kind, data.get("state")) for kind, data in found]
    with pytest.raises(RuntimeError, match="closed"):
        monitor.publish(BIG)


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


def test_stalled_browsers_neither_hold_up_the_publisher_nor_fill_the_memory(monitor):
    stalled = [stream(monitor) for _ in range(10)]
    try:
        with stream(monitor) as reading:
            monitor.publish(BIG)
            events(reading, lambda kind, _: kind == "snapshot")
            # Frames of 50 kB: more of them than the kernel holds for a browser that never reads.
            for number in range(2, 202):
                monitor.publish(BIG)
                if number % 20 == 0:
                    events(reading, lambda kind, data, n=number: kind == "snapshot" and data["number"] >= n)
            waiting = [writer.transport.get_write_buffer_size() for writer in tuple(monitor._streams)]
            assert len(waiting) == 11
            assert max(waiting) < 200_000  # less than two frames for each of them
    finally:
        for browser in stalled:
            browser.close()


def test_publishing_takes_no_lock_and_needs_no_server_thread(monitor):
    held, release = threading.Event(), threading.Event()
    monitor.publish(Snapshot("armed"))
    with stream(monitor) as browser:
        events(browser, lambda kind, _: kind == "snapshot")
        loop_blocker = next(iter(monitor._streams.values()))

        def hold(*_):
            held.set()
            release.wait(30)

        loop_blocker.offer = hold  # the whole event loop stands still
        assert held.wait(10)
        for _ in range(10_000):
            monitor.publish(BIG)
        assert not release.is_set()
        release.set()


def test_too_many_pages_are_refused_and_room_is_made_by_closing_one(monitor):
    monitor.publish(Snapshot("armed"))
    pages = [stream(monitor) for _ in range(16)]
    try:
        for page in pages:
            events(page, lambda kind, _: kind == "snapshot")
        assert ask(monitor, urlsplit(monitor.url).path + "events")[0] == 503
        pages.pop().close()
        deadline = time.monotonic() + 10
        while len(monitor._streams) > 15 and time.monotonic() < deadline:
            time.sleep(0.01)
        with stream(monitor) as page:
            events(page, lambda kind, _: kind == "snapshot")
    finally:
        for page in pages:
            page.close()


def test_a_snapshot_that_cannot_be_sent_is_told_to_the_publisher(monitor):
    monitor.publish(Snapshot("armed"))
    with stream(monitor) as browser:
        events(browser, lambda kind, _: kind == "snapshot")
        monitor.publish(Snapshot("armed", time_s=float("nan")))
        monitor._thread.join(10)
        with pytest.raises(RuntimeError, match="the monitor has stopped"):
            monitor.publish(BIG)
    monitor.failure = None  # told: the fixture may close it


def test_a_taken_port_is_named(monitor):
    with pytest.raises(OSError, match=f"cannot serve the monitor on port {monitor.port}: .*in use"):
        MonitorServer(monitor.port)


@pytest.mark.parametrize(
    ("port", "error"), [(-1, ValueError), (65536, ValueError), ("80", TypeError), (True, TypeError)]
)
def test_no_such_port(port, error):
    with pytest.raises(error, match="port must be"):
        MonitorServer(port)
