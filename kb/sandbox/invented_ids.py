"""Makes ids and names that cannot exist on the real services.

Nobody's content can be mistaken for the sandbox's, or be requested by accident. They use the
alphabets of the real ones.

- YouTube's ids are whole bytes in base64url: 8 in the 11 characters of a video's, 16 in the 22
  behind a channel's "UC". The bits that are left over are zero, so neither ends in "x" ever.
- A playlist's "PL" is followed by 16 or 32 characters; here it is followed by 31.
- Reddit's are integers of 64 bits in base 36: none has 13 digits and begins with "z".
- Reddit's people have 3 to 20 characters, its subreddits up to 21, YouTube's handles up to 30:
  longer ones can't be registered.
- Hosts of nobody end in `.example` (RFC 2606).
"""

import base64
import random

_DIGITS = "0123456789abcdefghijklmnopqrstuvwxyz"
PEOPLE = [
    f"{first}_{second}_of_the_sandbox"
    for first in ("brisk", "quiet", "sunny", "rusty", "tidy", "mossy")
    for second in ("otter", "lantern", "anvil", "heron", "pebble")
]
OTHER_SUBREDDIT = "a_subreddit_that_is_not_there"
ELSEWHERE = f"z{'elsewhere':0>12}"  # a post in another place


def video_id(rng: random.Random) -> str:
    """An id in the form of a video's."""
    return _token(rng, 11)


def channel_id(rng: random.Random) -> str:
    """An id in the form of a channel's."""
    return "UC" + _token(rng, 22)


def playlist_id(rng: random.Random) -> str:
    """An id in the form of a playlist's."""
    return "PL" + _token(rng, 31)


def post_id(number: int, archived: bool = False) -> str:
    """The id of a post, in the order of the numbers; those of the archive come first."""
    return f"z{'0' if archived else '1'}{_base36(number):0>11}"


def comment_id(post: str, number: int) -> str:
    """The id of a post's comment; no post has the same."""
    return f"z{int(post[1]) + 3}{post[-8:]}{_base36(number):0>3}"


def person_id(rng: random.Random) -> str:
    """The id of somebody's account."""
    return f"z2{_base36(9_000 + rng.randrange(900)):0>11}"


def _base36(number: int) -> str:
    """A number in Reddit's digits."""
    digits = ""
    while number:
        number, rest = divmod(number, 36)
        digits = _DIGITS[rest] + digits
    return digits or "0"


def _token(rng: random.Random, length: int) -> str:
    return base64.urlsafe_b64encode(rng.randbytes(length)).decode()[: length - 1] + "x"
