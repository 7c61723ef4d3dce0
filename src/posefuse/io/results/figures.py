"""Write the animation skeletons of all people into the folder of a result."""

from collections.abc import Sequence
from pathlib import Path

from posefuse.errors import ResultError
from posefuse.io.results import bvh, gltf
from posefuse.io.results.clips import clip_of
from posefuse.io.results.names import safe_names
from posefuse.model.reconstruction import Reconstruction
from posefuse.progress import Progress


def has_figures(result: Reconstruction) -> bool:
    """Return whether a result has articulated poses that can be written as animation skeletons."""
    poses = result.poses
    if poses is None or result.skeleton.tree is None or "model" not in result.layers:
        return False
    return (poses.segments, poses.bones, poses.shape_names) == result.skeleton.body_names


def write_figures(
    result: Reconstruction, people: Sequence[str], folder: Path, progress: Progress | None = None
) -> tuple[list[str], list[str]]:
    """Write a BVH and a glb file per person; nothing if there is no fitted model.

    Args:
        result: the result to write.
        people: names of the people to write.
        folder: output folder.
        progress: receives the progress.

    Returns:
        The names of the files, and notes on what they do not contain.
    """
    files: list[str] = []
    notes: list[str] = []
    for person, stem in zip(people, safe_names(people), strict=True) if has_figures(result) else ():
        clip = clip_of(result, person)
        if not clip.presence.present.any():
            notes.append(f"{person} is absent in all frames: no BVH or glTF was written for {person}.")
            continue
        for form, end in ((bvh, "bvh"), (gltf, "glb")):
            try:
                notes += form.write_clip(result, clip, folder / f"{stem}.{end}", progress)
            except ResultError as error:
                notes.append(f"{stem}.{end} was not written: {error}")
                continue
            files.append(f"{stem}.{end}")
    return files, list(dict.fromkeys(notes))
