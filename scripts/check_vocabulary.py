"""Check texts against the phrases that the project does not use (scripts/vocabulary.toml).

Usage: python scripts/check_vocabulary.py [--no-help-output] [FILE ...]

Without files, the check covers src, docs, benchmarks, examples, the Markdown pages of the root, and the help output of
every command. It prints one line per match and exits with code 1 if there is any.
"""

import io
import re
import subprocess
import sys
import tokenize
import tomllib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
EXEMPT = {
    "docs/glossary.md",
    "benchmarks/same_numbers.py",
    "benchmarks/same_numbers_cases.py",
    "src/posefuse/report/assets/three.min.js",
}
BUILT = ("docs/_build/", "docs/generated/", "docs/gallery/")
"""Folders that the build of the documentation writes."""
SUFFIXES = {".py", ".md", ".html", ".js", ".toml"}
CHECKED = ("src", "docs", "benchmarks", "examples", "README.md", "CONTRIBUTING.md", "CHANGELOG.md")


def load_phrases() -> dict[str, str]:
    """Return every phrase with what to write instead."""
    tables = tomllib.loads((ROOT / "scripts" / "vocabulary.toml").read_text("utf-8"))
    return {**tables["phrases"], **tables["spelling"]}


def compile_pattern(phrases: dict[str, str]) -> re.Pattern[str]:
    """Return one pattern that matches any phrase as whole words; ``*`` matches the rest of a word."""
    parts = [r"\s+".join(re.escape(word).replace(r"\*", r"\w*") for word in phrase.split()) for phrase in phrases]
    return re.compile(r"(?<![\w.`])(?:" + "|".join(parts) + r")(?![\w`(=])", re.IGNORECASE)


def texts_of(path: Path) -> Iterator[tuple[int, str]]:
    """Yield line numbers and texts of a file: strings and comments of Python, everything of other files."""
    content = path.read_text("utf-8")
    if path.suffix != ".py":
        yield 1, content
        return
    for token in tokenize.generate_tokens(io.StringIO(content).readline):
        if token.type in (tokenize.STRING, tokenize.COMMENT) or token.type == getattr(tokenize, "FSTRING_MIDDLE", -1):
            yield token.start[0], token.string


def find_matches(name: str, texts: Iterator[tuple[int, str]], pattern: re.Pattern[str]) -> list[str]:
    """Return one line per match: place, phrase and its sentence."""
    rows = []
    for first, text in texts:
        for match in pattern.finditer(text):
            line = first + text.count("\n", 0, match.start())
            around = " ".join(text[max(match.start() - 30, 0) : match.end() + 30].split())
            rows.append(f"{name}:{line}: {' '.join(match.group().split())!r} in ...{around}...")
    return rows


def help_texts() -> Iterator[tuple[str, str]]:
    """Yield the name and the complete help output of every command."""
    names = subprocess.run([sys.executable, "-m", "posefuse", "--help"], capture_output=True, text=True, check=True)
    yield "posefuse --help", names.stdout
    for name in sorted(set(re.findall(r"^  ([a-z][a-z-]+)  ", names.stdout, re.MULTILINE))):
        flag = "--help-all"
        shown = subprocess.run(
            [sys.executable, "-m", "posefuse", name, flag], capture_output=True, text=True, check=True
        )
        yield f"posefuse {name} {flag}", shown.stdout


def checked_files() -> list[Path]:
    """Return the files that the check covers."""
    paths = [path for top in CHECKED for path in ([ROOT / top] if (ROOT / top).is_file() else (ROOT / top).rglob("*"))]
    names = {
        path: path.relative_to(ROOT) for path in paths if path.suffix in SUFFIXES and not path.name.endswith(".min.js")
    }
    # Environments of the peers in benchmarks/ hold other programs' files.
    return sorted(
        p
        for p, name in names.items()
        if name.as_posix() not in EXEMPT and ".venv" not in name.parts and not name.as_posix().startswith(BUILT)
    )


def main(arguments: list[str]) -> int:
    """Print every match; return 1 if there is any."""
    pattern = compile_pattern(load_phrases())
    files = [Path(name) for name in arguments if not name.startswith("--")]
    rows = []
    for path in files or checked_files():
        rows += find_matches(
            str(path.relative_to(ROOT) if path.is_relative_to(ROOT) else path), texts_of(path), pattern
        )
    if not files and "--no-help-output" not in arguments:
        for name, text in help_texts():
            rows += find_matches(name, iter([(1, text)]), pattern)
    print("\n".join(rows) if rows else "The vocabulary check found nothing.")
    return 1 if rows else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
