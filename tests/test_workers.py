import os
import subprocess
import sys
import time

import pytest

from tdcr_planner.errors import InputError
from tdcr_planner.workers import run_jobs

# The jobs are expressions and the function is eval: worker processes cannot import test modules.
PID = "__import__('os').getpid()"
SEGFAULT = f"__import__('os').kill({PID}, 11)"


def outcomes(jobs, **options):
    return {outcome.index: outcome for outcome in run_jobs(eval, jobs, **options)}


def test_returns_every_value():
    found = outcomes([f"{number} ** 2" for number in range(7)], workers=2)
    assert {index: outcome.value for index, outcome in found.items()} == {number: number**2 for number in range(7)}
    assert not any(outcome.error for outcome in found.values())


def test_nothing_to_do():
    assert outcomes([]) == {}


def test_one_that_raises_or_crashes_ends_none_of_the_others():
    found = outcomes(["1 / 0", "2", SEGFAULT, "4", "__import__('os')._exit(3)", "lambda: 0", "exit(5)", "8"], workers=1)
    assert len(found) == 8
    assert {index: outcome.value for index, outcome in found.items() if not outcome.error} == {1: 2, 3: 4, 7: 8}
    assert found[0].error == "ZeroDivisionError: division by zero"
    assert found[2].error == "the process was ended by signal 11 (SIGSEGV)"
    assert found[4].error == "the process ended with exit code 3"
    assert "cannot be sent" in found[5].error
    assert found[6].error == "SystemExit: 5"


def test_one_that_hangs_is_ended():
    found = outcomes(["__import__('time').sleep(600)", "1"], workers=1, time_limit_s=2.0)
    assert found[0].error == "no answer within 2 s; its process was ended"
    assert found[1].value == 1


def test_a_job_whose_worker_died_is_given_to_another(tmp_path):
    flag = tmp_path / "died"
    once = f"open({str(flag)!r}, 'x') and {SEGFAULT} if not __import__('os').path.exists({str(flag)!r}) else 'alive'"
    found = outcomes([once, "2", SEGFAULT, "1 / 0"], workers=1, losses=2)
    assert [found[index].value for index in range(4)] == ["alive", 2, None, None]
    assert [found[index].lost for index in range(4)] == [False, False, True, False]
    assert found[2].error == "the process was ended by signal 11 (SIGSEGV)"
    assert found[3].error == "ZeroDivisionError: division by zero"


def test_workers_are_other_processes_with_one_thread():
    found = outcomes([f"({PID}, __import__('os').environ['OMP_NUM_THREADS'])"] * 2, workers=2)
    pids = {outcome.value[0] for outcome in found.values()}
    assert os.getpid() not in pids
    assert {outcome.value[1] for outcome in found.values()} == {"1"}


def test_workers_stay_with_their_group():
    slow = f"(__import__('time').sleep(0.05), {PID})[1]"
    found = outcomes([slow] * 12, groups=["a"] * 6 + ["b"] * 6, workers=2)
    first, second = ({found[index].value for index in part} for part in (range(4), range(6, 10)))
    assert len(first) == len(second) == 1
    assert first != second


def test_an_idle_worker_takes_from_a_group_that_is_left():
    slow = f"(__import__('time').sleep(0.4), {PID})[1]"
    found = outcomes([slow] * 8, groups=["a"] * 8, workers=2)
    assert len({outcome.value for outcome in found.values()}) == 2


def test_closing_ends_the_workers():
    running = run_jobs(eval, [PID, "__import__('time').sleep(600)"], workers=2)
    pid = next(running).value
    running.close()
    assert ends(pid)


PARENT = """
import sys
from tdcr_planner.workers import run_jobs
if __name__ == "__main__":
    jobs = ["__import__('os').getpid()", "__import__('time').sleep(600)", "__import__('time').sleep(600)"]
    running = run_jobs(eval, jobs, workers=2)
    print(next(running).value, flush=True)
    next(running)
"""


def test_workers_end_with_a_parent_that_is_killed(tmp_path):
    program = tmp_path / "parent.py"
    program.write_text(PARENT)
    with subprocess.Popen([sys.executable, program], stdout=subprocess.PIPE, text=True) as parent:
        pid = int(parent.stdout.readline())
        parent.kill()
    assert ends(pid)


def ends(pid):
    """Whether a process ends before long."""
    end = time.monotonic() + 20.0
    while is_running(pid) and time.monotonic() < end:
        time.sleep(0.05)
    return not is_running(pid)


def is_running(pid):
    """Whether a process works; one that has ended may stay in the table until somebody asks for its exit code."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    stat = f"/proc/{pid}/stat"
    if not os.path.exists(stat):
        return True
    with open(stat) as stream:
        return stream.read().rpartition(")")[2].split()[0] != "Z"


def test_refuses_no_workers():
    with pytest.raises(InputError, match="workers"):
        next(run_jobs(eval, ["1"], workers=0))
