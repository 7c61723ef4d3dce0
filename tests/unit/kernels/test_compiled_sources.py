"""Caches of kernels are invalid once any kernel's source changed."""

import os
import subprocess
import sys

from posefuse.kernels import compiled_sources
from posefuse.kernels.compiled_sources import digest, require_all_sources
from posefuse.kernels.jit import kernel

PROGRAM = """
import sys
sys.path.insert(0, "{folder}")
from posefuse.kernels import compiled_sources
from pathlib import Path
compiled_sources._FOLDER = Path("{folder}")
from caller import twice
print(twice(3.0), sum(twice.stats.cache_hits.values()))
"""
CALLER = """
from posefuse.kernels.jit import kernel
from callee import scaled

@kernel
def twice(value):
    return scaled(value)
"""
CALLEE = """
from posefuse.kernels.jit import subroutine

@subroutine
def scaled(value):
    return {factor} * value
"""


def printed(folder, factor: float) -> list[str]:
    """Return the result of a kernel that calls a subroutine of another file, and the number of cache hits."""
    (folder / "callee.py").write_text(CALLEE.format(factor=factor))
    # Python's own cache does not notice a change within a second that keeps the size of a file.
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "cache"), "PYTHONDONTWRITEBYTECODE": "1"}
    environment.pop("NUMBA_DISABLE_JIT", None)
    program = PROGRAM.format(folder=folder)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, env=environment)
    return done.stdout.split()


def test_kernel_is_compiled_again_when_a_subroutine_in_another_file_changes(tmp_path):
    (tmp_path / "caller.py").write_text(CALLER)
    assert printed(tmp_path, 2.0) == ["6.0", "0"]
    assert printed(tmp_path, 2.0) == ["6.0", "1"]
    assert printed(tmp_path, 5.0) == ["15.0", "0"]


def test_digest_depends_on_names_and_contents(tmp_path):
    def of(files: dict[str, str]) -> str:
        digest.cache_clear()
        for path in tmp_path.rglob("*.py"):
            path.unlink()
        for name, text in files.items():
            (tmp_path / name).parent.mkdir(exist_ok=True)
            (tmp_path / name).write_text(text)
        return digest(tmp_path)

    texts = [{"a.py": "1", "b.py": "2"}, {"a.py": "1", "b.py": "3"}, {"a.py": "1", "c/b.py": "2"}, {"a.py": "1"}]
    assert len({of(each) for each in texts}) == len(texts)
    assert of(texts[0]) == of(dict(reversed(texts[0].items())))
    digest.cache_clear()


def test_stamp_of_a_kernel_holds_the_digest():
    @kernel
    def one() -> float:
        return 1.0

    assert one._cache._cache_file._source_stamp[1] == digest(compiled_sources._FOLDER)


def test_function_without_cache_is_left_alone():
    require_all_sources(len)
