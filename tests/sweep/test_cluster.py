import json
import sys
from pathlib import Path

import pytest

from tdcr_planner import cluster
from tdcr_planner.cluster import dask_backend
from tdcr_planner.errors import InputError
from tdcr_planner.sweep.runner import run_sweep
from tdcr_planner.sweep.suite import load_suite
from tdcr_planner.sweep.table import result_rows
from tdcr_planner.workers import local_backend


@pytest.fixture
def dask_cluster(start_cluster, fake_jobs):
    """A scheduler whose workers can import the job functions."""
    return start_cluster(Path(fake_jobs.__file__).parent)


def test_two_workers_one_killed_midway(dask_cluster, write_suite, fake_jobs, tmp_path):
    suite = load_suite(write_suite(seeds=str(list(range(1, 13)))))
    dask_cluster.add_worker()
    dask_cluster.add_worker()
    told = []

    def progress(done, total, remark):
        told.append(done)
        if done == 8:
            dask_cluster.workers[0].kill()

    outcome = run_sweep(
        suite, tmp_path / "out", dask_backend(dask_cluster.address), function=fake_jobs.log_run, progress=progress
    )
    assert outcome.complete
    assert not outcome.failed
    assert dask_cluster.workers[0].wait() == -9
    assert told == list(range(25))
    lines = (tmp_path / "out" / "jobs.jsonl").read_text(encoding="utf-8").splitlines()
    assert len(lines) == 1 + 24
    runs = [int(line) for line in (tmp_path / "runs.txt").read_text(encoding="utf-8").split()]
    assert set(runs) == set(range(24))
    # What had not come back from the killed worker is run again; what was recorded before is not.
    recorded_before = [json.loads(line)["job"] for line in lines[1:9]]
    assert all(runs.count(index) == 1 for index in recorded_before)
    local = run_sweep(suite, tmp_path / "local", local_backend(1), function=fake_jobs.succeed)
    assert result_rows(outcome) == result_rows(local)


def test_a_scheduler_that_goes_away_keeps_what_had_finished(dask_cluster, suite, fake_jobs, tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "GONE_S", 1.0)
    dask_cluster.add_worker()

    def progress(done, total, remark):
        if done == 2:
            dask_cluster.scheduler.kill()

    outcome = run_sweep(
        suite, tmp_path / "out", dask_backend(dask_cluster.address), function=fake_jobs.log_run, progress=progress
    )
    assert not outcome.complete
    assert len(outcome.records) >= 2
    assert outcome.interrupted == f"the scheduler at {dask_cluster.address} is gone"
    resumed = run_sweep(suite, tmp_path / "out", local_backend(1), function=fake_jobs.succeed)
    assert resumed.complete
    assert resumed.resumed == len(outcome.records)


def test_a_failing_job_ends_none_of_the_others(dask_cluster, suite, fake_jobs, tmp_path):
    dask_cluster.add_worker()
    jobs = [job for job in suite.jobs if job.seed != 3]
    found = {outcome.index: outcome for outcome in dask_backend(dask_cluster.address)(fake_jobs.misbehave, jobs)}
    assert [found[index].error for index in range(4)] == [
        "",
        "ValueError: no such luck",
        "",
        "ValueError: no such luck",
    ]


def test_a_scheduler_without_workers(dask_cluster, suite, fake_jobs, tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "NO_WORKER_S", 0.5)
    monkeypatch.setattr(cluster, "_LOOK_S", 0.2)
    outcome = run_sweep(suite, tmp_path / "out", dask_backend(dask_cluster.address), function=fake_jobs.succeed)
    assert "has had no worker" in outcome.interrupted
    assert outcome.records == {}


@pytest.mark.parametrize(
    ("address", "advice"),
    [("tls://127.0.0.1:9", "distributed.comm.tls"), ("ucx://127.0.0.1:9", "distributed.comm.ucx"), ("x://h:1", "tcp")],
)
def test_a_transport_that_is_not_set_up_is_one_line(suite, tmp_path, monkeypatch, address, advice):
    monkeypatch.setattr(cluster, "CONNECT_S", 0.5)
    outcome = run_sweep(suite, tmp_path / "out", dask_backend(address))
    assert outcome.interrupted.startswith(f"no scheduler answers at {address}: ")
    assert advice in outcome.interrupted
    assert "\n" not in outcome.interrupted


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "no address at all"])
def test_no_scheduler_answers(suite, tmp_path, monkeypatch, address):
    monkeypatch.setattr(cluster, "CONNECT_S", 0.5)
    outcome = run_sweep(suite, tmp_path / "out", dask_backend(address))
    assert f"no scheduler answers at {address}" in outcome.interrupted
    assert not outcome.complete


def test_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match="pip install"):
        dask_backend("tcp://127.0.0.1:8786")
