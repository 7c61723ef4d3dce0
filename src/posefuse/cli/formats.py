"""``posefuse formats``."""

from posefuse.cli.console import say, wrap_lines


def formats() -> None:
    """List the file formats that posefuse reads and writes, with their conventions."""
    from posefuse.io.calibration.registry import CALIBRATIONS
    from posefuse.io.keypoints.registry import KEYPOINTS
    from posefuse.io.results.registry import RESULTS

    for title, forms in (("Calibrations", CALIBRATIONS), ("2D keypoints", KEYPOINTS), ("Results", RESULTS)):
        say(title)
        for form in forms:
            does = " and ".join(verb for verb, can in (("read", form.reads), ("written", form.writes)) if can)
            for text, indent in ((f"{form.name} ({does}): {form.files}", 2), (form.conventions, 4)):
                for line in wrap_lines(text, indent):
                    say(line)
