"""Import the animation skeletons of a result into Blender, and save a Blender file.

Run it in Blender: `blender --background --python blender_import.py -- RESULT people.blend`. Or run it in Python with
Blender's package: `pip install bpy`, then `python blender_import.py RESULT people.blend`. posefuse is not needed there.
RESULT is a folder with the .bvh or .glb files that `posefuse reconstruct --bodies fit` writes.
"""

import sys
from pathlib import Path

import bpy

CENTIMETERS = 0.01
"""BVH files of posefuse are in centimeters, Blender's unit is the meter."""


def import_people(folder: Path) -> None:
    """Import every person: glTF where there is a file, otherwise BVH."""
    for bvh in sorted(folder.glob("*.bvh")):
        glb = bvh.with_suffix(".glb")
        if glb.exists():
            bpy.ops.import_scene.gltf(filepath=str(glb))
        else:
            bpy.ops.import_anim.bvh(filepath=str(bvh), global_scale=CENTIMETERS, update_scene_fps=True)


def main() -> None:
    """Import the people of a result and report what Blender has."""
    arguments = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    folder, target = map(Path, arguments)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    import_people(folder)
    scene = bpy.context.scene
    for armature in (each for each in bpy.data.objects if each.type == "ARMATURE"):
        first, last = armature.animation_data.action.frame_range
        scene.frame_start, scene.frame_end = round(first), round(last)
        scene.frame_set(round(first))
        heads = [armature.matrix_world @ bone.head for bone in armature.pose.bones]
        height = max(head.z for head in heads) - min(head.z for head in heads)
        print(f"{armature.name}: {len(heads)} bones, frames {first:g} to {last:g}, {height:.2f} m high")
    bpy.ops.wm.save_as_mainfile(filepath=str(target.resolve()))


if __name__ == "__main__":
    main()
