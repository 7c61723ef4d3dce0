"""Write the animation skeletons of all people into the folder of a result."""

from pathlib import Path

from posefuse.errors import ResultError
from posefuse.io.results import bvh, gltf
from posefuse.io.results.clips import clip_of
from posefuse.model.reconstruction import Reconstruction


def has_figures(result: Reconstruction) -> bool:
    """Return whether a result has articulated poses that can be written as animation skeletons."""
    poses = result.poses
    if poses is None or result.skeleton.tree is None or "model" not in result.layers:
        return False
    return (poses.segments, poses.bones, poses.shape_names) == result.skeleton.body_names


def write_figure(person: str, stem: str, result: Reconstruction, folder: Path) -> tuple[list[str], list[str]]:
    """Write a BVH and a glb file of a person.

    Args:
        person: name of the person.
        stem: name of the files without their endings.
        result: the result to write, for which :func:`has_figures` is true.
        folder: output folder.

    Returns:
        The names of the files, and notes on what they do not contain.
    """
    clip = clip_of(result, person)
    if not clip.presence.present.any():
        return [], [f"{person} is absent in all frames: no BVH or glTF was written for {person}."]
    files: list[str] = []
    notes: list[str] = []
    for form, end in ((bvh, "bvh"), (gltf, "glb")):
        try:
            notes += form.write_clip(result, clip, folder / f"{stem}.{end}")
        except ResultError as error:
            notes.append(f"{stem}.{end} was not written: {error}")
            continue
        files.append(f"{stem}.{end}")
    return files, list(dict.fromkeys(notes))
