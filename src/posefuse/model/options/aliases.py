"""Suggest the option that a user means by an unknown name: a typing error, another program's word, or a former name."""

from collections.abc import Iterable, Iterator, Mapping
from difflib import get_close_matches
from typing import Any

from posefuse.errors import suggestion
from posefuse.model.options.catalog import options_by_name

OTHER_PROGRAMS: dict[str, str] = {
    # Frame rate
    "fps": "rate_hz",
    "framerate": "rate_hz",
    "frame_rate": "rate_hz",
    "frames_per_second": "rate_hz",
    "frame_range": "start_s",
    # Triangulation: Pose2Sim, Anipose, FreeMoCap
    "method": "triangulation.method",
    "triangulation_method": "triangulation.method",
    "ransac": "triangulation.method",
    "use_triangulate_ransac": "triangulation.method",
    "likelihood_threshold": "triangulation.min_confidence",
    "likelihood_threshold_triangulation": "triangulation.min_confidence",
    "score_threshold": "triangulation.min_confidence",
    "confidence_threshold": "triangulation.min_confidence",
    "minimum_confidence": "triangulation.min_confidence",
    "likelihood_threshold_association": "association.min_confidence",
    "min_cameras": "triangulation.min_views",
    "min_cameras_for_triangulation": "triangulation.min_views",
    "minimum_cameras": "triangulation.min_views",
    "minimum_cameras_for_triangulation": "triangulation.min_views",
    "maximum_cameras_to_drop": "triangulation.weighted_subsets.max_cameras_to_drop",
    "target_reprojection_error": "triangulation.weighted_subsets.target_normalized",
    "use_triangulate_outlier_rejection": "triangulation.method",
    "run_reprojection_error_filtering": "triangulation.method",
    "minimum_cameras_to_reproject": "triangulation.percentile_filter.min_views_left",
    "minimum_number_of_cameras_left": "triangulation.percentile_filter.min_views_left",
    "reproj_error_threshold": "postprocess.drop_beyond_px",
    "reproj_error_threshold_triangulation": "postprocess.drop_beyond_px",
    "reprojection_error_threshold": "postprocess.drop_beyond_px",
    "reprojection_error_confidence_cutoff": "triangulation.percentile_filter.percentile",
    "flatten_single_camera_data": "triangulation.flatten_single_view",
    "handle_lr_swap": "pairs",
    "optim": "solve",
    "constraints": "trajectory.bones",
    "scale_length": "trajectory.bones",
    "scale_smooth": "trajectory.density",
    # People
    "multi_person": "people",
    "single_person": "people",
    "nb_persons": "tracker.max_people",
    "nb_persons_to_detect": "tracker.max_people",
    "number_of_people": "tracker.max_people",
    "num_people": "tracker.max_people",
    "max_distance_m": "association.known_person_distance_m",
    "participant_height": "align.height_m",
    "height": "align.height_m",
    "participant_mass": "subject.mass_kg",
    "mass": "subject.mass_kg",
    "weight": "subject.mass_kg",
    # Filters
    "filter": "postprocess.smooth",
    "filters": "postprocess.smooth",
    "filter_type": "postprocess.smooth",
    "filtering": "postprocess.smooth",
    "smoothing": "postprocess.smooth",
    "cutoff": "postprocess.butterworth.cutoff_hz",
    "cut_off_frequency": "postprocess.butterworth.cutoff_hz",
    "cutoff_frequency": "postprocess.butterworth.cutoff_hz",
    "filter_cutoff_hz": "postprocess.butterworth.cutoff_hz",
    "order": "postprocess.butterworth.order",
    "filter_order": "postprocess.butterworth.order",
    "medfilt": "postprocess.median.window_s",
    "interpolation": "postprocess.fill",
    "interpolate": "postprocess.fill",
    "interp_if_gap_smaller_than": "postprocess.max_gap_s",
    "max_gap_to_fill": "postprocess.max_gap_s",
    # Cameras and keypoints
    "pose_model": "skeleton",
    "model": "skeleton",
    "cams": "cameras",
    "camera": "cameras",
    "exclude_cameras": "exclude_camera",
    "up_axis": "up",
    "units": "length_unit",
}
"""Words of Pose2Sim, FreeMoCap, Anipose and other programs, and the option that does the same or the nearest thing."""

