"""The page of a sensor box: what it must say, and how hostile it may be."""

from __future__ import annotations

import socket
import threading
from contextlib import suppress

import pytest

from granular_id.live import netft_page
from granular_id.live.netft_page import NetftPageError, parse_page, read_page
from granular_id.testing import FakeNetft, page_text

URL = "http://192.168.1.1/netftapi2.xml"
OK = b"HTTP/1.0 200 OK\r\n\r\n"


def page(**changes):
    return parse_page(page_text(changes), URL)


def server(*chunks):
    """Answer one question with these bytes, whatever it is, and wait where a chunk is None; returns the port."""
    listening = socket.create_server(("127.0.0.1", 0))

    def answer():
        client, _ = listening.accept()
        with listening, client, suppress(OSError):  # the client may have heard enough
            client.recv(1024)
            for chunk in chunks:
                if chunk is None:
                    client.recv(1)  # until it goes
                else:
                    client.sendall(chunk)

    threading.Thread(target=answer, daemon=True).start()
    return listening.getsockname()[1]


def test_page_units_become_newton_and_newton_metre():
    pound, inch = 4.4482216152605, 0.0254
    read = page(scfgfu="lbf", scfgtu="lbf-in", cfgmr="1;2;3;4;5;6")
    assert read.counts_per_newton == pytest.approx(1e6 / pound, rel=1e-15)
    assert read.counts_per_newton_metre == pytest.approx(1e6 / (pound * inch), rel=1e-15)
    assert read.full_scale == pytest.approx([pound * n * (1 if n < 4 else inch) for n in range(1, 7)])


NO_NUMBERS = (None, "", "0", "-1e6", "nan", "inf", "1e400", "1/2", "abc", "x" * 500, "Ⅷ")


@pytest.mark.parametrize("field", ["cfgcpf", "cfgcpt", "scfgfu", "scfgtu", "comrdtrate"])
def test_page_missing_or_bad_field_is_refused(field):
    for value in NO_NUMBERS:
        with pytest.raises(NetftPageError, match=rf"^{URL}: field {field} is .*; wanted ") as caught:
            page(**{field: value})
        assert len(str(caught.value)) < 300


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (page_text({"cfgcpf": "1e12"}), "field cfgcpf is '1e12'; wanted 1 to 1e[+]09 counts per newton"),
        (page_text({"scfgfu": "klbf", "cfgcpf": "4000"}), "counts per newton, got 0.899"),
        (page_text({"scfgtu": "Nmm", "cfgcpt": "1e10"}), "counts per newton metre, got 1e[+]13"),
        (page_text({}).replace(b"</netft>", b"<cfgcpf>9</cfgcpf></netft>"), "is '1000000' and '9'"),
        (b"", "is no XML"),
        (b"no page at all", "is no XML"),
        (b'<?xml version="1.0" encoding="no-such"?><a/>', "is no XML"),
    ],
)
def test_page_absurd_scale_or_other_text_is_refused(text, words):
    with pytest.raises(NetftPageError, match=f"^{URL}.*{words}"):
        parse_page(text, URL)


def test_page_without_optional_fields_is_read():
    bare = page(prodname=None, cfgcalsn=None, cfgmr=None, runrate=None, setuserfilter=None)
    assert (bare.text("prodname"), bare.full_scale, bare.tick_hz) == ("", None, None)
    assert page(cfgmr="1;2;3;4;5").full_scale is None
    assert page(cfgmr="1,2 3;4,5,0").full_scale is None
    assert page(cfgmr="1,2 3;4,5,6").full_scale == (1, 2, 3, 4, 5, 6)
    assert page(cfgcalsn="FT\x7f1").text("cfgcalsn") == "FT1"


def test_read_page_of_a_box():
    with FakeNetft(rate_hz=1000) as box:
        read = read_page("127.0.0.1", box.http_port)
    assert (read.rate_hz, read.tick_hz) == (1000, 7000)
    assert read.url == f"http://127.0.0.1:{box.http_port}/netftapi2.xml"
    with pytest.raises(ConnectionError, match=rf"{read.url} cannot be read"):
        read_page("127.0.0.1", box.http_port)


@pytest.mark.parametrize(
    ("answer", "kind", "words"),
    [
        (b"SSH-2.0-OpenSSH_9.2\r\n", ConnectionError, "cannot be read"),
        (b"", ConnectionError, "cannot be read"),
        (b"HTTP/1.0 404 Not Found\r\n\r\n", NetftPageError, "answers 404 Not Found"),
        (b"HTTP/1.0 301 Moved\r\nLocation: /x\r\n\r\n", NetftPageError, "answers 301"),
        (OK + b"x" * (1 << 22), NetftPageError, "longer than 65536 bytes"),
        (OK + b"<html></html>", NetftPageError, "field scfgfu is missing"),
    ],
)
def test_read_page_of_another_server_is_refused(answer, kind, words):
    with pytest.raises(kind, match=words):
        read_page("127.0.0.1", server(answer))


@pytest.mark.parametrize("chunks", [[None], [OK, b"X", None]], ids=["silent", "stops"])
def test_read_page_silent_server_is_left(chunks, monkeypatch):
    monkeypatch.setattr(netft_page, "TIMEOUT_S", 0.1)
    with pytest.raises(TimeoutError, match=r"did not answer within 0\.1 s"):
        read_page("127.0.0.1", server(*chunks))


def test_read_page_server_that_drips_is_left(monkeypatch):
    # each look at the time is a second later: each byte comes in time, the whole does not
    clock = iter(range(1000))
    monkeypatch.setattr(netft_page.time, "monotonic", lambda: next(clock))
    with pytest.raises(TimeoutError, match=r"did not answer within 2 s"):
        read_page("127.0.0.1", server(OK, *[b"X"] * 100, None))
