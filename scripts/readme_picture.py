"""Write the animation at the top of the README: ``readme_picture.py DATA``.

It reconstructs the demo recording of Pose2Sim (BSD-3-Clause) and photographs the report page frame by frame: the four
videos with the skeleton on them, and the scene, which turns slowly. ``DATA`` is a folder with the keypoints
``pose2sim/balancing_one_person/pose``, the calibration ``pose2sim/calibration/Calib.qca.txt`` and the videos
``pose2sim_videos/videos``. Needs Chromium, playwright and Pillow.
"""

import argparse
import io
import math
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont
from playwright.sync_api import Page, sync_playwright

OUTPUT = Path(__file__).parent.parent / "docs" / "images" / "posefuse.webp"
FRAMES = 100
"""Frames of the recording: 60 per second."""
SHOWN, DURATION_MS = 90, 50
"""Images of the loop, which plays at half speed, forward and backward, and the duration of each."""
FIRST = 18
"""The image that the loop starts with, which is shown where nothing moves."""
PANE, GAP, SCENE = (200, 266), 4, (552, 536)
"""Sizes in pixels: of a video, between two of them, and of the scene."""
CROPS = {
    "cam_01": (0.04, 0.10, 0.96),
    "cam_02": (0.11, 0.08, 0.85),
    "cam_03": (0.00, 0.14, 0.86),
    "cam_04": (0.08, 0.13, 0.92),
}
"""What is shown of each video: left, top and width, as shares of its width and height."""
START, WIDER, TURN, TILT = (-0.88, -0.05), -240.0, 0.28, 0.02
MARGIN = 32
"""Pixels above and below the scene that are cut off, with its labels."""
_GRAPHICS = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")
_RADIANS_PER_PX = 0.008
_STYLE = f"""body > * {{ visibility: hidden; }} #sections {{ display: none; }}
#scene, #film {{ position: fixed !important; z-index: 99; top: 0; visibility: visible; margin: 0; }}
#scene {{ left: 0; width: {SCENE[0]}px; height: {SCENE[1] + 2 * MARGIN}px !important; }}
#scene {{ border: 0 !important; border-radius: 0 !important; }}
#film {{ left: 600px; width: 560px; background: #000; }}
#video-frame {{ max-width: none !important; }}"""


def main() -> None:
    """Reconstruct, take the pictures, and write the animation."""
    parser = argparse.ArgumentParser(description="Write the animation at the top of the README.")
    parser.add_argument("data", type=Path)
    parser.add_argument("--output", type=Path, default=OUTPUT)
    parser.add_argument("--theme", choices=["light", "dark"], default="light")
    parser.add_argument("--quality", type=int, default=74)
    parser.add_argument("--images", type=Path, help="folder for the single images, as PNG")
    request = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        report = _reconstruct(request.data, Path(folder))
        images = _photograph(report, request.theme)
    images = images[FIRST:] + images[:FIRST]
    if request.images:
        request.images.mkdir(parents=True, exist_ok=True)
        for n, image in enumerate(images):
            image.save(request.images / f"{n:03d}.png")
    _write(images, request.output, request.quality)
    print(f"{request.output}: {len(images)} images, {request.output.stat().st_size} bytes")


def _reconstruct(data: Path, folder: Path) -> Path:
    recording = data / "pose2sim" / "balancing_one_person"
    keypoints = ["--keypoints", str(recording / "pose"), "--rate-hz", "60", "--up", "z", "--people", "one"]
    # Two cameras of the recording are 12 and 23 px off; the person adjusts them.
    original, refined = data / "pose2sim" / "calibration" / "Calib.qca.txt", folder / "refined.toml"
    _posefuse("refine-calibration", recording, "--calibration", original, *keypoints, "--output", refined)
    # The treadmill on which the person stands is 5 cm above the calibration's floor.
    floor = ["--align.floor-points-m", *map(str, (0, 0, 0.05, 1, 0, 0.05, 0, 1, 0.05))]
    output = folder / "Balancing"
    _posefuse("reconstruct", recording, "--calibration", refined, *keypoints, *floor, "--output", output)
    _posefuse("report", output, "--video", data / "pose2sim_videos" / "videos", "--overwrite")
    return output / "report.html"


def _posefuse(*arguments: object) -> None:
    subprocess.run([sys.executable, "-m", "posefuse", *map(str, arguments)], check=True)


def _photograph(report: Path, theme: str) -> list[Image.Image]:
    browser = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    with sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=browser, args=list(_GRAPHICS))
        page = opened.new_page(
            viewport={"width": 1200, "height": 900},
            device_scale_factor=2,
            color_scheme="dark" if theme == "dark" else "light",
        )
        page.goto(report.as_uri())
        page.wait_for_function("document.querySelector('#keypoint-errors .js-plotly-plot')", timeout=120_000)
        page.add_style_tag(content=_STYLE)
        scenes = _scenes(page)
        films = {name: _films(page, number, crop) for number, (name, crop) in enumerate(CROPS.items())}
        opened.close()
    paper = (20, 23, 26) if theme == "dark" else (255, 255, 255)
    return [_compose(paper, scene, films, _frame(n)) for n, scene in enumerate(scenes)]


