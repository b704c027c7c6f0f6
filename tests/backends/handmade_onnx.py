"""ONNX files written byte by byte, so that tests need no package that writes them."""

import numpy as np

FLOAT = 1


def constant_model(inputs, output, path):
    """Write a model with float inputs (name -> shape; 0 = any size) that always answers ``output``; return ``path``."""
    values = np.asarray(output, dtype=np.float32)
    tensor = b"".join(_number(1, d) for d in values.shape) + _number(2, FLOAT) + _text(8, "answer") + _bytes(9, values.tobytes())
    node = _text(1, "answer") + _text(2, "output") + _text(4, "Identity")
    graph = _bytes(1, node) + _text(2, "graph") + _bytes(5, tensor)
    graph += b"".join(_bytes(11, _value(name, shape)) for name, shape in inputs.items()) + _bytes(12, _value("output", values.shape))
    path.write_bytes(_number(1, 8) + _bytes(7, graph) + _bytes(8, _number(2, 13)))
    return path


def _value(name, shape):
    dims = b"".join(_bytes(1, _number(1, d) if d else _text(2, "any")) for d in shape)
    return _text(1, name) + _bytes(2, _bytes(1, _number(1, FLOAT) + _bytes(2, dims)))


def _varint(value):
    out = b""
    while value > 127:
        out, value = out + bytes([value & 127 | 128]), value >> 7
    return out + bytes([value])


def _number(field, value):
    return _varint(field << 3) + _varint(value)


def _bytes(field, value):
    return _varint(field << 3 | 2) + _varint(len(value)) + value


def _text(field, value):
    return _bytes(field, value.encode())
