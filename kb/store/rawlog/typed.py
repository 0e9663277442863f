"""Raw lines decoded into a reader's own type: the few fields that it looks at."""

from __future__ import annotations

from typing import Any

import msgspec

from kb.store.rawlog import rawlog
from kb.store.rawlog.rawlog import Envelope


def decode(decoder: msgspec.json.Decoder[Any], line: bytes) -> Envelope:
    """The envelope of a line, whose answer is of the decoder's type; of another form, in full.

    Raises DamagedData for a line that is no envelope.
    """
    try:
        envelope: Envelope = decoder.decode(line)
    except (msgspec.DecodeError, UnicodeDecodeError):
        return rawlog.decode(line)
    return envelope
