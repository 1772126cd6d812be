"""Work in threads: results in order, the first error in order, nothing left behind."""

import threading
import time

import pytest
from sklearn import config_context, get_config
from threadpoolctl import threadpool_info, threadpool_limits

from granular_id._parallel import in_threads, single_threaded_blas


@pytest.mark.parametrize("n_jobs", [None, 1, 2, 5])
def test_results_come_in_the_order_of_the_items(n_jobs):
    second = threading.Event()

    def first_ends_last(number):
        if number == 0 and n_jobs not in (None, 1):
            assert second.wait(10)
        if number == 1:
            second.set()
        return number**2

    assert in_threads(first_ends_last, iter(range(10)), n_jobs) == [number**2 for number in range(10)]
    assert in_threads(first_ends_last, [], n_jobs) == []


@pytest.mark.parametrize("stop", [ValueError, KeyboardInterrupt])
def test_first_error_in_order_is_raised_and_ends_the_work(stop):
    begun, after = [], threading.Event()

    def failing(number):
        begun.append(number)
        if number == 1:
            after.set()
            raise stop("fast")
        if number == 0:
            after.wait(10)
            raise stop("slow")
        return number

    with pytest.raises(stop, match="slow"):
        in_threads(failing, range(1000), 2)
    assert set(begun) <= {0, 1}
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("ThreadPool")]


def test_ctrl_c_in_the_caller_waits_for_what_was_begun(monkeypatch):
    begun, ended, interrupted = [], [], threading.Event()

    def item(number):
        begun.append(number)
        interrupted.wait(10)
        time.sleep(0.02)  # what follows the interruption takes its time
        ended.append(number)

    def interrupt(_):
        interrupted.set()
        raise KeyboardInterrupt

    monkeypatch.setattr("granular_id._parallel.wait", interrupt)
    with pytest.raises(KeyboardInterrupt):
        in_threads(item, range(1000), 2)
    assert sorted(begun) == sorted(ended), "nothing goes on behind the caller's back"
    assert 1 <= len(begun) < 20
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("ThreadPool")]


def test_the_configuration_of_scikit_learn_is_that_of_the_caller():
    with config_context(assume_finite=True):
        assert in_threads(lambda _: get_config()["assume_finite"], range(4), 2) == [True] * 4


@pytest.mark.thread_unsafe(reason="sets the threads of BLAS")
def test_blas_is_limited_in_any_thread_whoever_limited_it_before():
    def threads():
        return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}

    seen = []

    def another_thread():
        with single_threaded_blas():
            seen.append(threads())
        seen.append(threads())

    with threadpool_limits(2, user_api="blas"):
        before = threads()
        with single_threaded_blas():
            pass
        thread = threading.Thread(target=another_thread)
        thread.start()
        thread.join()
        assert seen == [{1}, before]
