"""What holds for all files: each module has its tests, functions are short and take few arguments."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "tdcr_planner"
MOST_LINES, MOST_PARAMETERS = 100, 10

# Modules without a test file of their own name, and the file whose tests cover them.
COVERED = {
    "adoption/faults.py": "adoption/test_discovery.py",
    "adoption/mistakes.py": "adoption/test_discovery.py",
    "adoption/write.py": "adoption/test_adopt.py",
    "calibration/bench.py": "calibration/test_bound.py",
    "calibration/checks.py": "calibration/test_data.py",
    "calibration/comparison.py": "calibration/test_calibrate.py",
    "calibration/fit.py": "calibration/test_calibrate.py",
    "calibration/forward.py": "calibration/test_unloaded.py",
    "calibration/kernels.py": "calibration/test_unloaded.py",
    "calibration/mapping.py": "calibration/test_calibrate.py",
    "calibration/parameters.py": "calibration/test_uncertainty.py",
    "calibration/reference.py": "calibration/test_calibrate.py",
    "calibration/selection.py": "calibration/test_calibrate.py",
    "calibration/simulate.py": "calibration/test_unloaded.py",
    "calibration/table.py": "calibration/test_data.py",
    "cli/backend.py": "cli/test_sweep.py",
    "cli/commands.py": "cli/test_main.py",
    "cli/design.py": "design/test_design.py",
    "cli/evaluate.py": "learning/test_evaluate.py",
    "cli/info.py": "cli/test_main.py",
    "cli/inspect.py": "inspection/test_inspect.py",
    "cli/pictures.py": "cli/test_plan.py",
    "cli/reach.py": "inspection/test_reach.py",
    "cli/solve.py": "cli/test_main.py",
    "cli/vectors.py": "cli/test_main.py",
    "cli/verify.py": "cli/test_main.py",
    "cli/view.py": "report/test_view.py",
    "cluster.py": "sweep/test_cluster.py",
    "collision/clouds/pcd.py": "collision/clouds/test_formats.py",
    "collision/containment.py": "collision/test_field.py",
    "collision/first_look.py": "collision/test_scene.py",
    "collision/first_ways.py": "collision/test_slack.py",
    "collision/mesh_files/gltf_buffers.py": "collision/mesh_files/test_gltf.py",
    "collision/mesh_files/gltf_schema.py": "collision/mesh_files/test_gltf.py",
    "collision/mesh_files/source.py": "collision/mesh_files/test_registry.py",
    "collision/mesh_files/threemf_model.py": "collision/mesh_files/test_threemf.py",
    "collision/narrow.py": "collision/test_scene.py",
    "collision/part_room.py": "collision/test_room.py",
    "collision/prover.py": "collision/test_slack.py",
    "collision/roles.py": "integration/test_plugins.py",
    "collision/self_contact.py": "collision/test_scene.py",
    "collision/self_slack.py": "collision/test_slack.py",
    "collision/settle.py": "collision/test_scene.py",
    "collision/tree.py": "collision/test_distance.py",
    "collision/volumes/dicom.py": "collision/volumes/test_formats.py",
    "collision/volumes/image.py": "collision/volumes/test_surface.py",
    "collision/volumes/itk.py": "collision/volumes/test_formats.py",
    "collision/volumes/nifti.py": "collision/volumes/test_formats.py",
    "design/search.py": "design/test_design.py",
    "design/study.py": "design/test_design.py",
    "design/trial.py": "design/test_design.py",
    "design/variants.py": "design/test_design.py",
    "inspection/answer.py": "inspection/test_inspect.py",
    "inspection/causes.py": "inspection/test_inspect.py",
    "inspection/coverage.py": "inspection/test_inspect.py",
    "inspection/graph.py": "inspection/test_inspect.py",
    "inspection/scene.py": "inspection/test_inspect.py",
    "inspection/search.py": "inspection/test_inspect.py",
    "inspection/sight_lines.py": "inspection/test_visibility.py",
    "inspection/survey.py": "inspection/test_inspect.py",
    "inspection/tighten.py": "inspection/test_inspect.py",
    "inspection/visibility_kernels.py": "inspection/test_visibility.py",
    "learning/limit_use.py": "learning/test_dataset.py",
    "learning/loads.py": "learning/test_settings.py",
    "learning/paper_physics.py": "learning/test_paper.py",
    "learning/paper_points.py": "learning/test_paper.py",
    "linked.py": "test_machine_code.py",
    "planning/causes.py": "planning/test_validity.py",
    "planning/goal_kinds.py": "planning/test_scenario.py",
    "planning/goal_room.py": "planning/test_goal.py",
    "planning/inspect_table.py": "inspection/test_targets.py",
    "planning/kernels.py": "planning/test_validity.py",
    "planning/offered.py": "planning/test_planners.py",
    "planning/passage.py": "planning/test_retraction.py",
    "planning/path.py": "query/test_session.py",
    "planning/planner.py": "planning/test_planners.py",
    "planning/relaxation.py": "planning/test_retraction.py",
    "planning/roadmap_build.py": "planning/test_roadmap.py",
    "planning/roadmap_way.py": "planning/test_roadmap.py",
    "planning/robot_limits.py": "planning/test_validity.py",
    "planning/shortfall.py": "planning/test_goal.py",
    "planning/tolerance_table.py": "query/test_risk.py",
    "query/answer.py": "query/test_session.py",
    "query/drawn_robot.py": "query/test_risk.py",
    "query/environment.py": "query/test_session.py",
    "query/solved_states.py": "query/test_verification.py",
    "query/tolerances.py": "query/test_risk.py",
    "query/verification_report.py": "query/test_verification.py",
    "report/adoption_plot.py": "cli/test_adopt.py",
    "report/calibration_plots.py": "report/test_calibration_results.py",
    "report/compare_plots.py": "report/test_compare_results.py",
    "report/coverage_files.py": "inspection/test_inspect.py",
    "report/coverage_html.py": "inspection/test_inspect.py",
    "report/coverage_map.py": "inspection/test_inspect.py",
    "report/coverage_picture.py": "inspection/test_inspect.py",
    "report/coverage_png.py": "inspection/test_inspect.py",
    "report/coverage_results.py": "inspection/test_inspect.py",
    "report/design_results.py": "design/test_design.py",
    "report/guide_marks.py": "report/test_scene_png.py",
    "report/legend.py": "report/test_scene_html.py",
    "report/model_plots.py": "learning/test_evaluate.py",
    "report/ompl_log.py": "report/test_sweep_results.py",
    "report/picture.py": "report/test_view.py",
    "report/plots.py": "report/test_results.py",
    "report/reach_results.py": "inspection/test_reach.py",
    "report/reference_poses.py": "report/test_results.py",
    "report/robustness_results.py": "cli/test_robustness.py",
    "report/scene_figure.py": "report/test_scene_html.py",
    "report/scene_image.py": "report/test_scene_png.py",
    "report/side_by_side.py": "compare/test_side_by_side.py",
    "report/state_files.py": "report/test_export.py",
    "report/sweep_plots.py": "report/test_sweep_results.py",
    "report/tables.py": "report/test_sweep_results.py",
    "report/time_traces.py": "report/test_scene_html.py",
    "report/tip_view.py": "inspection/test_inspect.py",
    "robot/body.py": "robot/test_spec.py",
    "robot/checks.py": "robot/test_spec.py",
    "robot/commands.py": "robot/test_spec.py",
    "robot/drive_checks.py": "robot/test_drive.py",
    "robot/faults.py": "robot/test_spec.py",
    "robot/fields.py": "robot/test_spec.py",
    "robot/hashing.py": "robot/test_versions.py",
    "robot/loading.py": "robot/test_spec.py",
    "robot/measured.py": "robot/test_spec.py",
    "robot/rod.py": "robot/test_spec.py",
    "robot/routing_checks.py": "robot/test_paths.py",
    "robot/tendon_list.py": "robot/test_tendons.py",
    "robot/variants.py": "robot/test_spec.py",
    "shape/base.py": "shape/test_constant_curvature.py",
    "shape/card.py": "shape/test_model_file.py",
    "shape/engines.py": "shape/test_learned.py",
    "shape/foreign_network.py": "adoption/test_discovery.py",
    "shape/paper_network.py": "learning/test_paper.py",
    "shape/registry.py": "integration/test_plugins.py",
    "shape/script_rules.py": "shape/test_script_source.py",
    "shape/shooting.py": "shape/test_learned.py",
    "shape/shooting_network.py": "shape/test_learned.py",
    "shape/torch_module.py": "shape/test_learned.py",
    "statics/batch.py": "statics/test_solver.py",
    "statics/branch.py": "statics/test_solver.py",
    "statics/chord.py": "statics/test_routing.py",
    "statics/cross_section.py": "statics/test_routing.py",
    "statics/cut_loads.py": "statics/test_solver.py",
    "statics/driven.py": "statics/test_drive.py",
    "statics/drive_settings.py": "statics/test_drive.py",
    "statics/friction.py": "statics/test_sequence.py",
    "statics/integration.py": "statics/test_solver.py",
    "statics/loads.py": "statics/test_solver.py",
    "statics/motion.py": "statics/test_routing.py",
    "statics/motion_history.py": "statics/test_sequence.py",
    "statics/options.py": "statics/test_drive.py",
    "statics/small_matrices.py": "statics/test_solver.py",
    "statics/solution.py": "statics/test_solver.py",
    "statics/tension.py": "statics/test_sequence.py",
    "statics/variations.py": "statics/test_sensitivity.py",
    "survey/sized_robot.py": "survey/test_proposal.py",
}
# Functions that are longer than most, each a loop that does not come apart without handing its state about.
LONG = {
    "collision/first_ways.py": {"look_at_ways"},
    "statics/cross_section.py": {"invert_hessian", "solve_strain"},
    "statics/friction.py": {"friction_newton"},
    "statics/integration.py": {"integrate"},
}
# Calls of the contract that take a load a keyword.
WIDE = {"statics/sequence.py": {"solve_sequence"}, "statics/solver.py": {"solve_statics"}}


def modules() -> list[str]:
    return [str(file.relative_to(PACKAGE)) for file in sorted(PACKAGE.rglob("*.py")) if file.name != "__init__.py"]


def mirror(module: str) -> Path:
    path = ROOT / "tests" / module
    return path.with_name(f"test_{path.name}")


@cache
def imported(file: Path) -> frozenset[Path]:
    """Returns the package's files that a file imports, anywhere in it."""
    names = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.startswith("tdcr_planner."):
            names.add(node.value.partition(":")[0])  # of a registry
    stems = [ROOT / name.replace(".", "/") for name in names if name.startswith("tdcr_planner.")]
    paths = [path for stem in stems for path in (stem.with_name(f"{stem.name}.py"), stem / "__init__.py")]
    return frozenset(path for path in paths if path.exists())


