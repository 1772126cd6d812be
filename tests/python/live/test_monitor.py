"""The monitor's page is closed by default, and no browser can hold up a capture."""

import contextlib
import http.client
import json
import socket
from urllib.parse import urlsplit

import pytest

from granular_id.live import MonitorServer
from granular_id.live.snapshot import Snapshot
from live_view_cases import listening

BIG = listening(1.0, step=50)[1]


@pytest.fixture
def monitor():
    with contextlib.closing(MonitorServer()) as running:
        yield running


def stream(monitor, buffer_bytes=None):
    """A browser that opens the stream; what it reads is up to the caller."""
    browser = socket.socket()
    browser.settimeout(10)
    if buffer_bytes is not None:
        browser.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer_bytes)
    browser.connect(("127.0.0.1", monitor.server_address[1]))
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


def each(status, *paths, method="GET", host="localhost"):
    return [(status, method, path, host) for path in paths]


OTHERS = ("../monitor.py", "..%2fmonitor.py", "monitor.py", "page.html", "page.js/", "events/")


@pytest.mark.parametrize(
    ("status", "method", "path", "host"),
    [
        *each(200, "/TOKEN/", "/TOKEN/style.css", "/TOKEN/page.css", "/TOKEN/page.js"),
        *each(200, "/TOKEN/", host="127.0.0.1"),
        *each(200, "/TOKEN/", host="LocalHost:8000"),
        *each(403, "/TOKEN/", host="evil.example"),
        *each(403, "/TOKEN/", host="127.0.0.1.evil.example"),
        *each(403, "/TOKEN/", host="localhost.evil.example:80"),
        *each(403, "/TOKEN/", host=""),
        *each(401, "/", "/events", "/page.js", "/%C3/", "/TOKENx/", "/x/TOKEN/", "/?token=TOKEN"),
        *each(404, "/TOKEN", *(f"/TOKEN/{name}" for name in OTHERS)),
        *(each(405, "/TOKEN/", method=method)[0] for method in ("POST", "PUT", "HEAD", "OPTIONS", "TRACE")),
    ],
)
def test_request_gets_its_status_and_the_security_headers(monitor, status, method, path, host):
    token = urlsplit(monitor.url).path.strip("/")
    assert len(token) >= 32
    connection = http.client.HTTPConnection("127.0.0.1", monitor.server_address[1], timeout=10)
    with contextlib.closing(connection):
        connection.request(method, path.replace("TOKEN", token), headers={"Host": host})
        response = connection.getresponse()
        headers, body = dict(response.getheaders()), response.read()
    assert response.status == status
    assert int(headers["Content-Length"]) == len(body) or method == "HEAD"
    assert token.encode() not in body
    policy = dict(part.strip().split(" ", 1) for part in headers["Content-Security-Policy"].split(";"))
    assert policy["default-src"] == "'none'"
    assert policy["script-src"] == policy["style-src"] == policy["connect-src"] == "'self'"
    assert policy["frame-ancestors"] == policy["base-uri"] == policy["form-action"] == "'none'"
    assert (headers["X-Content-Type-Options"], headers["Referrer-Policy"]) == ("nosniff", "no-referrer")
    assert (headers["Cache-Control"], headers["X-Frame-Options"]) == ("no-store", "DENY")
    assert headers["Allow"] == "GET"
    assert not {"Server", "Access-Control-Allow-Origin"} & set(headers)


def test_only_loopback_listens(monitor):
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.2", monitor.server_address[1]), timeout=10)


def test_browser_gets_snapshots_silence_and_the_end(monitor):
    monitor.show(BIG)
    with stream(monitor) as browser:
        ((_, data),) = events(browser, has_number(1))
        assert [axis["value"].replace("\u2212", "-") for axis in data["axes"]] == BIG.words.values
        assert data["answer"]["title"] == BIG.decision.label
        best = [[name, f"{loss:.3f}"] for name, loss in BIG.decision.ranking]
        assert data["ranking"]["names"] == best
        assert data["synthetic"].startswith("SYNTHETIC")
        events(browser, lambda kind, _: kind == "quiet")
        monitor.show(Snapshot("failed", hint="12 rows are missing"))
        monitor.close()
        found = events(browser, lambda kind, _: kind == "end")
        last = [data["answer"]["detail"] for kind, data in found if kind == "snapshot"]
        assert last == ["12 rows are missing"]


def test_stalled_browsers_hold_up_nothing(monitor):
    with contextlib.ExitStack() as stalled:
        for _ in range(3):
            stalled.enter_context(stream(monitor, buffer_bytes=1))
        with stream(monitor) as reading:
            # More frames than the kernel holds for a browser that never reads.
            for number in range(1, 31):
                monitor.show(BIG)
                events(reading, has_number(number))
            monitor.close()
            assert events(reading, lambda kind, _: kind == "end")


def test_port_that_cannot_be_is_refused(monitor):
    port = monitor.server_address[1]
    with pytest.raises(OSError, match=f"cannot serve the monitor on port {port}: .*in use"):
        MonitorServer(port)
    for port in (-1, 65536):
        with pytest.raises(ValueError, match="port must be"):
            MonitorServer(port)