RENAMED: dict[str, str] = {
    "triangulation.consensus.bound_sigma": "triangulation.consensus.saturation_sigma",
    "triangulation.consensus.full_sigma": "triangulation.consensus.full_weight_sigma",
    "triangulation.consensus.none_sigma": "triangulation.consensus.zero_weight_sigma",
    "association.bound_sigma": "association.saturation_sigma",
    "association.full_sigma": "association.full_weight_sigma",
    "association.none_sigma": "association.zero_weight_sigma",
    "association.known_within_m": "association.known_person_distance_m",
    "association.rpt.centre_within_m": "association.rpt.center_distance_m",
    "association.rpt.joints_within_m": "association.rpt.keypoint_distance_m",
    "association.rpt.spread_m": "association.rpt.outlier_distance_m",
    "association.rpt.nearest": "association.rpt.merged_pairs",
    "pair_search.prior_m": "pair_search.motion_sd_m",
    "pair_search.sds.apart_weight": "pair_search.sds.separation_weight",
    "side_search.dwell_s": "side_search.swap_duration_s",
    "side_search.rounds": "side_search.iterations",
    "trajectory.burst_s": "trajectory.density_window_s",
    "trajectory.calm": "trajectory.density_prior_s",
    "trajectory.least_bone_share": "trajectory.min_bone_variation",
    "trajectory.rigid_bone_share": "trajectory.max_rigid_bone_variation",
    "trajectory.full_sigma": "trajectory.full_weight_sigma",
    "trajectory.none_sigma": "trajectory.zero_weight_sigma",
    "trajectory.rounds": "trajectory.iterations",
    "sync.since_s": "sync.start_s",
    "sync.late_s": "sync.offset_s",
    "tracker.preset": "tracker.strategy",
    "tracker.forget_after_s": "tracker.terminate_after_s",
    "tracker.forget_beyond_m": "tracker.terminate_beyond_m",
    "tracker.outside_s": "tracker.terminate_outside_after_s",
    "tracker.weak_after_s": "tracker.single_view_after_s",
    "tracker.most_log_odds": "tracker.max_log_odds",
    "tracker.swap_lasts_s": "tracker.swap_duration_s",
    "tracker.shape_settle_s": "tracker.fix_shape_after_s",
    "tracker.smoother_own_share": "tracker.smoother_independent_share",
    "tracker.limb_anew_s": "tracker.reinitialization.limb_after_s",
    "tracker.camera_silent_s": "tracker.camera_monitor.silent_after_s",
    "tracker.camera_heard_s": "tracker.camera_monitor.back_after_s",
    "tracker.reacquire_log_odds": "tracker.reidentification.min_log_odds",
    "tracker.motion.leap_power": "tracker.fast_motion.acceleration_factor",
    "tracker.motion.leap_s": "tracker.fast_motion.onset_s",
    "tracker.parts.begin_share": "tracker.parts.initiate_share",
    "tracker.parts.begin_within_m": "tracker.parts.initiate_within_m",
    "tracker.parts.smoother_own_share": "tracker.parts.smoother_independent_share",
    "tracker.births.min_age_s": "tracker.initiation.min_age_s",
    "tracker.births.min_age_two_views_s": "tracker.initiation.min_age_two_views_s",
    "tracker.births.two_views_log_odds": "tracker.initiation.two_views_log_odds",
    "tracker.births.hit_share": "tracker.initiation.hit_share",
    "tracker.births.min_views": "tracker.initiation.min_views",
    "tracker.births.max_error_sigma": "tracker.initiation.max_error_sigma",
    "tracker.births.max_bone_variation": "tracker.initiation.max_bone_variation",
    "tracker.births.promote_log_odds": "tracker.initiation.promote_log_odds",
    "tracker.births.max_age_s": "tracker.initiation.max_age_s",
    "tracker.births.max_missing_s": "tracker.initiation.max_missing_s",
    "tracker.births.gate_m": "tracker.initiation.gate_m",
    "tracker.births.apart_m": "tracker.initiation.apart_m",
}
"""Former names of options. Stored results that use them are still read."""

