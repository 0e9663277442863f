"""Reads small typed JSON files of a data root; a damaged one is named in the error."""

from pathlib import Path
from typing import Any, TypeVar, overload

import msgspec

from kb.core.errors import DamagedData

Note = TypeVar("Note")


@overload
def read(path: Path, kind: type[Note], *, fix: str) -> Note | None: ...
@overload
def read(path: Path, kind: Any, *, fix: str) -> Any: ...
def read(path: Path, kind: Any, *, fix: str) -> Any:
    """The note, None where there is none.

    Raises DamagedData with `fix`, what to do about a note that can't be read.
    """
    try:
        return msgspec.json.decode(path.read_bytes(), type=kind)
    except FileNotFoundError:
        return None
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError, IsADirectoryError) as error:
        why = error.strerror if isinstance(error, OSError) else str(error)
        raise DamagedData(f"{path} can't be read: {why}", hint=fix) from None
