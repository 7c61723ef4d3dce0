"""Options of the tracker's stages, one record per stage.

Lengths are those of an adult human. Other bodies have them in proportion to their size.
"""

from dataclasses import dataclass

from posefuse.model.options.bounds import check_fields, option


@dataclass(frozen=True)
class InitiationOptions:
    """Conditions under which a proposal becomes a track.

    Attributes:
        min_age_s: Age at which a tentative track can be confirmed (A_min), in seconds.
        min_age_two_views_s: Age at which a tentative track seen in only two views can be confirmed, in seconds.
        two_views_log_odds: With the strategy `posefuse`, log odds that the views must accumulate before a track seen
            in only two views is confirmed; without contradicting views this takes 1 s.
        hit_share: Minimum fraction of the frames of a tentative track that show it (K of L).
        min_views: Minimum average number of views that show a tentative track (V_min).
        max_error_sigma: Maximum median reprojection error of a tentative track (tau_repr).
        max_bone_variation: Maximum variation of bone lengths after subtracting the noise, as a fraction of the length
            (tau_len).
        promote_log_odds: Minimum total log odds of a tentative track's proposals for confirmation (tau_promote).
        max_age_s: Age at which an unconfirmed tentative track is dropped (A_tent_max), in seconds.
        max_missing_s: Time without a proposal after which a tentative track is dropped (M_tent), in seconds.
        gate_m: Maximum distance of a proposal that continues a tentative track, in meters, plus
            ``motion.top_speed_m_s`` times the elapsed time.
        apart_m: Mean keypoint distance below which a proposal shows a person who is already tracked, in meters.
    """

    min_age_s: float = option(0.12, at_least=0.0)
    min_age_two_views_s: float = option(0.3, at_least=0.0)
    two_views_log_odds: float = option(5.5)
    hit_share: float = option(0.6, at_least=0.0, at_most=1.0)
    min_views: float = option(2.0, at_least=0.0)
    max_error_sigma: float = option(4.0, at_least=0.0)
    max_bone_variation: float = option(0.25, at_least=0.0)
    promote_log_odds: float = option(6.0)
    max_age_s: float = option(1.5, at_least=0.0)
    max_missing_s: float = option(0.25, at_least=0.0)
    gate_m: float = option(0.35, at_least=0.0)
    apart_m: float = option(0.3, at_least=0.0)

    def __post_init__(self) -> None:
        check_fields(self, "tracker.initiation")


@dataclass(frozen=True)
class FastMotionOptions:
    """Search for people who moved farther than the motion model predicts.

    Attributes:
        enabled: Whether to search the unassigned detections for people who moved farther than predicted.
        acceleration_factor: Factor for the spectral densities of acceleration while a person moves fast.
        onset_s: Duration of a fast motion before the frame that shows it, in seconds.
        swap_log_odds: Log odds that the left/right labels of a reassigned detection are those of its proposal.
    """

    enabled: bool = True
    acceleration_factor: float = option(16.0, at_least=0.0)
    onset_s: float = option(0.05, at_least=0.0)
    swap_log_odds: float = option(2.0, at_least=0.0)

    def __post_init__(self) -> None:
        check_fields(self, "tracker.fast_motion")


@dataclass(frozen=True)
class SingleViewOptions:
    """Priors on posture and height for people seen by a single view.

    Attributes:
        enabled: Whether posture and height estimated from several views constrain a person seen by a single view.
        history_s: Time constant of the averages of posture and height, in seconds.
        min_history_s: Minimum time for which several views must have shown a person before the priors apply, in
            seconds.
        lean_sd: Standard deviation of the trunk's inclination and of the bones' angles to the trunk, in addition to
            their recent variation, as a cosine or in radians.
        height_sd_m: Standard deviation of the lowest point's height in addition to its recent variation, in meters.
        correlation_s: Correlation time of the deviations from the priors, in seconds.
    """

    enabled: bool = True
    history_s: float = option(2.0, above=0.0)
    min_history_s: float = option(0.6, at_least=0.0)
    lean_sd: float = option(0.1, above=0.0)
    height_sd_m: float = option(0.03, above=0.0)
    correlation_s: float = option(0.25, above=0.0)

    def __post_init__(self) -> None:
        check_fields(self, "tracker.single_view")


