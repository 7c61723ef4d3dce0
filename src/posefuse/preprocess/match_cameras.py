"""Match views to cameras."""

from collections.abc import Sequence
from dataclasses import replace

from posefuse.errors import MatchError, choices
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.options.options import Options
from posefuse.model.view_names import has_name, plain_name


def match_views(
    rig: CameraRig, detections: Detections, options: Options
) -> tuple[CameraRig, Detections, tuple[str, ...]]:
    """Match every view to its camera by name, or by ``options.camera_order``; never by position alone.

    A view matches a camera of the same name. Otherwise it matches the only camera whose name is equal without case,
    punctuation and the suffixes of keypoint folders (``_json``, ``_keypoints``). Otherwise it matches the only camera
    whose name is a word of the view's name, with or without ``cam`` before it (``trial1-camA`` is camera A).

    Args:
        rig: calibrated cameras.
        detections: detections of all views.
        options: options that choose, exclude or order cameras.

    Returns:
        The cameras in the order of the views, the chosen views, and notes.

    Raises:
        MatchError: if a view has no camera or several candidates.
    """
    order = options.camera_order
    rig, detections, order, left_out = _without_uncalibrated(rig, detections, options)
    names = _by_order(rig, detections, order) if order else _by_name(rig, detections.view_names)
    wanted = options.cameras or tuple(name for name in names if name not in options.exclude_camera)
    for name in (*options.cameras, *options.exclude_camera):
        rig.index(name)
        if name not in names:
            raise MatchError(f"Camera {name!r} is calibrated but has no view; the views belong to {choices(names)}.")
    if not wanted:
        raise MatchError(f"No camera is left: exclude_camera names all of {choices(names)}.")
    notes = [*left_out]
    idle = [name for name in rig.names if name not in names]
    if idle:
        notes.append(f"{len(idle)} calibrated cameras have no view and are left out: {choices(idle)}.")
    renamed = [(view, name) for view, name in zip(detections.view_names, names, strict=True) if view != name]
    if renamed:
        notes.append("Views matched to cameras: " + ", ".join(f"{view} = {name}" for view, name in renamed) + ".")
    if wanted != names:
        views = [detections.view_names[names.index(name)] for name in wanted]
        detections = detections.views(views)
    return rig.select(wanted), detections, tuple(notes)


def check_names(rig: CameraRig, view_names: Sequence[str], options: Options) -> None:
    """Raise the error of :func:`match_views` before there are detections, if views match no cameras by name.

    Args:
        rig: calibrated cameras.
        view_names: names of all views.
        options: options of the reconstruction.

    Raises:
        MatchError: if a view has no camera or several candidates.
    """
    left_out = {plain_name(name) for name in rig.left_out}
    if not options.camera_order:
        _by_name(replace(rig, left_out=()), [name for name in view_names if plain_name(name) not in left_out])


def _without_uncalibrated(
    rig: CameraRig, detections: Detections, options: Options
) -> tuple[CameraRig, Detections, tuple[str, ...], tuple[str, ...]]:
    """Drop the views of cameras that the refinement of the calibration left out.

    Returns:
        The cameras, the views, the order of the cameras without those left out, and notes.
    """
    order = options.camera_order
    left_out = {plain_name(name) for name in rig.left_out}
    rig = replace(rig, left_out=())
    cameras = order if len(order) == detections.n_views else detections.view_names
    pairs = zip(detections.view_names, cameras, strict=True)
    kept = [view for view, camera in pairs if plain_name(camera) not in left_out]
    if not kept or len(kept) == detections.n_views:
        return rig, detections, order, ()
    order = tuple(name for name in order if plain_name(name) not in left_out)
    gone = [view for view in detections.view_names if view not in kept]
    note = f"Views not used because their cameras were left out when the calibration was refined: {choices(gone)}."
    return rig, detections.views(kept), order, (note,)


def _by_order(rig: CameraRig, detections: Detections, order: tuple[str, ...]) -> tuple[str, ...]:
    if len(order) != detections.n_views or len(set(order)) != len(order):
        raise MatchError(
            f"camera_order must name one camera for each of the {detections.n_views} views "
            f"({choices(detections.view_names)}), each once; got {len(order)}: {choices(order)}."
        )
    return tuple(rig.cameras[rig.index(name)].name for name in order)


def _by_name(rig: CameraRig, view_names: Sequence[str]) -> tuple[str, ...]:
    names = []
    for view in view_names:
        exact = [name for name in rig.names if name == view]
        near = [name for name in rig.names if plain_name(name) == plain_name(view)]
        found = exact or near or [name for name in rig.names if has_name(view, name)]
        if len(found) != 1:
            problem = "matches no camera by name" if not found else f"could be any of {choices(found)}"
            raise MatchError(
                f"View {view!r} {problem}. Views: {choices(view_names)}. Cameras: {choices(rig.names)}. "
                "To match them in another way, use `camera_order`: one camera name per view, in the order of the views "
                "above."
            )
        names.append(found[0])
    if len(set(names)) != len(names):
        repeated = next(name for name in names if names.count(name) > 1)
        views = [view for view, name in zip(view_names, names, strict=True) if name == repeated]
        raise MatchError(f"Views {choices(views)} all match camera {repeated!r}. Rename them, or use `camera_order`.")
    return tuple(names)
