"""MMPose files."""

import json

import posefuse
from tests import keypoint_files
from tests.example_detections import example_detections


def test_names_in_meta_info_identify_the_skeleton(tmp_path):
    given = example_detections()
    folder = keypoint_files.mmpose(given, tmp_path / "mmpose")
    animal = [f"part_{i}" for i in range(len(given.skeleton))]
    for names in (given.skeleton.keypoints, animal):
        for file in folder.glob("*.json"):
            content = json.loads(file.read_text())
            content["meta_info"] = {"keypoint_id2name": {str(i): name for i, name in enumerate(names)}}
            file.write_text(json.dumps(content))
        found = posefuse.read_detections(folder)
        assert found.skeleton.keypoints == tuple(names)
    assert found.skeleton.name == "mmpose"
