"""Size limits of files and functions, and the correspondence of unit tests and source files."""

import ast
from fnmatch import fnmatch
from pathlib import Path

import pytest

from tests.conftest import ROOT

MOST_LINES, MOST_BODY, MOST_KERNEL_BODY, MOST_ARGUMENTS = 400, 50, 80, 8
MOST_SCALARS = 13
"""The most arguments of inlined scalar arithmetic in kernels, which takes numbers one by one."""
MIN_TESTED_LINES = 25
"""Lines of function bodies above which a file needs a unit test."""
SOURCE_FOLDER, TEST_FOLDER = ROOT / "src" / "posefuse", ROOT / "tests" / "unit"
SOURCES = sorted(SOURCE_FOLDER.rglob("*.py"))

WITHOUT_SOURCE = {
    "test_structure.py": "checks all source files",
    "test_public_names.py": "checks the names of the package",
    "benchmarks/test_imports.py": "imports all benchmarks",
    "kernels/test_*.py": "one file per kernel and its naive twin, whatever the folder of the kernel",
}
"""Tests without a source file of their name, with the reason."""

TESTED_ELSEWHERE = {
    "integration/test_batch_command.py": ("batch/overview.py", "batch/recipes.py", "batch/work.py"),
    "integration/test_batch_on_object_stores.py": ("batch/staging.py",),
    "integration/test_board_videos_of_recordings.py": ("pipeline/calibrate_recording.py",),
    "integration/test_calibrate_by_people.py": (
        "calibration/scene/origin.py",
        "pipeline/calibrate_people.py",
        "pipeline/place_calibration.py",
        "pipeline/recalibrate.py",
    ),
    "integration/test_calibrate_combined.py": ("pipeline/calibrate.py", "pipeline/calibrate_combined.py"),
    "integration/test_calibrate_command.py": (
        "io/board_images.py",
        "pipeline/calibrate_board.py",
        "calibration/people/summary.py",
        "pipeline/calibrate_scene.py",
        "pipeline/detect_board.py",
        "pipeline/wrong_board.py",
        "detection/boards/layout.py",
        "visualize/board_sheet.py",
    ),
    "integration/test_command_line.py": ("cli/*.py",),
    "integration/test_doctor.py": ("diagnostics/installation.py",),
    "integration/test_python_objects.py": ("pipeline/notebook.py",),
    "integration/test_compare_results.py": (
        "evaluation/result_differences.py",
        "pipeline/compare_angles.py",
        "report/angle_agreement.py",
    ),
    "integration/test_existing_outputs.py": ("io/outputs.py",),
    "integration/test_opensim_command.py": (
        "io/opensim/tools.py",
        "io/opensim/worker.py",
        "pipeline/opensim.py",
        "pipeline/opensim_person.py",
    ),
    "integration/test_refine_command.py": ("pipeline/refine_recording.py",),
    "integration/test_solved_commands.py": ("biomechanics/tables.py",),
    "integration/test_stream_command.py": (
        "live/measured_points.py",
        "live/run.py",
    ),
    "properties/test_result_files.py": (
        "io/results/*.py",
        "model/stored_points.py",
    ),
    "robustness/test_decompression_limits.py": (
        "io/files.py",
        "io/hdf5.py",
        "io/parquet_files.py",
    ),
    "unit/biomechanics/test_inverse_kinematics.py": ("biomechanics/marker_model.py",),
    "unit/biomechanics/test_subject_fit.py": ("biomechanics/coordinate_priors.py",),
    "unit/io/results/test_mot.py": ("io/results/netcdf_angles.py",),
    "unit/pipeline/test_joint_angles.py": (
        "biomechanics/angle_definitions.py",
        "biomechanics/person_frames.py",
        "pipeline/static_trial.py",
    ),
    "unit/alignment/test_apply.py": ("model/alignment.py",),
    "unit/association/test_groups.py": ("association/group_points.py",),
    "unit/association/test_proposals.py": ("model/proposals.py",),
    "unit/biomechanics/test_gait.py": (
        "biomechanics/contact.py",
        "biomechanics/floor_levels.py",
        "biomechanics/foot_paths.py",
        "biomechanics/gait_events.py",
    ),
    "unit/calibration/scene/test_calibration.py": ("calibration/scene/first_pose.py",),
    "unit/calibration/test_refine.py": (
        "calibration/checks.py",
        "calibration/uncertainty.py",
        "pipeline/refine_calibration.py",
    ),
    "unit/calibration/people/test_known_estimate.py": ("calibration/people/known_cameras.py",),
    "unit/calibration/people/test_match.py": (
        "calibration/people/assemble.py",
        "calibration/people/bodies.py",
        "calibration/people/sample_sides.py",
        "calibration/people/sides.py",
    ),
    "unit/detection/test_process.py": (
        "detection/shared_images.py",
        "detection/workers/serve.py",
    ),
    "unit/detection/workers/test_onnx_model.py": ("detection/workers/onnx_sessions.py",),
    "unit/diagnostics/test_registry.py": (
        "diagnostics/camera_poses.py",
        "diagnostics/camera_resection.py",
        "diagnostics/clocks.py",
        "diagnostics/confidence.py",
        "diagnostics/examine.py",
        "diagnostics/fine_search.py",
        "diagnostics/hypotheses.py",
        "diagnostics/image_orientation.py",
        "diagnostics/joint_recording.py",
        "diagnostics/left_right_swaps.py",
        "diagnostics/lenses.py",
        "diagnostics/sample_points.py",
        "diagnostics/verdict.py",
        "diagnostics/view_overlap.py",
    ),
    "unit/diagnostics/test_start_offsets.py": (
        "diagnostics/time_offsets.py",
        "pipeline/diagnose.py",
    ),
    "unit/evaluation/test_comparison.py": ("pipeline/compare_methods.py",),
    "unit/evaluation/test_people.py": ("evaluation/paired_results.py",),
    "unit/io/calibration/test_registry.py": ("io/calibration/*.py",),
    "unit/io/keypoints/test_registry.py": (
        "io/keypoints/*.py",
        "io/pandas_tables.py",
    ),
    "properties/test_keypoint_round_trips.py": ("io/keypoints/openpose_writing.py",),
    "unit/io/results/test_bvh.py": (
        "biomechanics/animation_figures.py",
        "io/results/clips.py",
    ),
    "unit/io/results/test_gltf.py": ("io/results/sticks.py",),
    "unit/io/results/test_write.py": ("model/track_events.py",),
    "unit/pipeline/run/test_plan.py": ("pipeline/run/view_facts.py",),
    "unit/io/test_options.py": ("io/options_template.py",),
    "unit/io/test_recording.py": ("io/folder_locks.py",),
    "unit/io/test_timestamps.py": ("io/open_recording.py",),
    "unit/kernels/test_points.py": ("kernels/*.py",),
    "unit/left_right/pairs/test_registry.py": (
        "left_right/pairs/enumerated.py",
        "left_right/pairs/population_search.py",
    ),
    "unit/left_right/test_relabel.py": (
        "left_right/pairs/label_likelihood.py",
        "left_right/costs.py",
        "left_right/estimates.py",
        "left_right/model_selection.py",
        "left_right/results.py",
    ),
    "unit/live/test_sources.py": ("live/brokers.py",),
    "unit/model/options/test_bounds.py": ("model/options/tracker.py",),
    "unit/model/test_reconstruction.py": ("model/concatenate.py",),
    "unit/noise/test_estimate.py": (
        "noise/error_model.py",
        "noise/scales.py",
    ),
    "unit/pipeline/test_detect.py": (
        "pipeline/detection/assemble.py",
        "pipeline/detection/output.py",
    ),
    "unit/pipeline/test_distributed.py": (
        "pipeline/people/model_layer.py",
        "pipeline/people/recorder.py",
        "pipeline/people/track_recording.py",
    ),
    "unit/pipeline/test_reconstruct_recording.py": ("pipeline/plan.py",),
    "unit/pipeline/test_solved_layer.py": ("postprocess/steps.py",),
    "unit/report/plots/test_registry.py": ("report/plots/*.py",),
    "unit/report/test_html.py": (
        "report/highlights.py",
        "report/scene.py",
        "report/summary.py",
        "report/summary_text.py",
        "report/tables.py",
    ),
    "unit/report/test_rendering.py": (
        "report/comparison.py",
        "report/percentile_filter.py",
    ),
    "unit/skeleton/test_trees.py": ("skeleton/tree_builder.py",),
    "unit/synthetic/test_gait_motions.py": ("synthetic/gait_plans.py",),
    "unit/synthetic/test_motions.py": ("synthetic/figures.py",),
    "unit/test_editing.py": (
        "io/edits.py",
        "model/edits.py",
    ),
    "unit/tracking/strategies/test_specification.py": (
        "tracking/strategies/pelvis_distance.py",
        "tracking/strategy.py",
    ),
    "unit/tracking/test_manage.py": ("tracking/promotion.py",),
    "unit/tracking/test_smoothing.py": (
        "tracking/backward_pass.py",
        "tracking/refiltering.py",
        "tracking/smoothed_bodies.py",
    ),
    "unit/tracking/test_tracker.py": ("tracking/update.py",),
    "unit/trajectory/test_solve.py": (
        "trajectory/roughness.py",
        "trajectory/error_level.py",
        "trajectory/initial_paths.py",
        "trajectory/observations.py",
        "trajectory/path_solver.py",
    ),
    "unit/visualize/overlay/test_write.py": (
        "visualize/annotations.py",
        "visualize/drawing.py",
        "visualize/overlay/video_sources.py",
    ),
    "unit/visualize/viewer/test_scene.py": ("visualize/viewer/layout.py",),
    "unit/calibration/boards/test_calibration.py": ("calibration/boards/*.py",),
}
"""Files with logic and without a unit test of their name, by the test that runs them through their callers.

Patterns stand for modules behind one table or one entry point: formats, figures, commands and kernels.
"""