def _phase(n: int) -> float:
    return 2 * math.pi * n / SHOWN


def _frame(n: int) -> int:
    """Return the frame of an image of the loop: there and back, slower where the direction changes."""
    x = n / SHOWN * 2
    share = x if x <= 1 else 2 - x
    eased = 0.6 * share + 0.4 * share * share * (3 - 2 * share)
    return round((FRAMES - 1) * eased)


def _show(page: Page, frame: int) -> None:
    page.evaluate(
        "(f) => { const s = document.getElementById('scrub'); s.value = f; s.dispatchEvent(new Event('input')); }",
        frame,
    )


def _settle(page: Page) -> None:
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done())))")


def _image(page: Page, clip: tuple[float, float, float, float], size: tuple[int, int]) -> Image.Image:
    x, y, width, height = clip
    content = page.screenshot(clip={"x": x, "y": y, "width": width, "height": height})
    return Image.open(io.BytesIO(content)).convert("RGB").resize(size, Image.Resampling.LANCZOS)


def _scenes(page: Page) -> list[Image.Image]:
    """Return the scene of every image of the loop, turned by dragging it as a user does."""
    page.evaluate("() => dispatchEvent(new Event('resize'))")
    page.mouse.move(5, 60)
    page.mouse.wheel(0, WIDER)
    page.mouse.down()
    images = []
    for n in range(SHOWN):
        turn, tilt = START[0] + TURN * math.sin(_phase(n)), START[1] + TILT * math.cos(_phase(n))
        page.mouse.move(5 - turn / _RADIANS_PER_PX, 60 + tilt / _RADIANS_PER_PX)
        _show(page, _frame(n))
        _settle(page)
        images.append(_image(page, (0, MARGIN, *SCENE), SCENE))
    page.mouse.up()
    return images


def _films(page: Page, number: int, crop: tuple[float, float, float]) -> dict[int, Image.Image]:
    """Return the needed frames of a video with the skeleton; what does not move is the same in all of them."""
    left, top, share = crop
    page.add_style_tag(content=f"#video-frame {{ width: {PANE[0] / share}px !important; }}")
    page.locator("#film-cameras button").nth(number).click()
    page.wait_for_function("document.getElementById('video').readyState >= 2")
    frame = page.locator("#video-frame").bounding_box()
    clip = (frame["x"] + left * frame["width"], frame["y"] + top * frame["height"], *PANE)
    images = {}
    for f in sorted({_frame(n) for n in range(SHOWN)}):
        _show(page, f)
        page.wait_for_function("!document.getElementById('video').seeking")
        _settle(page)
        page.wait_for_timeout(60)
        images[f] = _image(page, clip, PANE)
    return _calm(images)


def _calm(images: dict[int, Image.Image]) -> dict[int, Image.Image]:
    """Replace what differs little from the median of the images by the median, which saves most of the size."""
    stack = np.stack([np.asarray(image) for image in images.values()]).astype(np.int16)
    still = np.median(stack, axis=0).astype(np.int16)
    calm = {}
    for f, image in zip(images, stack, strict=True):
        moved = Image.fromarray(np.uint8(255 * (np.abs(image - still).max(axis=-1) > 20)))
        share = np.asarray(moved.resize((PANE[0] // 4, PANE[1] // 4), Image.Resampling.BOX), dtype=float) / 255
        wide = Image.fromarray(np.uint8(255 * (share > 0.12))).resize(PANE, Image.Resampling.BILINEAR)
        weight = np.asarray(wide, dtype=float)[..., None] / 255
        calm[f] = Image.fromarray(np.uint8(np.round(weight * image + (1 - weight) * still)))
    return calm


def _compose(
    paper: tuple[int, int, int], scene: Image.Image, films: dict[str, dict[int, Image.Image]], frame: int
) -> Image.Image:
    image = Image.new("RGB", (2 * PANE[0] + 2 * GAP + SCENE[0], SCENE[1]), paper)
    ink, font = ImageDraw.Draw(image), ImageFont.load_default(size=12)
    for number, (name, pictures) in enumerate(films.items()):
        corner = (number % 2 * (PANE[0] + GAP), number // 2 * (PANE[1] + GAP))
        image.paste(pictures[frame], corner)
        ink.text(
            (corner[0] + 7, corner[1] + PANE[1] - 20),
            name,
            (255, 255, 255),
            font,
            stroke_width=1,
            stroke_fill=(0, 0, 0),
        )
    image.paste(scene, (2 * (PANE[0] + GAP), 0))
    return image


def _write(images: list[Image.Image], output: Path, quality: int) -> None:
    images[0].save(
        output, save_all=True, append_images=images[1:], duration=DURATION_MS, loop=0, quality=quality, method=4
    )


if __name__ == "__main__":
    main()
