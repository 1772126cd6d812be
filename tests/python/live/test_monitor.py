"""The monitor's page is closed by default, and no browser can hold up a capture."""

import contextlib
import http.client
import json
import socket
from urllib.parse import urlsplit

import pytest

from granular_id.live import MonitorServer, Snapshot
from granular_id.live.monitor import frame
from live_view_cases import listening

BIG = listening(1.0, step=50)[1]


@pytest.fixture
def monitor():
    with contextlib.closing(MonitorServer()) as running:
        yield running


@pytest.fixture(scope="module")
def served():
    """A monitor that is only asked."""
    with contextlib.closing(MonitorServer()) as running:
        yield running


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


def test_page_is_there_with_all_its_parts(served):
    for name, kind in {"": "html", "style.css": "css", "page.css": "css", "page.js": "javascript"}.items():
        status, headers, body = ask(served, name)
        assert (status, headers["Content-Type"]) == (200, f"text/{kind}; charset=utf-8")
        assert int(headers["Content-Length"]) == len(body) > 0
    assert b"://" not in ask(served, "")[2]


@pytest.mark.parametrize("method", ["GET", "POST"])
@pytest.mark.parametrize("path", ["", "nothing", "/"])
def test_every_answer_carries_the_security_headers(served, path, method):
    headers = ask(served, path, method)[1]
    policy = dict(part.strip().split(" ", 1) for part in headers["Content-Security-Policy"].split(";"))
    assert policy["default-src"] == "'none'"
    assert policy["script-src"] == policy["style-src"] == policy["connect-src"] == "'self'"
    assert policy["frame-ancestors"] == policy["base-uri"] == policy["form-action"] == "'none'"
    assert "unsafe" not in headers["Content-Security-Policy"]
    assert (headers["X-Content-Type-Options"], headers["Referrer-Policy"]) == ("nosniff", "no-referrer")
    assert (headers["Cache-Control"], headers["X-Frame-Options"]) == ("no-store", "DENY")
    assert not {"Server", "Access-Control-Allow-Origin"} & set(headers)


def test_request_without_token_is_refused(served, monitor):
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
    [("evil.example", 403), ("127.0.0.1.evil.example", 403), ("localhost.evil.example:80", 403), ("", 403),
     ("127.0.0.1", 200), ("LocalHost:8000", 200)],
)  # fmt: skip
def test_request_for_another_host_is_refused(served, host, status):
    assert ask(served, "", Host=host)[0] == status


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "HEAD", "OPTIONS", "TRACE"])
def test_request_that_is_no_get_is_refused(served, method):
    status, headers, _ = ask(served, "", method)
    assert (status, headers["Allow"]) == (405, "GET")


@pytest.mark.parametrize(
    "name", ["../monitor.py", "..%2fmonitor.py", "monitor.py", "page.html", "page.js/", "events/"]
)
def test_other_files_are_not_served(served, name):
    assert ask(served, name)[0] == 404


def test_only_loopback_listens(served):
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.2", served.port), timeout=10)


def test_browser_gets_snapshots_silence_and_the_end(monitor):
    monitor.show(BIG)
    with stream(monitor) as browser:
        ((_, data),) = events(browser, has_number(1))
        assert [axis["value"] for axis in data["axes"]] == BIG.words.values
        assert data["answer"]["title"] == BIG.decision.label
        assert [line[:2] for line in data["ranking"]["lines"]] == [list(pair) for pair in BIG.words.ranking]
        assert data["synthetic"].startswith("SYNTHETIC")
        events(browser, lambda kind, _: kind == "quiet")
        monitor.show(Snapshot("failed", hint="12 rows are missing"))
        monitor.close()
        found = events(browser, lambda kind, _: kind == "end")
        assert [data["answer"]["detail"] for kind, data in found if kind == "snapshot"] == [
            "12 rows are missing"
        ]


def test_stalled_browsers_hold_up_neither_show_nor_others_nor_close(monitor):
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


def test_frame_is_small():
    assert len(frame(listening(3.2)[1], 1)) < 60_000


def test_port_that_cannot_be_is_refused(served):
    with pytest.raises(OSError, match=f"cannot serve the monitor on port {served.port}: .*in use"):
        MonitorServer(served.port)
    for port in (-1, 65536):
        with pytest.raises(ValueError, match="port must be"):
            MonitorServer(port)
