"""Several people with MediaPipe: the parts of an image, people seen in two of them, and a composed picture."""

import numpy as np
import pytest

from posefuse.detection.open import open_detector
from posefuse.detection.workers.mediapipe_people import (
    different_people,
    parts_of,
    share_cut,
    shared_area,
    small_parts_of,
    square_around,
)
from posefuse.io.videos.reader import open_video
from tests.installed import installed_home


def person(left, top, width=100.0, height=300.0):
    """Return 33 keypoints that fill a box."""
    across, down = np.meshgrid(np.linspace(0, 1, 3), np.linspace(0, 1, 11))
    return np.stack([left + width * across.ravel(), top + height * down.ravel(), np.ones(33)], axis=1)


@pytest.mark.parametrize("size", [(1080, 1920), (1920, 1080), (500, 500), (480, 640), (1000, 1060), (200, 3000)])
def test_every_square_of_half_the_side_is_inside_a_part(size):
    height, width = size
    parts = parts_of(height, width)
    assert parts[0] == (0, 0, width, height)
    half = min(size) // 2
    for start in range(0, max(size) - half + 1, 7):
        left, top = (start, 0) if width >= height else (0, start)
        inside = [
            x <= left and y <= top and left + half <= x + w and top + half <= y + h for x, y, w, h in parts[1:] or parts
        ]
        assert any(inside)
    assert len({part[2:] for part in parts[1:]}) <= 1
    assert all(x >= 0 and x + w <= width and y >= 0 and y + h <= height for x, y, w, h in parts)


def test_a_person_of_two_parts_and_legs_within_a_person_are_one():
    whole, again = person(0, 0), person(4, 6)
    legs, neighbor = person(20, 180, 60, 120), person(90, 10)
    assert shared_area(whole, legs) == pytest.approx(1.0)
    kept = different_people([legs, again, neighbor, whole], [0.3, 0.8, 0.7, 0.9])
    assert [rows[0, 0] for rows in kept] == [0.0, 90.0]
    assert different_people([], []) == []


def test_a_person_that_a_part_cuts_is_recognized():
    part, shape = (0, 0, 1000, 1000), (1000, 1900, 3)
    assert share_cut(person(100, 100), part, shape) == 0.0
    assert share_cut(person(950, 100), part, shape) == pytest.approx(2 / 3)
    # Beyond the image, no part sees more.
    assert share_cut(person(-50, 100), part, shape) == 0.0


def test_three_people_are_found_where_one_at_a_time_is(shared_data, monkeypatch):
    monkeypatch.setenv("POSEFUSE_HOME", str(installed_home("mediapipe")))
    folder = shared_data("pose2sim_videos") / "videos"
    views = [
        [image.rgb[:1920:2, :1080:2] for image, _ in zip(open_video(folder / name).images(), range(2), strict=False)]
        for name in ("cam01.mp4", "cam02.mp4", "cam03.mp4")
    ]
    single = open_detector("mediapipe:pose")
    expected = []
    for images in views:
        single.reset()
        expected.append(single.detect(images))
    single.close()
    several = open_detector("mediapipe:people")
    assert several.several_people
    pictures = [np.concatenate([images[i] for images in views], axis=1) for i in range(2)]
    found = several.detect(pictures)
    several.reset()
    again = several.detect(pictures[:1])
    several.close()
    np.testing.assert_array_equal(found[0].keypoints_px, again[0].keypoints_px)
    for i, image in enumerate(found):
        # A bystander is in the background of the second view.
        assert len(image) == 4
        for v in range(3):
            alone = expected[v][i].keypoints_px[0] + [540 * v, 0]
            errors = np.median(np.hypot(*np.moveaxis(image.keypoints_px - alone, 2, 0)), axis=1)
            assert errors.min() < 0.03 * np.ptp(alone[:, 1])


@pytest.mark.parametrize("size", [(1080, 1920), (500, 500), (480, 640)])
def test_small_parts_cover_the_image_and_squares_lie_in_it(size, rng):
    height, width = size
    covered = np.zeros(size, dtype=bool)
    for left, top, w, h in small_parts_of(height, width):
        assert w == h == min(size) // 2
        assert left + w <= width
        assert top + h <= height
        covered[top : top + h, left : left + w] = True
    assert covered.all()
    for left, top in rng.uniform([-50, -200], [width, height], (20, 2)):
        x, y, side, _ = square_around(person(left, top), height, width)
        assert 0 <= x <= width - side
        assert 0 <= y <= height - side


def test_small_people_are_found_and_followed_until_the_next_search(shared_data, monkeypatch):
    """Two people of 20 % of the image height."""
    monkeypatch.setenv("POSEFUSE_HOME", str(installed_home("mediapipe")))
    folder = shared_data("pose2sim_videos") / "videos"
    picture = np.full((1080, 1920, 3), 120, dtype=np.uint8)
    pictures = [picture.copy() for _ in range(4)]
    for name, left, top in (("cam01.mp4", 300, 100), ("cam04.mp4", 1300, 450)):
        for each, image in zip(pictures, open_video(folder / name).images(), strict=False):
            small = image.rgb[: 4 * (image.rgb.shape[0] // 4), : 4 * (image.rgb.shape[1] // 4)]
            small = small.reshape(small.shape[0] // 4, 4, small.shape[1] // 4, 4, 3).mean(axis=(1, 3))
            each[top : top + small.shape[0], left : left + small.shape[1]] = small.round()
    several = open_detector("mediapipe:people")
    found = several.detect(pictures)
    several.close()
    assert [len(image) for image in found] == [2] * 4
