"""Addresses of services: which are on this machine, and which may be asked in the clear."""

import ipaddress
from urllib.parse import urlsplit

NOT_HTTPS = "must begin with https://; plain http is for services on this machine alone"


def is_loopback(url: str) -> bool:
    """Whether a root is on this machine: there only the limits that the service announces apply."""
    host = urlsplit(url).hostname or ""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def in_the_clear(url: str) -> bool:
    """Whether others on the way could read what is sent to an address, and change the answer."""
    return urlsplit(url).scheme != "https" and not is_loopback(url)