def functions_of(path: Path) -> list[ast.FunctionDef | ast.AsyncFunctionDef]:
    tree = ast.parse(path.read_text("utf-8"))
    return [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]


def body_lines(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    body = function.body[1:] if ast.get_docstring(function) else function.body
    return (body[-1].end_lineno or 0) - body[0].lineno + 1 if body else 0


def n_arguments(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    arguments = function.args
    names = [each.arg for each in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)]
    return len([name for name in names if name not in ("self", "cls")])


def is_inline(function: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    return "inline" in [ast.unparse(each) for each in function.decorator_list]


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT / "src")))
def test_file_and_functions_stay_below_the_size_limits(path: Path):
    kernel = "kernels" in path.parts
    longest = MOST_KERNEL_BODY if kernel else MOST_BODY
    too_long = [f"{each.name}: {body_lines(each)} lines" for each in functions_of(path) if body_lines(each) > longest]
    too_wide = [
        f"{each.name}: {n_arguments(each)} arguments"
        for each in functions_of(path)
        if n_arguments(each) > (MOST_SCALARS if kernel and is_inline(each) else MOST_ARGUMENTS)
    ]
    assert path.read_text("utf-8").count("\n") <= MOST_LINES
    assert not too_long
    assert not too_wide


def source_of(test: Path) -> Path:
    """Return the source file that a unit test is named after; benchmarks and scripts have their own folders."""
    relative = test.relative_to(TEST_FOLDER)
    folder = ROOT if relative.parts[0] in ("benchmarks", "scripts") else SOURCE_FOLDER
    return folder / relative.parent / relative.name.removeprefix("test_")


