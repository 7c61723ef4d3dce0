"""The head of a report: name and size of the recording, and the verdict with what to do next."""

from html import escape

from posefuse.model.reconstruction import Reconstruction
from posefuse.report.messages import message_html
from posefuse.report.verdict import ResultVerdict
from posefuse.skeleton.subject_words import count_subjects

_LABELS = {"good": ("✓", "Good"), "check": ("!", "Check"), "poor": ("✗", "Poor")}


def subjects_of(result: Reconstruction) -> str:
    """Return the number of people, animals or other subjects."""
    return count_subjects(len(result.person_ids), result.skeleton)


def page_title(result: Reconstruction, name: str) -> str:
    """Return the name of a recording, or what it shows if it has none."""
    return name or f"{subjects_of(result)}, {result.skeleton.name}"


def facts_line(result: Reconstruction) -> str:
    """Return the size of the recording as HTML: duration, rate, cameras, subjects and keypoints."""
    n = len(result.rig)
    facts = [f"{result.n_frames} frames"]
    if result.rate_hz:
        facts = [format_duration(result.n_frames / result.rate_hz), f"{result.rate_hz:g} Hz", *facts]
    facts += ["1 camera" if n == 1 else f"{n} cameras", subjects_of(result)]
    facts.append(f"{len(result.skeleton)} keypoints ({result.skeleton.name})")
    return "".join(f"<li>{escape(fact)}</li>" for fact in facts)


def format_duration(seconds: float) -> str:
    """Return a duration as text, such as ``1.7 s`` or ``10 min 5 s``."""
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if rest else f"{minutes} min"


def verdict_box(verdict: ResultVerdict) -> str:
    """Return the verdict as HTML: a word with an icon, the reason, and what to do next."""
    icon, label = _LABELS[verdict.level]
    following = verdict.remedy or "Nothing to repair. The highlights list what stands out."
    return (
        f'<div class="verdict {verdict.level}" id="verdict"><p class="badge"><span aria-hidden="true">{icon}</span> '
        f"{label}</p><div><p>{message_html(verdict.sentence)}</p>"
        f'<p class="next"><b>Next:</b> {message_html(following)} <a href="#highlights">Highlights</a></p></div></div>'
    )
