"""Threads and Dask clusters: each partition is worked on, in the way of the caller; what stops all."""

from __future__ import annotations

import threading
import time

import pytest

from granular_id.archive import workers
from granular_id.archive.workers import work_through

distributed = pytest.importorskip("distributed")

EIGHT = {f"{i}.parquet": i for i in range(8)}
MANY = {f"{i}.parquet": i for i in range(400)}


@pytest.fixture(scope="module")
def client():
    """A cluster of threads in this process: no process is started."""
    with distributed.Client(
        processes=False,
        n_workers=1,
        threads_per_worker=2,
        dashboard_address="127.0.0.1:0",
        set_as_default=False,
    ) as connected:
        yield connected


MADE_BY = []


def make_by_last(partition):
    """What tests put into `MADE_BY`: a function within a test would travel to workers as a copy."""
    return MADE_BY[-1](partition)


def on_cluster(make, done, scheduler, some=EIGHT):
    MADE_BY.append(make)
    work_through(make_by_last, some, done, n_jobs=None, scheduler=scheduler)


@pytest.fixture(params=["threads", "cluster"])
def work(request):
    """Each with two threads, as a function of what makes a file and what is reported of it."""
    if request.param == "threads":
        return lambda make, done, some=EIGHT: work_through(make, some, done, n_jobs=2, scheduler=None)
    client = request.getfixturevalue("client")
    return lambda make, done, some=EIGHT: on_cluster(make, done, client, some)


def test_workers_report_all_made_two_at_a_time(work):
    both, reports = threading.Barrier(2, timeout=30), []

    def make(number):
        both.wait()
        return str(number)

    work(make, lambda *report: reports.append(report))
    assert sorted(reports) == [(name, str(number)) for name, number in EIGHT.items()]


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), AssertionError("a bug")], ids=type)
def test_workers_that_raise_stop_all(work, error):
    def make(*_):
        raise error

    reports = []
    with pytest.raises(type(error), match=str(error.args[-1])):
        work(make, lambda *report: reports.append(report))
    assert reports == []


def test_workers_after_an_interrupt_begin_nothing_more(work):
    begun = []

    def interrupt(*_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        work(lambda number, *_: (begun.append(number), time.sleep(0.01), "")[-1], interrupt, MANY)
    assert len(begun) < len(MANY)


# Clusters.


def test_cluster_that_goes_is_a_connection_error():
    cluster = distributed.LocalCluster(processes=False, n_workers=1, dashboard_address="127.0.0.1:0")
    gone = "^the scheduler has gone, or its work was cancelled"
    with (
        cluster,
        distributed.Client(cluster, set_as_default=False, timeout=0.1) as going,
        pytest.raises(ConnectionError, match=gone),
    ):
        on_cluster(lambda *_: "", lambda *_: cluster.close(), going, MANY)


def test_cluster_of_other_versions_is_refused(client, monkeypatch):
    assert set(client.run(workers._versions).values()) == {workers._versions()}
    monkeypatch.setattr(client, "run", lambda _: {"tcp://a": "granular_id 0.0.1 and pyarrow 1"})
    with pytest.raises(OSError, match=r"tcp://a has granular_id 0.0.1 and pyarrow 1, wanted granular_id "):
        on_cluster(str, pytest.fail, client)


@pytest.mark.parametrize(
    ("scheduler", "error", "message"),
    [
        (3, TypeError, "must be a string"),
        ("tcp://127.0.0.1:9", ConnectionError, "no Dask scheduler answers there"),
    ],
)
def test_scheduler_that_is_none_is_refused(scheduler, error, message):
    import dask

    with dask.config.set({"distributed.comm.timeouts.connect": "0.2s"}), pytest.raises(error, match=message):
        on_cluster(str, pytest.fail, scheduler)