def logic_lines(path: Path) -> int:
    """Return the number of lines in the bodies of functions and methods."""
    functions = functions_of(path)
    nested = {id(each) for function in functions for each in ast.walk(function) if each is not function}
    return sum(body_lines(each) for each in functions if id(each) not in nested)


def untested_files() -> list[str]:
    """Return the source files with logic that have no unit test of their name."""
    return [
        str(path.relative_to(SOURCE_FOLDER))
        for path in SOURCES
        if path.name != "__init__.py"
        and logic_lines(path) > MIN_TESTED_LINES
        and not (TEST_FOLDER / path.relative_to(SOURCE_FOLDER).parent / f"test_{path.name}").is_file()
    ]


def test_every_unit_test_is_named_after_a_source_file():
    names = {str(test.relative_to(TEST_FOLDER)): source_of(test) for test in sorted(TEST_FOLDER.rglob("test_*.py"))}
    without = [name for name, source in names.items() if not source.is_file()]
    assert [name for name in without if not any(fnmatch(name, pattern) for pattern in WITHOUT_SOURCE)] == []
    assert [pattern for pattern in WITHOUT_SOURCE if not any(fnmatch(name, pattern) for name in without)] == []


def test_every_file_with_logic_has_a_unit_test_or_a_reason():
    files, patterns = untested_files(), [pattern for each in TESTED_ELSEWHERE.values() for pattern in each]
    assert [name for name in files if not any(fnmatch(name, pattern) for pattern in patterns)] == []
    assert [pattern for pattern in patterns if not any(fnmatch(name, pattern) for name in files)] == []
    assert [test for test in TESTED_ELSEWHERE if not (ROOT / "tests" / test).is_file()] == []
