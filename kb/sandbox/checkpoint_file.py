"""A checkpoint in torch's file format, written without torch: the same bytes on every machine.

What `torch.save` writes differs from version to version. The format is a zip archive of one pickle
(protocol 2) and one member of raw little-endian numbers for each tensor.
Source: https://docs.pytorch.org/docs/stable/notes/serialization.html
"""

from __future__ import annotations

import struct
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

_FIRST_DAY = (1980, 1, 1, 0, 0, 0)  # the archive's own clock begins here


def write_checkpoint(path: Path, config: dict[str, Any], state: dict[str, np.ndarray]) -> None:
    """Write {"config": `config`, "state_dict": `state`} as a file for `torch.load`.

    `config` holds dictionaries, lists, strings, whole numbers and booleans; `state` arrays of
    float32, any shape, in C order. The pickle names nothing that `weights_only=True` refuses.
    """
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as file:
        numbers = {name: str(number) for number, name in enumerate(state)}
        tensors = b"".join(
            _of(name) + _tensor(numbers[name], value) for name, value in state.items()
        )
        state_dict = _global("collections", "OrderedDict") + b")R(" + tensors + b"u"
        held = b"}(" + _of("config") + _of(config) + _of("state_dict") + state_dict + b"u"
        _add(file, "data.pkl", b"\x80\x02" + held + b".")
        _add(file, "byteorder", b"little")
        for name, value in state.items():
            _add(file, f"data/{numbers[name]}", value.astype("<f4", order="C").tobytes())
        _add(file, "version", b"3\n")


def _add(file: zipfile.ZipFile, name: str, data: bytes) -> None:
    entry = zipfile.ZipInfo(f"archive/{name}", _FIRST_DAY)
    entry.create_system, entry.external_attr = 3, 0o644 << 16  # not the system's that writes it
    file.writestr(entry, data)


def _of(value: Any) -> bytes:
    """The pickle opcodes of a plain value."""
    if isinstance(value, bool):
        return b"\x88" if value else b"\x89"
    if isinstance(value, int):
        return b"J" + struct.pack("<i", value)
    if isinstance(value, str):
        data = value.encode("utf-8")
        return b"X" + struct.pack("<I", len(data)) + data
    if isinstance(value, dict):
        return b"}(" + b"".join(_of(key) + _of(item) for key, item in value.items()) + b"u"
    return b"](" + b"".join(_of(item) for item in value) + b"e"


def _tuple(*items: bytes) -> bytes:
    return b"(" + b"".join(items) + b"t"


def _global(module: str, name: str) -> bytes:
    return f"c{module}\n{name}\n".encode("ascii")


def _tensor(number: str, value: np.ndarray) -> bytes:
    storage = (
        _tuple(
            _of("storage"),
            _global("torch", "FloatStorage"),
            _of(number),
            _of("cpu"),
            _of(int(value.size)),
        )
        + b"Q"  # a reference to the archive's member
    )
    strides = [1]
    for size in reversed(value.shape[1:]):
        strides.insert(0, strides[0] * size)
    hooks = _global("collections", "OrderedDict") + b")R"
    return (
        _global("torch._utils", "_rebuild_tensor_v2")
        + _tuple(
            storage,
            _of(0),
            _tuple(*(_of(int(size)) for size in value.shape)),
            _tuple(*(_of(stride) for stride in strides)),
            _of(False),
            hooks,
        )
        + b"R"
    )
