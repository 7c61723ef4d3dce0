"""Videos with the detections drawn on them."""

import numpy as np

from posefuse.io.videos.reader import open_video
from posefuse.io.view_images import find_views, open_source
from posefuse.model.options.detection import DetectOptions
from posefuse.pipeline.detect import detect
from posefuse.progress import Silent
from posefuse.visualize.overlay.detected_people import draw_detections
from tests.filmed_blobs import BAR, bar_place, film, find_bars

SIZE_PX = (320, 240)


def colored(image: np.ndarray) -> np.ndarray:
    """Return where an image is neither black, gray nor white."""
    return np.ptp(image.astype(int), axis=2) > 60


def test_detections_are_drawn_at_their_images_and_times(tmp_path):
    times_s = np.array([0.0, 0.04, 0.2, 0.24, 0.6, 0.64])
    film(tmp_path / "a.mp4", times_s, people=2, size_px=SIZE_PX)
    found = detect(tmp_path, find_bars, skeleton=BAR)
    sources = [open_source(view) for view in find_views(tmp_path)]
    (path,) = draw_detections(sources, found, 1, tmp_path / "overlay", progress=Silent())
    images = list(open_video(path).images())
    np.testing.assert_allclose([image.time_s for image in images], times_s, atol=1e-4)
    for number, image in enumerate(images):
        places = colored(image.rgb)
        for person in range(2):
            left, top = bar_place(number, person)
            assert places[top : top + 6, left : left + 16].sum() > 5
        assert not places[120:200].any()


def test_only_examined_images_are_drawn(tmp_path):
    film(tmp_path / "a.mp4", 20, size_px=SIZE_PX)
    found = detect(tmp_path, find_bars, DetectOptions(every=5, start_s=0.3), skeleton=BAR)
    sources = [open_source(view) for view in find_views(tmp_path)]
    (path,) = draw_detections(sources, found, 5, tmp_path / "overlay", progress=Silent())
    images = list(open_video(path).images())
    np.testing.assert_allclose([image.time_s for image in images], [0.0, 0.2], atol=1e-4)
    left, top = bar_place(10)
    assert colored(images[0].rgb)[top : top + 6, left : left + 16].sum() > 5
