"""Replaces e-mail addresses, IP addresses and telephone numbers in texts by placeholders.

What looks like one and is not stays: seeds and counts (digits without separators), coordinates,
dates and times, numbers in groups of thousands, versions such as 1.16.210.54, ISBNs. A number that
may be either is decided by the words before it, else left as it is.
"""

import ipaddress
import re
from collections import Counter

EMAIL, IP, PHONE = "[email]", "[ip]", "[phone]"

_EMAIL = re.compile(
    r"(?<![\w.+%-])[\w+%-]+(?:\.[\w+%-]+)*@(?:[^\W_](?:[\w-]*[^\W_])?\.)+[^\W\d_]{2,24}(?![\w-])"
)
# What a text without has no number that counts: most have none.
_MAYBE = re.compile(
    r"[0-9:+](?:(?<=[0-9])[0-9 .()\u00a0\u202f\-\u2010-\u2013]{5}|(?<=:)[0-9a-fA-F]*:|(?<=\+)[0-9])"
)
_OCTET = r"(?:25[0-5]|2[0-4]\d|1\d\d|[1-9]?\d)"
_IP4 = rf"{_OCTET}(?:\.{_OCTET}){{3}}"
_ADDRESS = re.compile(
    rf"(?<![\w.:-])(?:(?P<four>{_IP4})(?![\d-]|\.\d)"
    r"|(?P<six>(?:[\da-fA-F]{1,4}|:):[\da-fA-F:]*[\da-fA-F:](?:\d*(?:\.\d+){3})?)(?![\w:]))"
)
_GAP = r"[ .\u00a0\u202f\-\u2010\u2011\u2013]"
_NUMBER = re.compile(
    rf"(?<![\w/=#&$€£~^*.:,@+\-])(?:\+\d(?:{_GAP}?\(?\d+\)?)*|\(\+?\d{{1,5}}\)(?:{_GAP}?\d+)+"
    rf"|\d+(?:{_GAP}\(?\d+\)?)+)(?![\w:/%]|[.,]\d)"
)
_NEAR = 40  # characters before a number that tell what it is
_IS_IP = re.compile(
    r"\b(?:ip|ips|ipv4|server|host|address|addr|dns|ping|connect|join|localhost)\b[^.!?\n]*$",
    re.IGNORECASE,
)
_IS_VERSION = re.compile(
    r"(?:\b(?:version|versions|ver|v|beta|alpha|preview|build|release|released|update|patch|bedrock"
    r"|edition|snapshot|since|client|chapter|section)\b\W*(?:\w+\W+){0,2}|\bv)$",
    re.IGNORECASE,
)
_IS_PHONE = re.compile(
    r"\b(?:phone|telephone|tel|mobile|cell|call|fax|whatsapp|text|sms|reach|hotline|dial)\b"
    r"[^.!?\n\d]*$",
    re.IGNORECASE,
)
_IS_PLACE = re.compile(
    r"(?:\b(?:at|coords?|coordinates|position|xyz|x|y|z|tp|teleport|located|near|spawn|seed|block"
    r"|chunk|blocks|isbn|issn)\b\W*(?:\w+\W+){0,2}|[~^]|/\w+ .*)$",
    re.IGNORECASE,
)
_DATE = re.compile(
    r"(?<!\d)(?:(?:1[89]|20)\d\d([-.\u2010-\u2013 ])(?:0?[1-9]|1[0-2])\1(?:0?[1-9]|[12]\d|3[01])"
    r"|(?:0?[1-9]|[12]\d|3[01])([-. ])(?:0?[1-9]|[12]\d|3[01])\2(?:1[89]|20)\d\d"
    r"|(?:1[89]|20)\d\d ?[-\u2010-\u2013] ?(?:1[89]|20)\d\d)(?!\d)"
)
_ISBN = re.compile(r"97[89]\D")


def replaced(text: str, counts: Counter[str]) -> str:
    """The text with placeholders; `counts` gets how many there were by kind."""
    if "@" in text:
        text, count = _EMAIL.subn(EMAIL, text)
        counts["emails"] += count
    if not _MAYBE.search(text):
        return text

    def address(match: re.Match[str]) -> str:
        if not (_is_version4(match) if match["four"] else not _is_address6(match["six"])):
            counts["ip_addresses"] += 1
            return IP
        return match[0]

    def number(match: re.Match[str]) -> str:
        if _is_phone(match):
            counts["phones"] += 1
            return PHONE
        return match[0]

    return _NUMBER.sub(number, _ADDRESS.sub(address, text))


def _before(match: re.Match[str]) -> str:
    return match.string[max(match.start() - _NEAR, 0) : match.start()]


def _is_version4(match: re.Match[str]) -> bool:
    """Four numbers that are a version: said so, or beginning with 0 or 1 where no word says that
    they are an address.
    """
    before = _before(match)
    if _IS_IP.search(before) and not _IS_VERSION.search(before):
        return False
    port = re.match(r":\d{2,5}(?!\d)", match.string[match.end() : match.end() + 7])
    first = match["four"].partition(".")[0]
    return bool(_IS_VERSION.search(before)) or (first in ("0", "1") and not port)


def _is_address6(text: str) -> bool:
    groups = [group for group in re.split(r"[:.]", text) if group]
    if len(groups) < 3 and not text.lower().startswith(("fe80::", "fc", "fd", "2001:")):
        return False
    try:
        ipaddress.IPv6Address(text)
    except ValueError:
        return False
    return any(group.isdigit() or any(map(str.isdigit, group)) for group in groups)


def _is_phone(match: re.Match[str]) -> bool:
    """Whether digits with a leading + or with separators are a telephone number."""
    text = match[0]
    groups = re.findall(r"\d+", text)
    digits = "".join(groups)
    if not 9 <= len(digits) <= 15 or len(groups) > 7:
        return False
    if text.startswith(("+", "(+")):
        return digits[0] != "0"
    if _DATE.search(text) or _ISBN.match(text):
        return False
    before = _before(match)
    if _IS_PHONE.search(before):
        return True
    if _IS_PLACE.search(before) or _IS_VERSION.search(before):
        return False
    sizes = [len(group) for group in groups]
    national = sizes[-3:] == [3, 3, 4] and (len(sizes) == 3 or groups[:-3] in (["1"], ["00", "1"]))
    if national or text.startswith("(") or groups[0].startswith("00"):
        return True
    if groups[0].startswith("0") and (len(sizes) == 2 or max(sizes[1:]) > 1) and len(groups[0]) > 1:
        return True
    # Hyphens join what is one; blanks and dots also stand in lists, ranges and large numbers.
    joined = re.fullmatch(r"\d{2,4}(?:[-\u2010\u2011]\d{2,4}){2,4}", text)
    return bool(joined) and 3 in sizes and (len(sizes) > 3 or sizes[1] > 2)
