"""What the workers that run ONNX Runtime share."""

# ONNX Runtime is in the environment of the worker only.
# pyright: reportMissingImports=false
from __future__ import annotations

import hashlib
from typing import Any


class UsageError(Exception):
    """What a user can change; the message needs neither the type of the exception nor its place in a program."""

    for_users = True


def choose_device(asked: str) -> str:
    """Return ``cuda`` or ``cpu``."""
    import onnxruntime

    if hasattr(onnxruntime, "preload_dlls"):
        onnxruntime.preload_dlls()
    available = "CUDAExecutionProvider" in onnxruntime.get_available_providers()
    if asked == "cuda" and not available:
        raise UsageError("this ONNX Runtime has no CUDA; install the detector again with the device cuda")
    return "cuda" if available and asked != "cpu" else "cpu"


def limit_threads(threads: int) -> None:
    """Make all sessions of ONNX Runtime use a number of threads."""
    import onnxruntime

    original = onnxruntime.InferenceSession

    def session(path_or_bytes: Any, **named: Any) -> Any:
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        options.inter_op_num_threads = 1
        options.log_severity_level = 3
        return original(path_or_bytes, options, **named)

    onnxruntime.InferenceSession = session


def open_session(path: str, device: str) -> Any:
    """Return a session of ONNX Runtime."""
    import onnxruntime

    provider = "CUDAExecutionProvider" if device == "cuda" else "CPUExecutionProvider"
    return onnxruntime.InferenceSession(path, providers=[provider])


def digest(path: str) -> str:
    """Return the start of a file's SHA-256."""
    with open(path, "rb") as file:
        return hashlib.sha256(file.read()).hexdigest()[:12]
