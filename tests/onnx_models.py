"""Small ONNX models, written without the package onnx: protocol buffers are lengths and numbers."""

import struct
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

_TYPES = {np.dtype(np.float32): 1, np.dtype(np.int64): 7}


def save_model(
    path: Path,
    nodes: Sequence[bytes],
    inputs: Mapping[str, Sequence[int | str]],
    outputs: Mapping[str, Sequence[int | str]],
    constants: Mapping[str, np.ndarray],
) -> Path:
    """Write a model of float32 inputs and outputs."""
    graph = b"".join(_field(1, node) for node in nodes) + _field(2, b"test")
    graph += b"".join(_field(5, _tensor(name, array)) for name, array in constants.items())
    graph += b"".join(_field(11, _value(name, shape)) for name, shape in inputs.items())
    graph += b"".join(_field(12, _value(name, shape)) for name, shape in outputs.items())
    path.write_bytes(_number(1, 8) + _field(7, graph) + _field(8, _field(1, b"") + _number(2, 13)))
    return path


def node(operator: str, inputs: Sequence[str], output: str, **attributes: int | Sequence[int]) -> bytes:
    """Return an operator with one output."""
    text = b"".join(_field(1, name.encode()) for name in inputs) + _field(2, output.encode())
    text += _field(4, operator.encode())
    for name, value in attributes.items():
        body = _field(1, name.encode())
        if isinstance(value, int):
            body += _number(3, value) + _number(20, 2)
        else:
            body += b"".join(_number(8, each) for each in value) + _number(20, 7)
        text += _field(5, body)
    return text


def brightest_point(path: Path, keypoints: int, size_px: tuple[int, int] = (192, 256)) -> Path:
    """Write a model with the inputs and outputs of RTMPose: all keypoints are at the brightest column and row."""
    width, height = size_px
    nodes = []
    for axis in ("x", "y"):
        nodes += [
            node("ReduceMax", ["input"], f"line_{axis}", axes=[1, 2 if axis == "x" else 3], keepdims=0),
            node("MatMul", [f"line_{axis}", f"twice_{axis}"], f"fine_{axis}"),
            node("Reshape", [f"fine_{axis}", f"one_{axis}"], f"row_{axis}"),
            node("Expand", [f"row_{axis}", f"all_{axis}"], f"simcc_{axis}"),
        ]
    constants = {}
    for axis, length in (("x", width), ("y", height)):
        twice = np.zeros((length, 2 * length), dtype=np.float32)
        twice[np.arange(length), 2 * np.arange(length)] = 1.0
        constants[f"twice_{axis}"] = twice
        constants[f"one_{axis}"] = np.array([1, 1, 2 * length])
        constants[f"all_{axis}"] = np.array([1, keypoints, 2 * length])
    outputs = {"simcc_x": (1, keypoints, 2 * width), "simcc_y": (1, keypoints, 2 * height)}
    return save_model(path, nodes, {"input": (1, 3, height, width)}, outputs, constants)


def scaled_constants(path: Path, outputs: Mapping[str, np.ndarray], size_px: tuple[int, int] = (640, 640)) -> Path:
    """Write a model whose outputs are constants times the largest value of the image divided by 255.

    With an image that contains white, the constants come out; with a black image, zeros.
    """
    width, height = size_px
    nodes = [
        node("ReduceMax", ["input"], "largest", keepdims=0),
        node("Mul", ["largest", "inverse"], "share"),
        *(node("Mul", [f"constant_{name}", "share"], name) for name in outputs),
    ]
    constants = {f"constant_{name}": array.astype(np.float32) for name, array in outputs.items()}
    constants["inverse"] = np.float32(1 / 255).reshape(())
    shapes = {name: array.shape for name, array in outputs.items()}
    return save_model(path, nodes, {"input": (1, 3, height, width)}, shapes, constants)


def _varint(value: int) -> bytes:
    value &= (1 << 64) - 1
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    return bytes([*out, value])


def _number(number: int, value: int) -> bytes:
    return _varint(number << 3) + _varint(value)


def _field(number: int, content: bytes) -> bytes:
    return _varint(number << 3 | 2) + _varint(len(content)) + content


def _tensor(name: str, array: np.ndarray) -> bytes:
    dims = b"".join(_number(1, n) for n in array.shape)
    data = array.tobytes()
    return dims + _number(2, _TYPES[array.dtype]) + _field(8, name.encode()) + _field(9, data)


def _value(name: str, shape: Sequence[int | str]) -> bytes:
    dims = b"".join(_field(1, _number(1, n) if isinstance(n, int) else _field(2, str(n).encode())) for n in shape)
    tensor = _number(1, 1) + _field(2, dims)
    return _field(1, name.encode()) + _field(2, _field(1, tensor))


assert struct.pack("<q", 7) == np.array([7]).tobytes(), "raw data are little-endian"
