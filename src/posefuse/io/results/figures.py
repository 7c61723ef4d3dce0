"""Write everybody's animated figure beside a result."""

from collections.abc import Sequence
from pathlib import Path

from posefuse.io.results import bvh, gltf
from posefuse.io.results.clips import clip_of
from posefuse.io.results.names import safe_names
from posefuse.model.reconstruction import Reconstruction
from posefuse.progress import Progress


def has_figures(result: Reconstruction) -> bool:
    """Whether articulated bodies were fitted that figures can be made of."""
    poses = result.poses
    if poses is None or result.skeleton.tree is None or "model" not in result.layers:
        return False
    return (poses.segments, poses.bones, poses.shape_names) == result.skeleton.body_names


def write_figures(
    result: Reconstruction, people: Sequence[str], folder: Path, progress: Progress | None = None
) -> tuple[list[str], list[str]]:
    """Write a BVH and a glb a person; nothing where no bodies were fitted.

    Args:
        result: what to write.
        people: whom of it.
        folder: where.
        progress: told how far the work is.

    Returns:
        The names of the files, and what these cannot say, in sentences.
    """
    files: list[str] = []
    notes: list[str] = []
    for person, stem in zip(people, safe_names(people), strict=True) if has_figures(result) else ():
        clip = clip_of(result, person)
        if not clip.life.there.any():
            notes.append(f"{person} stands in no frame: there is no BVH or glTF of {person}.")
            continue
        for form, end in ((bvh, "bvh"), (gltf, "glb")):
            notes += form.write_clip(result, clip, folder / f"{stem}.{end}", progress)
            files.append(f"{stem}.{end}")
    return files, list(dict.fromkeys(notes))
