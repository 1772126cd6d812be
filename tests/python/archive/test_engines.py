"""Engines: every task is handed on, in the caller's thread; what stops them, and what they refuse."""

from __future__ import annotations

import sys
import threading
import time
from types import SimpleNamespace

import pytest

from granular_id.archive import engines
from granular_id.archive.engines import run_dask, run_local
from granular_id.archive.work import Outcome, Task

distributed = pytest.importorskip("distributed")


@pytest.fixture
def tasks(tmp_path):
    """Eight tasks of an archive and an output folder that are there; nothing is in them."""
    for name in ("archive", "out"):
        (tmp_path / name).mkdir()
    places = str(tmp_path / "archive"), str(tmp_path / "out")
    return [Task(*places, f"{i}.parquet", (("samples/a.parquet", i),), 4, None) for i in range(8)]


@pytest.fixture
def work(monkeypatch):
    """Replace what is done for a task by a function; the names of tasks that were begun are in `.begun`."""

    def replace(what=lambda task: None):
        begun = []

        def process(task):
            begun.append(task.name)
            what(task)
            return Outcome(task.name, task.n_recordings, "0" * 64)

        monkeypatch.setattr(engines, "process_partition", process)
        return begun

    return replace


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


@pytest.fixture(autouse=True)
def at_rest(request):
    """Wait after each test until no task of it runs any more: the next one replaces what is done for a task."""
    yield
    if "client" in request.fixturenames or request.node.name.endswith("[dask]"):
        connected = request.getfixturevalue("client")
        while any(connected.processing().values()):
            time.sleep(0.01)


@pytest.fixture(params=["local", "dask"])
def engine(request):
    """Each engine with two threads, as a function of tasks and `done`."""
    if request.param == "local":
        return lambda tasks, done: run_local(tasks, 2, done)
    client = request.getfixturevalue("client")
    return lambda tasks, done: run_dask(tasks, client, done)


# Both.


def test_every_outcome_is_handed_on_once(engine, tasks, work):
    begun, outcomes = work(), []
    engine(tasks, outcomes.append)
    assert sorted(outcome.name for outcome in outcomes) == sorted(begun) == [task.name for task in tasks]


def test_outcomes_come_in_the_thread_of_the_caller(engine, tasks, work):
    work()
    threads = set()
    engine(tasks, lambda _: threads.add(threading.current_thread()))
    assert threads == {threading.current_thread()}


def test_two_tasks_are_worked_on_at_a_time(engine, tasks, work):
    both = threading.Barrier(2, timeout=30)
    work(lambda _: both.wait())
    engine(tasks, lambda _: None)
    assert not both.broken


def test_blas_has_one_thread(tasks, work):
    from threadpoolctl import threadpool_info

    counts = []
    work(
        lambda _: counts.extend(
            pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"
        )
    )
    run_local(tasks[:1], 2, lambda _: None)
    assert set(counts) == {1}


def test_what_cannot_be_written_stops_all(engine, tasks, work):
    def full(task):
        raise OSError(28, "No space left on device", task.name)

    begun = work(full)
    with pytest.raises(OSError, match="No space left on device"):
        engine(tasks, lambda _: None)
    assert len(begun) < len(tasks)


def test_a_bug_is_raised_as_it_is(engine, tasks, work):
    def wrong(task):
        raise AssertionError("a bug")

    work(wrong)
    with pytest.raises(AssertionError, match="a bug"):
        engine(tasks, lambda _: None)


def test_an_interrupt_of_the_caller_begins_nothing_more(engine, tasks, work):
    def interrupt(_):
        raise KeyboardInterrupt

    begun = work()
    with pytest.raises(KeyboardInterrupt):
        engine(tasks * 50, interrupt)
    assert len(begun) < 50 * len(tasks)


def test_no_tasks_need_no_worker(engine, work):
    work()
    engine([], pytest.fail)


# Dask.


def killing(times):
    """Say of the second task as often that its workers died."""
    left = iter(range(times))

    def kill(task):
        if task.name == "1.parquet" and next(left, None) is not None:
            raise distributed.KilledWorker(task.name, SimpleNamespace(address="tcp://worker"), 3)

    return kill


def test_a_task_whose_workers_died_runs_again_alone(client, tasks, work):
    begun, outcomes = work(killing(1)), []
    run_dask(tasks, client, outcomes.append)
    assert not any(outcome.problem for outcome in outcomes)
    assert begun[-1] == "1.parquet"


def test_a_task_that_kills_its_workers_fails_alone(client, tasks, work):
    outcomes = []
    work(killing(9))
    run_dask(tasks, client, outcomes.append)
    assert {outcome.name: outcome.problem for outcome in outcomes if outcome.problem} == {
        "1.parquet": f"samples/a.parquet, row group 1: {engines._DIED}"
    }
    assert len(outcomes) == len(tasks)


def test_a_cluster_that_goes_is_told(tasks, work):
    cluster = distributed.LocalCluster(processes=False, n_workers=1, dashboard_address="127.0.0.1:0")
    with cluster, distributed.Client(cluster, set_as_default=False, timeout=0.1) as going:
        work()
        with pytest.raises(
            ConnectionError, match=r"^scheduler inproc://.* has gone, or its work was cancelled"
        ):
            run_dask(tasks * 50, going, lambda _: cluster.close())


def test_workers_that_do_not_see_the_archive_are_refused(client, tasks, work, tmp_path):
    begun = work()
    (tmp_path / "archive").rmdir()
    with pytest.raises(OSError, match=r"does not see the archive .*: mount it there under the same path"):
        run_dask(tasks, client, pytest.fail)
    assert not begun


def test_workers_of_another_version_are_refused(tasks):
    versions = {**engines._versions(), "granular_id": "0.0.0"}
    said = engines._unfit(tasks[0].archive, tasks[0].out, tasks[0].out, versions)
    assert said.endswith("wanted 0.0.0 as the caller has: install the same version there")


def test_workers_that_do_not_see_the_output_are_refused(tasks, tmp_path):
    said = engines._unfit(tasks[0].archive, str(tmp_path / "out" / "gone"), tasks[0].out, engines._versions())
    assert said == f"does not see the output folder {tasks[0].out}: mount it there under the same path"


def test_a_worker_that_saw_no_folder_looks_again(tasks, tmp_path):
    versions = tuple(engines._versions().items())
    late = str(tmp_path / "mounted later")
    with pytest.raises(OSError, match="does not see the output folder"):
        engines._check_fit(tasks[0].archive, late, versions)
    (tmp_path / "mounted later").mkdir()
    engines._check_fit(tasks[0].archive, late, versions)


def test_nothing_is_left_in_the_output(client, tasks, work, tmp_path):
    work()
    run_dask(tasks, client, lambda _: None)
    assert not list((tmp_path / "out").iterdir())


@pytest.mark.parametrize(
    ("scheduler", "message"),
    [(3, "must be a string"), ("nonsense", "missing port number in address 'nonsense'")],
)
def test_dask_scheduler_that_is_no_address_is_refused(tasks, scheduler, message):
    with pytest.raises((TypeError, ValueError), match=message):
        run_dask(tasks, scheduler, pytest.fail)


def test_a_missing_library_says_what_to_install(tasks, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ImportError, match=r"distributed is needed to work on a Dask cluster: .*dask"):
        run_dask(tasks, "tcp://host:8786", pytest.fail)
