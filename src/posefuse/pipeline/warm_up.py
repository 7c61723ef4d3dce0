"""Compile the kernels before the first recording, for images of containers and for machines of a cluster."""

import multiprocessing
import tempfile
import warnings
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

from posefuse.arguments import checked
from posefuse.errors import OptionsError, PosefuseError
from posefuse.io.calibration import anipose
from posefuse.io.keypoints import native
from posefuse.model.options.calibration import PeopleOptions
from posefuse.model.options.options import Options
from posefuse.model.options.tracker import TrackerOptions
from posefuse.model.options.tracking_stages import SingleViewOptions
from posefuse.pipeline.calibrate_people import calibrate_by_people
from posefuse.pipeline.reconstruct_recording import reconstruct_recording
from posefuse.progress import Progress, Silent
from posefuse.synthetic.crowd_options import CrowdFaults, CrowdOptions
from posefuse.synthetic.crowds import CrowdScene, simulate_crowd
from posefuse.synthetic.options import DetectorOptions, SceneOptions
from posefuse.synthetic.scenes import Scene, simulate

_DURATION_S = 2.0


def _one_subject(folder: Path) -> None:
    # Swapped labels, so that the search for them is compiled, and feet at rest.
    scene = SceneOptions(duration_s=_DURATION_S, activities=("stand",), detector=DetectorOptions(swap_share=0.1))
    _write(simulate(scene), folder)
    for solve in ("frame", "trajectory"):
        reconstruct_recording(folder, folder / solve, Options(solve=solve))


def _several_people(folder: Path) -> None:
    # Hands and faces, people seen by a single view, and bone lengths that become fixed, all within a short time.
    crowd = CrowdOptions(
        people=2,
        cameras=3,
        duration_s=_DURATION_S,
        skeleton="coco_wholebody_133",
        faults=CrowdFaults(miss_share=0.4),
    )
    _write(simulate_crowd(crowd), folder)
    tracker = TrackerOptions(fix_shape_after_s=0.4, single_view=SingleViewOptions(min_history_s=0.1))
    reconstruct_recording(folder, folder / "result", Options(people="many", tracker=tracker))


def _calibration_by_people(folder: Path) -> None:
    _write(simulate_crowd(CrowdOptions(people=2, cameras=3, duration_s=2 * _DURATION_S)), folder)
    calibrate_by_people(folder, intrinsics=folder / "calibration.toml", options=PeopleOptions(stature_m=1.8, jobs=1))


TASKS: Mapping[str, Callable[[Path], None]] = {
    "one subject": _one_subject,
    "several people": _several_people,
    "calibration by people": _calibration_by_people,
}
"""Work that needs most kernels; each is a process of its own, since processes do not share what they compile."""


@checked
def warm_up(jobs: int = 2, *, progress: Progress | None = None) -> Sequence[str]:
    """Compile and store the kernels for one subject, for several people, and for a calibration by people.

    Each task processes a short simulated scene.

    Args:
        jobs: number of processes.
        progress: receives the progress.

    Returns:
        What is ready.

    Raises:
        OptionsError: if ``jobs`` is less than 1.
        PosefuseError: if a process dies.
    """
    if jobs < 1:
        raise OptionsError(f"jobs must be at least 1, got {jobs}.")
    progress = progress or Silent()
    progress.start("compiling", len(TASKS))
    context = multiprocessing.get_context("spawn")
    try:
        with ProcessPoolExecutor(min(jobs, len(TASKS)), mp_context=context) as pool:
            for done in as_completed([pool.submit(_run, name) for name in TASKS]):
                done.result()
                progress.advance(1)
    except BrokenProcessPool:
        raise PosefuseError(
            "A process that compiled kernels died. It may have run out of memory; `jobs=1` runs one at a time."
        ) from None
    finally:
        progress.finish()
    return tuple(TASKS)


def _run(name: str) -> None:
    warnings.simplefilter("ignore")  # Short simulated scenes have findings that are of no interest.
    with tempfile.TemporaryDirectory() as folder:
        TASKS[name](Path(folder))


def _write(scene: Scene | CrowdScene, folder: Path) -> None:
    anipose.write(scene.rig, folder / "calibration.toml")
    native.write(scene.detections, folder / "keypoints.nc")
