"""Simulated scenes with one subject."""

import numpy as np
import pytest

from posefuse.errors import OptionsError
from posefuse.skeleton.skeletons import shipped_skeletons
from posefuse.synthetic.options import SceneOptions
from posefuse.synthetic.scenes import simulate


class TestScenes:
    @pytest.mark.parametrize("skeleton", shipped_skeletons())
    def test_every_shipped_skeleton(self, skeleton):
        scene = simulate(SceneOptions(skeleton=skeleton, duration_s=0.3, cameras=3))
        assert scene.detections.skeleton.name == skeleton
        assert np.isfinite(scene.truth.layers["measured"].points_m).all()

    def test_seed_determines_the_scene(self):
        one, same, other = (simulate(SceneOptions(duration_s=1, seed=seed)) for seed in (4, 4, 5))
        assert one.detections == same.detections
        assert one.truth == same.truth
        assert one.detections != other.detections

    @pytest.mark.parametrize("change", [{"duration_s": 0}, {"rate_hz": -1}, {"activities": ()}, {"cameras": 33}])
    def test_invalid_scenes_are_refused(self, change):
        with pytest.raises(OptionsError):
            SceneOptions(**change)
