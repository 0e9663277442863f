"""Reads small typed JSON files of a data root; a damaged one is named in the error."""

from pathlib import Path
from typing import Any, TypeVar, overload

import msgspec

from kb.core.regular_file import NotRegular, read_regular
from kb.store.damage import unreadable

Note = TypeVar("Note")


@overload
def read_note(path: Path, kind: type[Note], *, fix: str = "") -> Note | None: ...
@overload
def read_note(path: Path, kind: Any, *, fix: str = "") -> Any: ...
def read_note(path: Path, kind: Any, *, fix: str = "") -> Any:
    """The note, None where there is none.

    Raises DamagedData for a note that can't be read; `fix`: what to do, where that is not what
    the artifact's own hint says.
    """
    try:
        return msgspec.json.decode(read_regular(path), type=kind)
    except FileNotFoundError:
        return None
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError, NotRegular) as error:
        raise unreadable(path, error, fix) from None
