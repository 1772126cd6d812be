"""However a program ends, the box is told to stop; a forked child leaves its parent's stream alone."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

from granular_id.testing import FakeNetft
from rdt_cases import START, STOP
from sink_cases import eventually

BEGIN = """
import os, signal, sys, time
from granular_id._core import WrenchBuffer
from granular_id.live.source import open_source
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in what a shell starts in the background
source = open_source(sys.argv[1])
buffer = WrenchBuffer(5, rate_hz=source.info.rate_hz, tick_hz=source.info.tick_hz)
source.start(buffer)
"""

FORK = """
child = os.fork()
if not child:
    health = source.health()
    assert not health.running and "forked" in health.error, health
    frozen = buffer.stats()["written"]
    time.sleep(0.1)
    assert buffer.stats()["written"] == frozen
    source.stop()
    try:
        source.start(buffer)
    except RuntimeError as error:
        assert "a sensor is writing" in str(error), error
    else:
        raise AssertionError("the buffer is the parent's")
    sys.exit(7)  # with all that runs at the end of an interpreter
assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
rows = source.health().counters["rows"]
while source.health().counters["rows"] < rows + 100:
    time.sleep(0.01)
assert source.health().running
print("streaming on", flush=True)
sys.stdin.readline()
"""


@pytest.fixture
def box():
    with FakeNetft() as running:
        yield running


def program(box, text):
    return subprocess.Popen(
        [sys.executable, "-W", "ignore", "-c", BEGIN + text, box.url],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.mark.parametrize(
    ("text", "interrupt", "code", "said"),
    [
        ("raise ValueError('mine')", False, 1, "ValueError: mine"),
        ("import gc; source = None; gc.collect(); time.sleep(0.2)", False, 0, ""),
        (
            "print('ready', flush=True)\nwhile True:\n    time.sleep(0.05)",
            True,
            -signal.SIGINT,
            "KeyboardInterrupt",
        ),
    ],
    ids=["an exception", "forgotten", "Ctrl-C"],
)
def test_a_program_that_ends_stops_the_stream(box, text, interrupt, code, said):
    process = program(box, text)
    if interrupt:
        assert process.stdout.readline() == "ready\n"
        process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == code, errors
    assert said in errors
    eventually(lambda: box.requests[-1] == STOP)
    assert box.requests[0] == START


def test_a_forked_child_leaves_the_stream_alone(box):
    process = program(box, FORK)
    assert process.stdout.readline() == "streaming on\n", process.communicate(timeout=60)
    # the child has ended meanwhile, and asked for nothing
    assert set(box.requests) == {START}
    _, errors = process.communicate("\n", timeout=60)
    assert process.returncode == 0, errors
    eventually(lambda: box.requests[-1] == STOP)
