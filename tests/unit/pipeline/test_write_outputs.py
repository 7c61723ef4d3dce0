"""Formats that are written beside a result."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse import Options
from posefuse.errors import OptionsError
from posefuse.pipeline.write_outputs import require_known_formats, require_possible_formats
from posefuse.synthetic.options import SceneOptions
from posefuse.synthetic.scenes import simulate

SCENE = simulate(SceneOptions(duration_s=0.5, cameras=2))


def test_unknown_formats_are_refused():
    require_known_formats(("npz",))
    with pytest.raises(OptionsError, match=r"`also=\['npx'\]`: .* Did you mean 'npz'"):
        require_known_formats(("npx",))


def test_formats_are_refused_by_what_the_options_leave():
    """All cameras and frames have 3D points at regular times; one camera or frames far apart do not."""
    also = ("freemocap", "opensim")
    require_possible_formats(also, SCENE.rig, SCENE.detections, Options())
    with pytest.raises(OptionsError, match="`also`: freemocap needs 3D points"):
        require_possible_formats(also, SCENE.rig, SCENE.detections, Options(cameras=SCENE.rig.names[:1]))
    numbers = np.array(SCENE.detections.frame_numbers)
    numbers[-1] += 100_000
    far = replace(SCENE.detections, frame_numbers=numbers)
    with pytest.raises(OptionsError, match="would need 100015 rows for 15 frames"):
        require_possible_formats(also, SCENE.rig, far, Options())
    require_possible_formats((), SCENE.rig, far, Options())
