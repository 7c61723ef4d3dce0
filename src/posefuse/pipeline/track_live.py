"""Track people live, one frame at a time."""

from dataclasses import replace

from posefuse.arguments import checked
from posefuse.model.cameras import CameraRig
from posefuse.model.frames import Frame
from posefuse.model.options.options import Options
from posefuse.model.options.tracker import TrackerOptions
from posefuse.pipeline.people.initial_noise import default_noise
from posefuse.pipeline.people.trackers import tracker_of, warn_of_unused_options
from posefuse.skeleton.skeletons import Skeleton, find_skeleton
from posefuse.tracking.records import People


@checked
class Tracker:
    """Tracks people live: each update takes one frame and returns all people; no state is kept outside the object.

    A tracker can be pickled between frames. The same frames give the same people.

    Args:
        rig: calibrated cameras, in the order of the frames' views.
        skeleton: skeleton of the keypoints, with a kinematic tree.
        options: ``tracker``, ``association``, ``triangulation.confidence_exponent`` and the options that fix the noise
            are used. Without the latter the noise is 4.5 px / confidence at 1000 px image width.

    Raises:
        SkeletonError: if the skeleton has no kinematic tree.
    """

    def __init__(self, rig: CameraRig, skeleton: Skeleton | str, options: Options | None = None) -> None:
        options = options or Options()
        noise, known = default_noise(rig, options), find_skeleton(skeleton)
        # Live results are not smoothed, whatever the options request.
        live = replace(options, tracker=replace(options.tracker, smoother="none", lag_s=TrackerOptions().lag_s))
        warn_of_unused_options(live, known)
        self._tracker = tracker_of(rig, known, noise, options)

    def update(self, frame: Frame) -> People:
        """Process one frame, later than the last one.

        Args:
            frame: detections of all views; :meth:`Frame.of_people` builds one from detectors' arrays.

        Returns:
            Active, then lost, then tentative people, with positions in meters, covariances, assigned detections and
            events.

        Raises:
            DetectionsError: if the frame does not fit the cameras or the skeleton, has no time, or is not later.
        """
        return self._tracker.update(frame)
