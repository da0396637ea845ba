import itertools

import pytest

from tdcr_planner.errors import FormatError
from tdcr_planner.planning.offered import OMPL_TRAITS as PLANNERS
from tdcr_planner.sweep.suite import load_suite


def test_jobs_are_the_product_in_the_suites_order(write_suite):
    suite = load_suite(write_suite(planners='["RRTConnect", "RRT"]'))
    expected = list(
        itertools.product(("scenario.toml", "second.toml"), ("RRTConnect", "RRT"), ("constant_curvature",), (1, 2, 3))
    )
    assert [(job.scenario, job.planner, job.model, job.seed) for job in suite.jobs] == expected
    assert [job.index for job in suite.jobs] == list(range(12))
    assert suite.difficulties == ("easy", "hard")


def test_time_limit_replaces_the_scenarios_own(write_suite):
    assert {job.time_limit_s for job in load_suite(write_suite()).jobs} == {10.0}
    assert {job.time_limit_s for job in load_suite(write_suite(time_limit_s="2.5")).jobs} == {2.5}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"planners": '["RRTconnect"]'}, ["planners[1]", "RRTConnect", "RRTconnect"]),
        ({"planners": '["RRTConnect", "PRM"]'}, ["planners[2]", "PRM", "thread"]),
        ({"models": '["learnt"]'}, ["models", "learned", "learnt"]),
        ({"models": '["learned"]'}, ["scenarios[1].file", "shape_model"]),
        (
            {"scenarios": '[{file = "nowhere.toml", difficulty = "easy"}]'},
            ["scenarios[1].file", "no such file", "nowhere"],
        ),
        ({"scenarios": "[]"}, ["scenarios", "nothing to do"]),
        ({"planners": "[]"}, ["planners", "nothing to do"]),
        ({"models": "[]"}, ["models", "nothing to do"]),
        ({"seeds": "[]"}, ["seeds", "nothing to do"]),
        ({"seeds": "[1, 1]"}, ["seeds", "each once", "1"]),
        ({"seeds": "[0]"}, ["seeds", "0"]),
        ({"scenarios": None}, ["scenarios", "missing"]),
        ({"format": '"tdcr-suite/0"'}, ["format", "tdcr-suite/1", "tdcr-suite/0"]),
        ({"timelimit_s": "3"}, ["timelimit_s", "time_limit_s"]),
        ({"time_limit_s": "0"}, ["time_limit_s"]),
    ],
)
def test_refuses_what_it_cannot_run(write_suite, changes, words):
    with pytest.raises(FormatError) as caught:
        load_suite(write_suite(**changes))
    for word in words:
        assert word in str(caught.value)


def test_hash_follows_what_decides_the_results(write_suite, tmp_path):
    original = load_suite(write_suite()).sha256
    assert load_suite(write_suite(title='"another title"')).sha256 == original
    assert load_suite(write_suite(seeds="[1, 2]")).sha256 != original
    path = write_suite()
    with (tmp_path / "scenario.toml").open("a") as stream:
        stream.write("# a change\n")
    assert load_suite(path).sha256 != original
    path = write_suite()
    with (tmp_path / "box.stl").open("ab") as stream:
        stream.write(b"\n")
    assert load_suite(path).sha256 != original


def test_hash_follows_the_robots_body(write_suite, tmp_path, root):
    path, robot = write_suite(), tmp_path / "robot.toml"
    robot.write_text((root / "models/robots/paper.toml").read_text(encoding="utf-8"))
    for name in ("scenario.toml", "second.toml"):
        scenario = tmp_path / name
        scenario.write_text(
            scenario.read_text(encoding="utf-8").replace(str(root / "models/robots/paper.toml"), "robot.toml")
        )
    original = load_suite(path).sha256
    wider = robot.read_text(encoding="utf-8").replace("disk_radius_m = 0.010", "disk_radius_m = 0.011")
    assert wider != robot.read_text(encoding="utf-8")
    robot.write_text(wider)
    assert load_suite(path).sha256 != original


def test_the_planners_suite_names_all_on_offer_that_end(root):
    suite = load_suite(root / "scenes/planners.toml")
    assert set(suite.file.planners) == set(PLANNERS) - {"AORRTC"}
    levels = {entry.file: entry.difficulty for entry in load_suite(root / "scenes/benchmark.toml").file.scenarios}
    assert {entry.file: entry.difficulty for entry in suite.file.scenarios}.items() <= levels.items()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"seeds": str([*range(1, 120_002)])}, ["100000", "a day at a second each"]),
        ({"time_limit_s": "1e9"}, ["time_limit_s", "604800", "a week"]),
        ({"time_limit_s": "true"}, ["time_limit_s", "valid number", "True"]),
        ({"seeds": "[3000000000]"}, ["seeds", "31 bits"]),
        ({"planners": '["tdcr_no_module:search"]'}, ["planners[1]", "can be imported", "tdcr_no_module"]),
        ({"planners": '["os:no_such_function"]'}, ["planners[1]", "no_such_function"]),
        ({"planners": '["os.path:../x"]'}, ["planners[1]", "module:function"]),
        ({"planners": '["os; print(1):system"]'}, ["planners[1]", "module:function"]),
    ],
)
def test_refuses_absurd_numbers_and_names(write_suite, changes, words):
    with pytest.raises(FormatError) as caught:
        load_suite(write_suite(**changes))
    for word in words:
        assert word in str(caught.value)
    assert len(str(caught.value)) < 1000


@pytest.mark.parametrize("ending", ["raise SystemExit(3)", "raise ZeroDivisionError", "this is no Python"])
def test_a_module_of_planners_that_fails_is_named(write_suite, tmp_path, monkeypatch, ending):
    monkeypatch.syspath_prepend(tmp_path)
    name = f"tdcr_failing_{len(ending)}"
    (tmp_path / f"{name}.py").write_text(ending)
    with pytest.raises(FormatError, match=rf"planners\[1\].*{name}"):
        load_suite(write_suite(planners=f'["{name}:search"]'))


def test_a_suite_can_be_read_without_importing_its_planners(write_suite, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "tdcr_writing.py").write_text(
        f"open({str(tmp_path / 'written')!r}, 'w').close()\ndef search(*args, **named): ...\n"
    )
    path = write_suite(planners='["tdcr_writing:search"]')
    assert load_suite(path, import_planners=False).jobs[0].planner == "tdcr_writing:search"
    assert not (tmp_path / "written").exists()
    load_suite(path)
    assert (tmp_path / "written").exists()
