"""Processes made after a batch has run on threads, or beside streams at work: each can go on, and none waits for ever.

A forked child has a copy of everything but the threads of its parent. Whoever waits for those hangs.

``GRANULAR_ID_FORKS=100 pytest tests/python/core/test_fork.py`` starts a hundred children of each kind. The limits of
time are there to end a hang, not to measure.
"""

import itertools
import multiprocessing
import os
import select
import signal
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import fork_work as work
from granular_id.features import extract_features
from granular_id.live import WrenchBuffer

N_CHILDREN = int(os.environ.get("GRANULAR_ID_FORKS", "1"))
HANGS_S = 60.0

pytestmark = [
    pytest.mark.thread_unsafe(reason="starts processes"),
    # Forking beside threads is what is tested.
    pytest.mark.filterwarnings("ignore:This process .* is multi-threaded:DeprecationWarning"),
]
methods = [
    name for name in ("fork", "spawn", "forkserver") if name in multiprocessing.get_all_start_methods()
]
needs_fork = pytest.mark.skipif("fork" not in methods, reason="no fork on this system")
needs_proc = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="counts threads in /proc")


def n_threads():
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return int(status.split("Threads:")[1].split()[0])


def in_bare_child(answer):
    """What a child made by a bare fork answers; nothing where it hangs."""
    read, write = os.pipe()
    process = os.fork()
    if process == 0:
        try:
            os.write(write, answer().encode())
        finally:
            os._exit(0)
    os.close(write)
    with os.fdopen(read, "rb") as pipe:
        if not select.select([pipe], [], [], HANGS_S)[0]:
            os.kill(process, signal.SIGKILL)
        got = pipe.read().decode()
    os.waitpid(process, 0)
    return got


@contextmanager
def thread_at_work(step):
    """Another thread works on, step by step."""
    stop = threading.Event()

    def work_on():
        while not stop.is_set():
            step()

    worker = threading.Thread(target=work_on)
    worker.start()
    try:
        yield
    finally:
        stop.set()
        worker.join()


@pytest.mark.parametrize("method", methods)
def test_children_finish_a_batch_like_their_parents(method):
    context = multiprocessing.get_context(method)
    wanted = work.batch_digest()
    results = [work.in_child(context, HANGS_S) for _ in range(N_CHILDREN)]
    assert [digest for digest, _ in results] == [wanted] * N_CHILDREN
    assert len({process for _, process in results} | {os.getpid()}) == N_CHILDREN + 1
    assert work.batch_digest() == wanted


@needs_fork
def test_a_child_of_a_child():
    fork = multiprocessing.get_context("fork")
    digest, _ = work.in_child(fork, 2 * HANGS_S, work.send_digest_of_a_child, (fork, HANGS_S))
    assert digest == work.batch_digest()


@needs_fork
@pytest.mark.parametrize("pools", [(2,), (2, 3)], ids=["same pool", "pool made anew"])
def test_fork_while_another_thread_is_in_the_middle_of_a_batch(pools):
    wanted = work.batch_digest()
    big = np.random.default_rng(1).standard_normal((300, 400, 6))
    features = extract_features(big)
    inside, forked_inside, answers = [False], [], []
    threads = itertools.cycle(pools)

    def extract():
        inside[0] = True
        extract_features(big, threads=next(threads), out=features)
        inside[0] = False

    with thread_at_work(extract):
        for n in range(max(N_CHILDREN, 5)):
            time.sleep(0.001 * (n % 5))  # other moments of the batch
            forked_inside.append(inside[0])
            answers.append(in_bare_child(work.batch_digest))
    assert set(answers) == {wanted}
    assert any(forked_inside)
    assert np.array_equal(features, extract_features(big))


@needs_proc
def test_changing_the_number_of_threads_leaks_none():
    before = n_threads()
    for n in range(120):
        work.batch_digest(threads=1 + n % 4)
    # Replaced threads end by themselves, soon.
    limit = time.monotonic() + HANGS_S
    while n_threads() > before + 4 and time.monotonic() < limit:
        time.sleep(0.01)
    assert n_threads() <= before + 4


@needs_proc
def test_one_thread_and_one_recording_start_none():
    before = n_threads()
    for _ in range(20):
        work.batch_digest(threads=1)
        extract_features(work.a_batch()[0], threads=8)
        extract_features(work.a_batch()[0])
    assert n_threads() <= before


@needs_fork
@pytest.mark.parametrize("kind", ["extractor", "identifier", "multi-band identifier"])
def test_fork_while_another_thread_pushes(kind):
    """The child has a stream that is whole, and never waits."""
    stream, rows, ask = work.a_stream(kind)
    stream.push(rows[:300])
    wanted = ask(stream)

    def answer():
        stream.reset()
        stream.push(rows[:300])
        return "whole" if ask(stream) == wanted else "torn"

    def push():
        stream.reset()
        stream.push(rows)

    answers = []
    with thread_at_work(push):
        while len(answers) < max(N_CHILDREN, 8):
            time.sleep(0.0007 * (len(answers) % 5))  # other moments of the work
            answers.append(in_bare_child(answer))
    assert set(answers) == {answer()} == {"whole"}


@needs_fork
def test_fork_while_other_threads_fill_and_read_a_buffer():
    """The child has whole rows in order, may push its own, and neither end disturbs the parent's."""
    buffer = WrenchBuffer(seconds=1.0, rate_hz=500.0, tick_hz=500.0)
    reader, first = buffer.reader(from_oldest=True), itertools.count()

    def fill_and_read():
        ticks = np.arange(64.0) + 64 * next(first)
        buffer.push_block(np.repeat(ticks[:, None], 6, axis=1), ticks / 500.0)
        reader.read()
        reader.wait(0.0003)

    def answer():
        reader.read()  # whatever was ahead
        window = buffer.window(64)
        whole = (window.wrench == window.ticks[:, None]).all() and (np.diff(window.ticks) == 1).all()
        later = [window.ticks[-1] + 1.0] * 6
        taken = buffer.push(later, later[0] / 500.0) and reader.wait(0.0)
        return f"{whole} {taken} {reader.read().wrench.tolist() == [later]}"

    fill_and_read()
    with thread_at_work(fill_and_read):
        answers = [in_bare_child(answer) for _ in range(max(N_CHILDREN, 12))]
    assert set(answers) == {"True True True"}
    assert buffer.stats()["written"] == 64 * next(first)