UNITS: dict[str, tuple[str, str, str]] = {
    "triangulation.ransac.threshold": (
        "triangulation.ransac.threshold_unit",
        "triangulation.ransac.threshold_px",
        "triangulation.ransac.threshold_m",
    ),
    "triangulation.weighted_subsets.target_reprojection_error": (
        "triangulation.weighted_subsets.target_unit",
        "triangulation.weighted_subsets.target_px",
        "triangulation.weighted_subsets.target_normalized",
    ),
}
"""Former options whose unit was another option: that option, and the current options in px and in the other unit."""

REMOVED: frozenset[str] = frozenset({"side_search.learn_every", "side_search.memory"})
"""Former options without a successor. Stored results that hold them are still read."""


def matching_option(name: str, siblings: Iterable[str] = ()) -> str | None:
    """Return the dotted name of the option that an unknown name most probably means, or None.

    Args:
        name: Dotted name, with ``_`` or ``-`` between words.
        siblings: Valid names in the same table, which typing errors are compared with first.
    """
    name = name.strip("-").replace("-", "_").lower()
    if name in RENAMED:
        return RENAMED[name]
    for former, (unit, in_px, _) in UNITS.items():
        if name in (former, unit):
            return in_px
    table, _, key = name.rpartition(".")
    valid = options_by_name()
    for word in (name, key):
        if word in OTHER_PROGRAMS:
            return OTHER_PROGRAMS[word]
    close = get_close_matches(key, list(siblings), n=1, cutoff=0.75)
    if close:
        return f"{table}.{close[0]}" if table else close[0]
    elsewhere = [option for option, entry in valid.items() if entry.key == key]
    if elsewhere:
        return elsewhere[0]
    by_key = {entry.key: option for option, entry in reversed(valid.items())}
    close = get_close_matches(name, [*valid, *by_key, *OTHER_PROGRAMS], n=1, cutoff=0.8)
    return OTHER_PROGRAMS.get(close[0], by_key.get(close[0], close[0])) if close else None


def suggest_option(name: str, siblings: Iterable[str]) -> str:
    """Return the end of an error message about an unknown option: what was probably meant, or the valid names.

    Args:
        name: Dotted name of the unknown option.
        siblings: Valid names in the same table.
    """
    valid = list(siblings)
    match = matching_option(name, valid)
    return f"Did you mean {match!r}?" if match else suggestion(name.rpartition(".")[2], valid)


def with_current_names(data: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested tables of options with former names replaced by current ones, and removed options left out.

    Args:
        data: Options as an earlier version stored them.
        prefix: Table that holds the data, with its dot.
    """
    current: dict[str, Any] = {}
    leaves = dict(_leaves(data, prefix))
    for name, value in leaves.items():
        if name in REMOVED or any(name == unit for unit, _, _ in UNITS.values()):
            continue
        new = RENAMED.get(name, name)
        if name in UNITS:
            unit, in_px, in_other_unit = UNITS[name]
            new = in_px if leaves.get(unit, "px") == "px" else in_other_unit
        *tables, key = new.removeprefix(prefix).split(".")
        table = current
        for each in tables:
            table = table.setdefault(each, {})
        table[key] = value
    return current


def _leaves(data: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, Any]]:
    """Yield the dotted names and values of all options in nested tables."""
    for key, value in data.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value
