"""What ``posefuse calibrate`` prints of a calibration by people."""

from posefuse.calibration.people.result import BoardShare, PeopleCalibration, PeopleCameraReport
from posefuse.cli.assessment import describe_assessment
from posefuse.cli.console import count, note, say, table


def describe_people(result: PeopleCalibration) -> None:
    """Print the accuracy of a calibration by people, what was assumed, and what to film next."""
    from posefuse.calibration.people.summary import summarize_people

    people, frames = result.points_m.shape[1], len(result.time_s)
    who = (
        ("1 person" if people == 1 else f"{people} people") if result.skeleton.plausible_m else count(people, "animal")
    )
    say(f"{count(len(result.cameras), 'camera')}, {who} in {count(frames, 'moment')}")
    held_out = "" if result.held_out_px != result.held_out_px else f", {result.held_out_px:.2f} px held out"
    say(f"median error {result.error_px:.2f} px{held_out}")
    columns = ["camera", "keypoints", "median px", "focal px", "rotation +- deg", "center +- mm", "offset ms"]
    table(None, columns, [_row(result, v, camera) for v, camera in enumerate(result.cameras)])
    note(f"+- is a standard deviation relative to camera {result.cameras[0].name!r}, in the worst direction.")
    if result.board is not None:
        _describe_board(result)
    for camera in result.cameras:
        if abs(camera.rate - 1.0) > 1e-3:
            note(f"camera {camera.name!r}: its frame rate is wrong by a factor of {1.0 / camera.rate:.4f}")
    for name, reason in result.left_out.items():
        note(f"left out: camera {name!r}: {reason}")
    for line in result.notes:
        note(line)
    describe_assessment(summarize_people(result))


def _describe_board(result: PeopleCalibration) -> None:
    """Print what the board tells about each camera, before the people."""
    say("")
    columns = ["camera", "board images", "error px", "lens", "rotation +- deg", "center +- mm", "relative to"]
    table(f"The board {result.board} alone", columns, [_share_row(share) for share in result.board_shares])


def _share_row(share: BoardShare) -> list[str]:
    lens = "by the board" if share.lens else "-"
    if not share.n_images:
        return [share.name, "-", "-", lens, "-", "-", "-"]
    row = [share.name, str(share.n_images), f"{share.error_px:.2f}", lens]
    if share.name == share.reference:
        return [*row, "-", "-", "-"]
    return [*row, f"{share.rotation_sd_deg:.2f}", f"{1000 * share.center_sd_m:.0f}", share.reference]


def _row(result: PeopleCalibration, v: int, report: PeopleCameraReport) -> list[str]:
    focal = f"{result.rig.cameras[v].matrix[0, 0]:.0f}"
    known = report.offset_sd_s == report.offset_sd_s
    return [
        report.name,
        str(report.n_observations),
        f"{report.error_px:.2f}" if report.n_observations else "-",
        focal if report.lens_given else f"{focal} +-{report.focal_sd_px:.0f}",
        "-" if v == 0 else f"{report.rotation_sd_deg:.2f}",
        "-" if v == 0 else f"{1000 * report.center_sd_m:.0f}",
        "-" if v == 0 else (f"{1000 * report.offset_s:.0f} +-{1000 * report.offset_sd_s:.0f}" if known else "unknown"),
    ]