@dataclass(frozen=True)
class CameraMonitorOptions:
    """Detection of cameras that moved or that stopped delivering detections.

    Attributes:
        enabled: Whether to reject cameras that contradict the others, and to report silent cameras.
        window_s: Time constant of the statistics of each camera, in seconds.
        min_expected_s: Minimum number of person-seconds that a camera should have shown before it is evaluated.
        reject_below_share: Minimum fraction of the expected people that a camera must show not to be rejected.
        restore_above_share: Minimum fraction of the expected people that a rejected camera must show to be used again.
        min_unexplained_share: Minimum number of unassigned detections, as a fraction of expected people, for rejecting
            a camera.
        silent_after_s: Time without frames, or without a detection of any expected person, after which a camera is
            silent, in seconds.
        back_after_s: Time for which a silent camera must deliver data again before it is reported as back, in seconds.
    """

    enabled: bool = True
    window_s: float = option(2.0, above=0.0)
    min_expected_s: float = option(1.0, at_least=0.0)
    reject_below_share: float = option(0.15, at_least=0.0, at_most=1.0)
    restore_above_share: float = option(0.5, at_least=0.0, at_most=1.0)
    min_unexplained_share: float = option(0.5, at_least=0.0)
    silent_after_s: float = option(2.0, above=0.0)
    back_after_s: float = option(0.2, at_least=0.0)

    def __post_init__(self) -> None:
        check_fields(self, "tracker.camera_monitor")


@dataclass(frozen=True)
class IdentityAuditOptions:
    """Comparison of bone lengths after two people were too close to be distinguished.

    Attributes:
        enabled: Whether to compare bone lengths after two people separate, and to swap identities if they disagree.
        near_m: Distance below which two people can be confused, in meters.
        apart_m: Distance above which two people count as separated again, in meters.
        min_merged_s: Minimum time for which most views must have shown only one of the two people, in seconds.
        observe_s: Time over which the separated people are observed before the comparison, in seconds.
        max_observe_s: Maximum time from the separation to the comparison, in seconds.
        frames: Number of frames to which each body is fitted.
        min_frames: Minimum number of frames for a comparison; with fewer, a possible identity switch is reported.
        min_interval_s: Minimum time between two frames of a comparison, in seconds.
        min_log_odds: Minimum log odds for confirming or swapping the identities.
    """

    enabled: bool = True
    near_m: float = option(0.6, at_least=0.0)
    apart_m: float = option(0.9, at_least=0.0)
    min_merged_s: float = option(0.15, at_least=0.0)
    observe_s: float = option(1.2, above=0.0)
    max_observe_s: float = option(3.0, above=0.0)
    frames: int = option(12, at_least=1)
    min_frames: int = option(4, at_least=1)
    min_interval_s: float = option(0.03, at_least=0.0)
    min_log_odds: float = option(4.6, at_least=0.0)

    def __post_init__(self) -> None:
        check_fields(self, "tracker.identity_audit")


@dataclass(frozen=True)
class ReinitializationOptions:
    """Reinitialization of limbs and directions from the points that the views show.

    Attributes:
        enabled: Whether to reinitialize directions that are unknown or that most views contradict.
        unknown_share: Fraction of the initial variance above which a predicted direction counts as unknown.
        limb_after_s: Time for which most views must contradict a limb before it is reinitialized, in seconds.
    """

    enabled: bool = True
    unknown_share: float = option(0.5, above=0.0)
    limb_after_s: float = option(0.2, at_least=0.0)

    def __post_init__(self) -> None:
        check_fields(self, "tracker.reinitialization")


