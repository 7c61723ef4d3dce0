"""MMPose files."""

import json

import posefuse
from tests import keypoint_files
from tests.example_detections import example_detections


def test_names_in_meta_info_identify_the_skeleton(tmp_path):
    original = example_detections()
    folder = keypoint_files.mmpose(original, tmp_path / "mmpose")
    animal = [f"part_{i}" for i in range(len(original.skeleton))]
    for names in (original.skeleton.keypoints, animal):
        for file in folder.glob("*.json"):
            content = json.loads(file.read_text())
            content["meta_info"] = {"keypoint_id2name": {str(i): name for i, name in enumerate(names)}}
            file.write_text(json.dumps(content))
        detections = posefuse.read_detections(folder)
        assert detections.skeleton.keypoints == tuple(names)
    assert detections.skeleton.name == "mmpose"