def reached(file: Path) -> set[Path]:
    """Returns the package's files that a test file and the conftest files above it import, directly or not."""
    open_files = [file, *(folder / "conftest.py" for folder in file.parents if (folder / "conftest.py").exists())]
    found: set[Path] = set()
    while open_files:
        for path in imported(open_files.pop()) - found:
            found.add(path)
            open_files.append(path)
    return found


def functions(module: str) -> Iterator[ast.FunctionDef]:
    for node in ast.walk(ast.parse((PACKAGE / module).read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef):
            yield node


def length(function: ast.FunctionDef) -> int:
    """Returns the lines of a function without its docstring."""
    first = function.body[1] if ast.get_docstring(function) and len(function.body) > 1 else function.body[0]
    return (function.end_lineno or function.lineno) - first.lineno + 1


def is_command(module: str, function: ast.FunctionDef) -> bool:
    """Whether a function's parameters are the options of a command."""
    return module == f"cli/{function.name}.py"


def is_compiled(function: ast.FunctionDef) -> bool:
    return any(ast.unparse(decorator).startswith("njit") for decorator in function.decorator_list)


def test_every_module_has_tests_of_its_name_or_is_named_as_covered() -> None:
    bare = [module for module in modules() if not mirror(module).exists() and module not in COVERED]
    assert not bare, f"write tests/.../test_<name>.py for these or name their tests in COVERED: {bare}"


@pytest.mark.parametrize(("module", "tests"), COVERED.items())
def test_the_table_of_covered_modules_is_true(module: str, tests: str) -> None:
    assert (PACKAGE / module).exists(), "there is no such module"
    assert not mirror(module).exists(), f"it has tests of its own: {mirror(module)}"
    assert PACKAGE / module in reached(ROOT / "tests" / tests), f"{tests} imports nothing that leads to it"


@pytest.mark.parametrize("module", modules())
def test_functions_are_short_and_take_few_arguments(module: str) -> None:
    for function in functions(module):
        lines = length(function)
        allowed = function.name in LONG.get(module, ())
        assert lines <= MOST_LINES or allowed, f"{function.name} has {lines} lines, allowed are {MOST_LINES}"
        arguments = [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]
        count = len([argument for argument in arguments if argument.arg not in ("self", "cls")])
        if is_command(module, function) or is_compiled(function) or function.name in WIDE.get(module, ()):
            continue
        assert count <= MOST_PARAMETERS, f"{function.name} takes {count} arguments"
