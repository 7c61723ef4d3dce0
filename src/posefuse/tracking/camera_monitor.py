"""Detection of cameras that moved, that stopped delivering frames, or that miss people they should show."""

from dataclasses import dataclass

import numpy as np

from posefuse.arrays import kernel_array
from posefuse.kernels.tracking.frame_statistics import accumulate_view_support, update_silence
from posefuse.kernels.tracking.records import ViewSilence, ViewSupport
from posefuse.model.frames import Frame
from posefuse.model.options.tracking_stages import CameraMonitorOptions
from posefuse.model.track_events import EventKind
from posefuse.tracking.settings import TrackerSettings

CameraChange = tuple[int, EventKind, str]
"""View, kind of event and reason."""


@dataclass
class CameraMonitor:
    """Running statistics of each camera.

    Attributes:
        expected_s: shape (view,): recent person-seconds that two other views show and the view should show.
        matched_s: shape (view,): recent person-seconds of these that the view shows.
        unexplained_s: shape (view,): recent seconds of unassigned detections in their place.
        rejected: shape (view,), bool: whether the camera contradicts the others.
        n_due: shape (view,), int64: number of people that the view should have shown in the last frame.
        absent_s: shape (view,): time since the last frame of the view.
        blind_s: shape (view,): time for which the view has shown no person although it should have.
        active_s: shape (view,): time for which a silent view has delivered again.
        silent: shape (view,), bool: whether the view is silent.
    """

    expected_s: np.ndarray
    matched_s: np.ndarray
    unexplained_s: np.ndarray
    rejected: np.ndarray
    n_due: np.ndarray
    absent_s: np.ndarray
    blind_s: np.ndarray
    active_s: np.ndarray
    silent: np.ndarray

    @classmethod
    def new(cls, n_views: int) -> "CameraMonitor":
        """Return a monitor before the first frame."""
        times = np.zeros((6, n_views))
        rejected, silent = np.zeros((2, n_views), dtype=bool)
        expected_s, matched_s, unexplained_s, absent_s, blind_s, active_s = times
        n_due = np.zeros(n_views, dtype=np.int64)
        return cls(expected_s, matched_s, unexplained_s, rejected, n_due, absent_s, blind_s, active_s, silent)

    def update_fit(
        self,
        supported: np.ndarray,
        expected: np.ndarray,
        n_unassigned: np.ndarray,
        dt_s: float,
        options: CameraMonitorOptions,
    ) -> list[CameraChange]:
        """Find cameras that no longer agree with the others, or agree again.

        Args:
            supported: shape (active track, view), bool: views that support each track.
            expected: shape (active track, view), bool: views that should show each track.
            n_unassigned: shape (view,), int64: number of unassigned detections.
            dt_s: Time since the last frame, in seconds.
            options: Options of the monitor.
        """
        fade = float(np.exp(-dt_s / options.window_s))
        support = ViewSupport(self.expected_s, self.matched_s, self.unexplained_s, self.n_due)
        accumulate_view_support(supported, expected, n_unassigned, fade, dt_s, support)
        changes: list[CameraChange] = []
        columns = (self.expected_s, self.matched_s, self.unexplained_s, self.rejected)
        views = zip(*(each.tolist() for each in columns), strict=True)
        for v, (expected_s, matched_s, unexplained_s, rejected) in enumerate(views):
            if not expected_s > options.min_expected_s:
                continue
            share = matched_s / max(expected_s, 1e-9)
            if rejected and share > options.restore_above_share:
                self.rejected[v] = False
                changes.append((v, "camera_restored", f"it shows {share:.0%} of the people whom other cameras show"))
            elif (
                not rejected
                and share < options.reject_below_share
                and unexplained_s / max(expected_s, 1e-9) > options.min_unexplained_share
            ):
                self.rejected[v] = True
                reason = f"it shows {share:.0%} of the people whom other cameras show, and people elsewhere"
                changes.append((v, "camera_rejected", reason))
        return changes

    def update_silence(
        self, recorded: np.ndarray, n_detections: np.ndarray, dt_s: float, options: CameraMonitorOptions
    ) -> list[CameraChange]:
        """Find cameras that fall silent, or that are back; the number of people due is that of ``update_fit``.

        Args:
            recorded: shape (view,), bool: whether the view has this frame.
            n_detections: shape (view,): number of detections.
            dt_s: Time since the last frame, in seconds.
            options: Options of the monitor.
        """
        change = np.empty(len(recorded), dtype=np.int64)
        silence = ViewSilence(self.absent_s, self.blind_s, self.active_s, self.silent)
        if not update_silence(
            kernel_array(recorded, np.bool_), n_detections, self.n_due, dt_s, options.silent_after_s,
            options.back_after_s, silence, change,
        ):  # fmt: skip
            return []
        changes: list[CameraChange] = [
            (int(v), "camera_silent", self._silence_reason(int(v))) for v in np.flatnonzero(change > 0)
        ]
        back = "it delivers frames and shows the expected people"
        return changes + [(int(v), "camera_back", back) for v in np.flatnonzero(change < 0)]

    def _silence_reason(self, view: int) -> str:
        if self.absent_s[view] >= self.blind_s[view]:
            return f"no usable frame for {self.absent_s[view]:.1f} s"
        return f"no person shown for {self.blind_s[view]:.1f} s, although other cameras show people in its image"


def is_occluded(pixels: np.ndarray, rows: np.ndarray, frame: Frame, min_share: float) -> np.ndarray:
    """Return the views in which another detection may occlude a person, shape (view,), bool.

    Args:
        pixels: shape (view, core, 2): core keypoints of the person, NaN where the view cannot see them.
        rows: shape (view,), int64: the person's own detections, -1 for none; they occlude nothing.
        frame: The detections.
        min_share: Share of the core keypoints inside a detection's box that counts as occlusion.
    """
    boxes, at = frame.boxes_px, pixels[frame.view]
    within = (at >= boxes[:, None, :2]) & (at <= boxes[:, None, 2:])
    covers = within.all(axis=-1).mean(axis=1) >= min_share
    covers[rows[rows >= 0]] = False
    return np.bincount(frame.view[covers], minlength=len(pixels)) > 0


def missing_views(
    points_m: np.ndarray, rows: np.ndarray, frame: Frame, rejected: np.ndarray, settings: TrackerSettings
) -> np.ndarray:
    """Return the views that should show a proposed person and do not, shape (view,), bool.

    Args:
        points_m: shape (keypoint, 3): points of the person, NaN where unknown.
        rows: shape (view,), int64: detections of the person, -1 for none.
        frame: The detections.
        rejected: shape (view,), bool: cameras that are not used.
        settings: Settings of the tracker.
    """
    options = settings.options.lifecycle
    pixels = settings.rig.project(points_m[None, settings.core])[0]
    in_image = ((pixels >= 0.0) & (pixels < settings.sizes_px[:, None])).all(axis=-1)
    inside = in_image.mean(axis=-1) >= options.visible_share
    occluded = is_occluded(pixels, rows, frame, options.occluded_share)
    return inside & frame.recorded & ~rejected & (rows < 0) & ~occluded
