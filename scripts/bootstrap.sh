#!/bin/sh
# Make .venv with everything that uv.lock names. Usage: bootstrap.sh [extra arguments of uv sync]
# Needs Python 3.11 to 3.13; fetches uv into .venv if the machine has none. Nothing outside .venv is touched.
set -eu
cd "$(dirname "$0")/.."

find_python() {
    for candidate in "${PYTHON:-python3}" python3.13 python3.12 python3.11; do
        if command -v "$candidate" >/dev/null 2>&1 &&
            "$candidate" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null; then
            echo "$candidate"
            return
        fi
    done
    echo "posefuse needs Python 3.11, 3.12 or 3.13; python3 here is $(python3 --version 2>&1 || true)." >&2
    echo "Install one, or name it: make PYTHON=/path/to/python3.12 ..." >&2
    exit 1
}

if [ ! -x .venv/bin/python ]; then
    python="$(find_python)"
    "$python" -m venv .venv || {
        echo "$python could not make a virtual environment; on Debian and Ubuntu: apt install python3-venv" >&2
        exit 1
    }
fi

if command -v uv >/dev/null 2>&1; then
    uv=uv
else
    [ -x .venv/bin/uv ] || .venv/bin/python -m pip install --quiet --disable-pip-version-check uv
    uv=.venv/bin/uv
fi

# --inexact keeps uv itself, which the lock does not name.
UV_PROJECT_ENVIRONMENT=.venv UV_PYTHON_DOWNLOADS=never "$uv" sync --quiet --locked --inexact --compile-bytecode --python .venv/bin/python "$@"
