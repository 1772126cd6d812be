"""Extraction from many threads at once: every thread gets its own result, and others run meanwhile."""

import sys
import threading
import time

import numpy as np
import pytest

import features_twin as twin
from granular_id.features import FeatureSpec, extract_features

N_THREADS = 8


def at_once(functions):
    """Results of functions that threads call at the same moment, in their order."""
    results = [None] * len(functions)
    errors = []
    gate = threading.Barrier(len(functions))

    def run(n, function):
        try:
            gate.wait()
            results[n] = function()
        except BaseException as error:
            errors.append(error)

    threads = [threading.Thread(target=run, args=pair) for pair in enumerate(functions)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not errors
    return results


def batches():
    """A batch of its own size and with its own options for each thread."""
    rng = np.random.default_rng(31)
    for n in range(N_THREADS):
        wrench = rng.standard_normal((5 + 3 * n, 100 + 31 * n, (6, 6, 3, 13)[n % 4]))
        yield wrench, {"n_bins": 10 + n, "order": 1 + n, "outside": ("drop", "clip")[n % 2]}


@pytest.mark.parametrize("threads", [1, 2, (1, 2, 3, 4)], ids=str)
def test_different_batches_at_once(threads):
    given = list(batches())
    wanted = [twin.features(wrench, **options) for wrench, options in given]

    def job(n):
        wrench, options = given[n]
        count = threads if isinstance(threads, int) else threads[n % len(threads)]

        def run():
            differing = 0
            for _ in range(10):
                differing += twin.differing_bits(
                    extract_features(wrench, threads=count, **options), wanted[n]
                )
            return differing

        return run

    assert at_once([job(n) for n in range(N_THREADS)]) == [0] * N_THREADS


def test_one_input_and_one_spec_read_by_all():
    wrench = np.random.default_rng(32).standard_normal((30, 200, 6))
    spec = FeatureSpec(n_bins=20)
    wanted = twin.features(wrench, n_bins=20)
    results = at_once([lambda: extract_features(wrench, spec=spec, threads=2)] * N_THREADS)
    assert [twin.differing_bits(result, wanted) for result in results] == [0] * N_THREADS


def test_rows_of_one_output_written_by_many():
    wrench = np.random.default_rng(33).standard_normal((N_THREADS, 500, 6))
    wanted = twin.features(wrench)
    table = np.empty_like(wanted)
    rows = [slice(n, n + 1) for n in range(N_THREADS)]
    at_once([lambda row=row: extract_features(wrench[row], out=table[row]) for row in rows])
    assert twin.differing_bits(table, wanted) == 0


def test_an_output_written_by_another_thread_is_refused_or_written_whole():
    wrench = np.random.default_rng(34).standard_normal((200, 400, 6))
    wanted = extract_features(wrench)
    out = np.empty_like(wanted)

    def refused():
        try:
            extract_features(wrench, out=out, threads=2)
        except ValueError as error:
            return "out must" in str(error)
        return False

    results = at_once([lambda: sum(refused() for _ in range(5))] * 4)
    assert sum(results) < 20
    assert twin.differing_bits(out, wanted) == 0


def test_errors_stay_with_their_thread():
    good = np.random.default_rng(35).standard_normal((20, 100, 6))
    bad = good.copy()
    bad[7, 50, 2] = np.nan
    wanted = extract_features(good)

    def well():
        return all(np.array_equal(extract_features(good, threads=2), wanted) for _ in range(10))

    def ill():
        for _ in range(10):
            with pytest.raises(ValueError, match="recording 7, sample 50, axis 2"):
                extract_features(bad, threads=2)
        return True

    assert all(at_once([well, ill] * 4))


class Ticker:
    """Counts whenever it may run. While it waits to run, it never takes the interpreter lock by force."""

    def __init__(self):
        self.ticks = 0
        self.stop = threading.Event()
        self.thread = threading.Thread(target=self.run)

    def run(self):
        while not self.stop.is_set():
            self.ticks += 1
            time.sleep(0)

    def __enter__(self):
        self.interval = sys.getswitchinterval()
        sys.setswitchinterval(1000)
        self.thread.start()
        while self.ticks == 0:
            time.sleep(0)
        return self

    def __exit__(self, *exc):
        self.stop.set()
        self.thread.join()
        sys.setswitchinterval(self.interval)

    def during(self, function):
        """How often it ran while `function` did."""
        before = self.ticks
        function()
        return self.ticks - before


@pytest.mark.thread_unsafe(reason="sets the switch interval of the interpreter")
@pytest.mark.skipif(not getattr(sys, "_is_gil_enabled", lambda: True)(), reason="there is no lock to release")
@pytest.mark.parametrize(
    ("shape", "threads"), [((200, 400, 6), 1), ((200, 400, 6), 2), ((80_000, 6), None)], ids=str
)
def test_the_interpreter_lock_is_released_during_long_work(shape, threads):
    wrench = np.random.default_rng(36).standard_normal(shape)
    out = np.empty_like(extract_features(wrench))
    with Ticker() as ticker:
        # What holds the lock keeps the ticker from running: else a tick would prove nothing.
        assert ticker.during(lambda: [n * n for n in range(200_000)]) == 0
        # A busy machine may not run the ticker while the lock is free: then once more.
        tries = (
            ticker.during(lambda: extract_features(wrench, threads=threads, out=out)) for _ in range(500)
        )
        assert any(tries)


@pytest.mark.thread_unsafe(reason="sets the switch interval of the interpreter")
@pytest.mark.skipif(not getattr(sys, "_is_gil_enabled", lambda: True)(), reason="there is no lock to release")
@pytest.mark.parametrize("bad", [False, True])
def test_other_threads_can_use_the_interpreter_and_the_results_are_right(bad):
    wrench = np.random.default_rng(37).standard_normal((100, 400, 6))
    if bad:
        wrench[99, 399, 5] = np.inf
    with Ticker():
        for _ in range(5):
            if bad:
                with pytest.raises(ValueError, match="recording 99, sample 399, axis 5"):
                    extract_features(wrench, threads=2)
            else:
                assert twin.differing_bits(extract_features(wrench, threads=2), twin.features(wrench)) == 0