@dataclass(frozen=True)
class PartialDetectionOptions:
    """Merging of several detections that show different parts of one person in one view.

    Attributes:
        enabled: Whether to merge partial detections of one person in one view.
        max_common_share: Maximum fraction of the smaller detection's keypoints that both detections have.
    """

    enabled: bool = True
    max_common_share: float = option(0.25, at_least=0.0, at_most=1.0)

    def __post_init__(self) -> None:
        check_fields(self, "tracker.partial_detections")


@dataclass(frozen=True)
class SharedDetectionOptions:
    """Sharing of one detection between two people in close contact.

    Attributes:
        enabled: Whether a detection with keypoints of two people updates both of them.
        distance_m: Maximum distance in the image between the centers of two people who share a detection, in meters at
            their depth.
        edge_evidence: Evidence against two neighboring keypoints of a detection being those of different people, in
            nats.
        min_evidence: Minimum evidence that the second person's keypoints are not the first one's, in nats.
    """

    enabled: bool = True
    distance_m: float = option(0.7, at_least=0.0)
    edge_evidence: float = option(1.0, at_least=0.0, unit="nats")
    min_evidence: float = option(6.0, at_least=0.0, unit="nats")

    def __post_init__(self) -> None:
        check_fields(self, "tracker.shared_detections")


@dataclass(frozen=True)
class ReidentificationOptions:
    """Re-identification of new people as lost ones.

    Attributes:
        min_log_odds: Minimum log odds at which a new person is re-identified as a lost one.
        immediate_log_odds: Minimum sum of the log odds of proposals, position and bone lengths for re-acquiring a lost
            track in one frame.
        ambiguity_log_odds: Difference of log odds below which another lost track is reported as equally likely.
        corrupt_share: Probability that an observation of bone lengths is an outlier.
        length_sd_share: Standard deviation of a bone length between two observations, as a fraction of the length.
        length_sd_m: Constant part of the standard deviation of a bone length between two observations.
        reach_m: Distance that a lost person can move immediately, in meters, plus ``motion.top_speed_m_s`` times the
            elapsed time.
        room_m: Width of the region in which a new person appears with equal probability, in meters.
        trunk_sd_m: Standard deviation of the position of a barely visible trunk, in meters.
        min_absence_share: Minimum time without support for a track that is not lost to be considered, as a fraction of
            the time for which the new person was visible.
    """

    min_log_odds: float = option(0.0)
    immediate_log_odds: float = option(2.0)
    ambiguity_log_odds: float = option(1.0, at_least=0.0)
    corrupt_share: float = option(0.02, above=0.0, below=1.0)
    length_sd_share: float = option(0.03, at_least=0.0)
    length_sd_m: float = option(0.01, above=0.0)
    reach_m: float = option(0.7, above=0.0)
    room_m: float = option(4.0, above=0.0)
    trunk_sd_m: float = option(0.3, above=0.0)
    min_absence_share: float = option(0.5, at_least=0.0, at_most=1.0)

    def __post_init__(self) -> None:
        check_fields(self, "tracker.reidentification")


@dataclass(frozen=True)
class LifecycleOptions:
    """Rules for which views should show a person and what a missing detection means.

    Attributes:
        visible_share: Fraction of the core keypoints that must be inside an image for its view to be expected to show
            the person.
        occluded_share: Fraction of the core keypoints inside another detection's box above which a person is occluded.
        max_missing_views: Maximum total effect of the views that miss a person while another view shows them, as a
            number of views.
        explained_evidence: Minimum evidence at which a tracked person explains a detection, in nats.
        outside_margin_m: Margin around an image within which a person counts as inside it, in meters.
    """

    visible_share: float = option(0.5, above=0.0, at_most=1.0)
    occluded_share: float = option(0.5, above=0.0, at_most=1.0)
    max_missing_views: float = option(1.2, at_least=0.0)
    explained_evidence: float = option(3.0, unit="nats")
    outside_margin_m: float = option(0.5, at_least=0.0)

    def __post_init__(self) -> None:
        check_fields(self, "tracker.lifecycle")
