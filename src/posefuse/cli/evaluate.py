"""``posefuse evaluate``."""

import json
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from posefuse.cli.console import count, percent, say, table
from posefuse.evaluation.accuracy import Accuracy, Truth
from posefuse.model.options import LayerName
from posefuse.model.reconstruction import Reconstruction


def evaluate(
    result: Annotated[Path, Parameter(help="A result's folder, or its reconstruction.nc.")],
    truth: Annotated[Path, Parameter(help="Known positions: a truth.nc, another reconstruction.nc, or a TRC file.")],
    *,
    layer: Annotated[LayerName | None, Parameter(help="Which layer; by default the best present.")] = None,
    json_file: Annotated[
        Path | None,
        Parameter(name="--json", help="Where to write the numbers; by default evaluation.json in the result."),
    ] = None,
) -> None:
    """Compare a result with known positions: a table, and the numbers as JSON."""
    from posefuse.io.files import must_exist, replacing

    path, accuracy = compare(result, must_exist(truth, "truth"), layer)
    target = json_file or path.parent / "evaluation.json"
    with replacing(target) as temporary:
        temporary.write_text(json.dumps(asdict(accuracy), indent=2) + "\n", "utf-8")
    show(accuracy)
    say(f"Wrote {target}")


def compare(result: Path, truth: Path, layer: LayerName | None) -> tuple[Path, Accuracy]:
    """The accuracy of a result against a truth file, and the file the result is in."""
    from posefuse.cli.results import open_result
    from posefuse.evaluation import accuracy

    path, reconstruction = open_result(result)
    reconstruction = replace(reconstruction, options=replace(reconstruction.options, layer=layer))
    return path, accuracy.evaluate(reconstruction, truth_finder(truth)(reconstruction))


def truth_finder(path: Path) -> Callable[[Reconstruction], Truth]:
    """Read a truth file; what comes back finds its positions at the frames of a result."""
    import numpy as np

    from posefuse.evaluation import accuracy
    from posefuse.io.results import netcdf, trc
    from posefuse.io.results.axes import y_up_from_world

    if path.suffix.lower() != ".trc":
        known = netcdf.read_reconstruction(path)
        return lambda result: accuracy.truth_from_result(result, known)
    tracks = trc.read(path)

    def found(result: Reconstruction) -> Truth:
        world_from_file = np.asarray(y_up_from_world(result.rig.up_axis)).T
        points = tracks.points_m @ world_from_file.T
        return accuracy.truth_from_trajectories(result, tracks.names, tracks.time_s, points)

    return found


def show(accuracy: Accuracy) -> None:
    """Print the accuracy."""
    rows = [
        ["compared points", str(accuracy.n_points)],
        ["mean error (MPJPE)", f"{accuracy.mpjpe_mm:.2f} mm"],
        ["median", f"{accuracy.median_mm:.2f} mm"],
        ["90 %", f"{accuracy.p90_mm:.2f} mm"],
        ["95 %", f"{accuracy.p95_mm:.2f} mm"],
        ["99 %", f"{accuracy.p99_mm:.2f} mm"],
        ["beyond 5 cm", percent(accuracy.share_beyond_50_mm)],
        ["missing", percent(accuracy.missing_share)],
    ]
    if accuracy.reprojection_median_px is not None:
        rows.append(["median reprojection error", f"{accuracy.reprojection_median_px:.2f} px"])
    if accuracy.bone_variation is not None:
        rows.append(["bone length variation", percent(accuracy.bone_variation)])
    if accuracy.covered_68 is not None and accuracy.covered_95 is not None:
        rows.append(["inside 68 / 95 % region", f"{percent(accuracy.covered_68)} / {percent(accuracy.covered_95)}"])
    say(
        f"layer {accuracy.layer} against the truth, by {accuracy.matched_by}: "
        f"{count(accuracy.n_frames, 'frame')}, {count(accuracy.n_keypoints, 'keypoint')}"
    )
    table(None, ["", ""], rows)
