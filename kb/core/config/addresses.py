"""Addresses of services (on this machine? in the clear?) and of data."""

import ipaddress
import os
import re
from urllib.parse import urlsplit

_CONTACT = re.compile(
    r"[^\s@<>]+@[^\s@<>]+\.[^\s@<>.]|https?://[^\s/]+\.[^\s/.]|\bwww\.[^\s/]+\.\w"
)
_DATA = re.compile(r"(?:[a-z0-9]+::)*[a-z][a-z0-9+.-]+:/.*", re.DOTALL)
_PROTOCOL = re.compile(r"(^|::)([a-z][a-z0-9+.-]+):(/{1,3})")  # of a part of an address of data
_NOT_HTTPS = "must begin with https://; plain http is for services on this machine alone"


def root_of(value: str, example: str) -> str:
    """A service's root without a slash at its end. Raises ValueError that says what it must be."""
    parts = urlsplit(value)
    try:
        host = (parts.hostname or "").encode("idna")
    except UnicodeError:
        host = b""
    if parts.scheme not in ("http", "https") or not host or " " in value:
        raise ValueError(f"must be an address like {example}")
    if parts.username is not None or parts.password is not None:
        raise ValueError("must not contain a user name or password")
    if "?" in value or "#" in value:
        raise ValueError("must be a root, without ? or #")
    try:
        unusable = parts.port == 0
    except ValueError:
        unusable = True
    if unusable:
        raise ValueError("must have a port from 1 to 65535, or none")
    if in_the_clear(value):
        raise ValueError(_NOT_HTTPS)
    return value.rstrip("/")


def is_loopback(url: str) -> bool:
    """Whether a root is on this machine: there only the limits that the service announces apply."""
    host = urlsplit(url).hostname or ""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def is_contact(text: str) -> bool:
    """Whether an e-mail or web address stands in it."""
    return _CONTACT.search(text) is not None


def in_the_clear(url: str) -> bool:
    """Whether others on the way could read what is sent to an address, and change the answer."""
    return urlsplit(url).scheme != "https" and not is_loopback(url)


def address_of(place: str | os.PathLike[str]) -> str:
    """The fsspec address that a place is, also as a Path ("s3:/bucket"); "" for a folder."""
    address = os.fspath(place)
    if not _DATA.fullmatch(address):
        return ""

    def whole(part: re.Match[str]) -> str:
        slashes = "///" if part[2] == "file" else "//" + part[3][2:]  # file:/folder is absolute
        return f"{part[1]}{part[2]}:{slashes}"

    return _PROTOCOL.sub(whole, address)
