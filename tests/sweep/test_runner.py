import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from tdcr_planner.sweep.journal import JOURNAL_NAME
from tdcr_planner.sweep.runner import run_sweep
from tdcr_planner.sweep.table import result_rows
from tdcr_planner.workers import Outcome, WorkersError, local_backend


def test_runs_every_job_once_whichever_the_workers(suite, fake_jobs, tmp_path):
    tables = []
    for workers in (1, 2):
        outcome = run_sweep(suite, tmp_path / f"out{workers}", local_backend(workers), function=fake_jobs.log_run)
        assert outcome.complete
        assert not outcome.interrupted
        tables.append(result_rows(outcome))
    assert tables[0] == tables[1]
    assert [row["job"] for row in tables[0]] == [0, 1, 2, 3, 4, 5]
    runs = (tmp_path / "runs.txt").read_text(encoding="utf-8").split()
    assert sorted(runs) == sorted("001122334455")


def test_a_finished_sweep_is_not_run_again(suite, fake_jobs, tmp_path):
    run_sweep(suite, tmp_path / "out", local_backend(1), function=fake_jobs.log_run)
    again = run_sweep(suite, tmp_path / "out", local_backend(1), function=fake_jobs.log_run)
    assert again.complete
    assert again.resumed == 6
    assert len((tmp_path / "runs.txt").read_text(encoding="utf-8").split()) == 6


def test_failing_and_crashing_jobs_are_recorded_and_end_nothing(suite, fake_jobs, tmp_path):
    outcome = run_sweep(suite, tmp_path / "out", local_backend(1), function=fake_jobs.misbehave)
    assert outcome.complete
    assert [job.index for job in outcome.failed] == [1, 2, 4, 5]
    assert outcome.records[1]["timing"]["message"] == "ValueError: no such luck"
    assert "SIGSEGV" in outcome.records[2]["timing"]["message"]
    kept = run_sweep(suite, tmp_path / "out", local_backend(1), function=fake_jobs.succeed)
    assert len(kept.failed) == 4
    retried = run_sweep(suite, tmp_path / "out", local_backend(1), function=fake_jobs.succeed, retry_failed=True)
    assert retried.resumed == 2
    assert retried.complete
    assert not retried.failed
    assert not run_sweep(suite, tmp_path / "out", local_backend(1)).failed


def test_progress_counts_up_to_the_total(suite, fake_jobs, tmp_path):
    told = []
    run_sweep(
        suite, tmp_path / "out", local_backend(1), function=fake_jobs.succeed, progress=lambda *call: told.append(call)
    )
    assert [call[:2] for call in told] == [(done, 6) for done in range(7)]
    assert told[-1][2] == "second.toml verified"


def test_ctrl_c_keeps_what_had_finished(suite, fake_jobs, tmp_path, as_in_a_terminal: None):
    outcome = run_sweep(suite, tmp_path / "out", local_backend(1), function=fake_jobs.wait_for_ctrl_c)
    assert outcome.interrupted == "interrupted"
    assert sorted(outcome.records) == [0, 1]
    assert not outcome.complete
    resumed = run_sweep(suite, tmp_path / "out", local_backend(1), function=fake_jobs.succeed)
    assert resumed.resumed == 2
    assert resumed.complete


def test_a_lost_backend_keeps_what_had_finished(suite, fake_jobs, tmp_path):
    def vanishing(function, jobs, **options):
        yield Outcome(0, function(jobs[0]))
        raise WorkersError("the scheduler is gone")

    outcome = run_sweep(suite, tmp_path / "out", vanishing, function=fake_jobs.succeed)
    assert outcome.interrupted == "the scheduler is gone"
    assert list(outcome.records) == [0]


SCRIPT = """
import sys
sys.path.insert(0, {helpers!r})
import tdcr_fake_jobs
from tdcr_planner.sweep.runner import run_sweep
from tdcr_planner.sweep.suite import load_suite
from tdcr_planner.workers import local_backend
if __name__ == "__main__":
    run_sweep(load_suite({suite!r}), {out!r}, local_backend(2), function=tdcr_fake_jobs.log_run)
"""


def test_goes_on_after_a_kill(suite, fake_jobs, tmp_path):
    script, out = tmp_path / "script.py", tmp_path / "out"
    helpers = str(Path(fake_jobs.__file__).parent)
    script.write_text(SCRIPT.format(helpers=helpers, suite=str(suite.path), out=str(out)))
    with subprocess.Popen([sys.executable, str(script)]) as process:
        deadline = time.monotonic() + 60.0
        while not _lines(out) > 2:
            assert time.monotonic() < deadline
            time.sleep(0.02)
        os.kill(process.pid, signal.SIGKILL)
    before = _lines(out) - 1
    outcome = run_sweep(suite, out, local_backend(1), function=fake_jobs.log_run)
    assert outcome.complete
    assert outcome.resumed == before
    entries = [json.loads(line)["job"] for line in (out / JOURNAL_NAME).read_bytes().splitlines()[1:]]
    assert sorted(entries) == list(range(6))


def _lines(out):
    path = out / JOURNAL_NAME
    return path.read_bytes().count(b"\n") if path.exists() else 0


def test_order_of_the_table_is_the_suites(suite, fake_jobs, tmp_path):
    def backwards(function, jobs, **options):
        for index in reversed(range(len(jobs))):
            yield Outcome(index, function(jobs[index]))

    outcome = run_sweep(suite, tmp_path / "out", backwards, function=fake_jobs.succeed)
    assert [(row["scenario"], row["seed"]) for row in result_rows(outcome)] == [
        (name, seed) for name in ("scenario.toml", "second.toml") for seed in (1, 2, 3)
    ]
