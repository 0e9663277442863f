"""What a crawl of a wiki needs of this machine, for `kb doctor`."""

from collections.abc import Iterator

from kb.core.errors import MissingExtra, SettingError
from kb.net.certificates import authorities
from kb.wiki.browser import chromium


def requirements() -> Iterator[tuple[str, str, str, str]]:
    """The browser with its driver, and whether it trusts whom the other clients trust."""
    try:
        programs = chromium.find_programs()
        yield "ok", "browser", f"{programs.browser} with {programs.driver}", ""
    except MissingExtra as error:
        yield "problem", "browser", str(error), error.hint
    try:
        _, own_authorities = authorities()
    except SettingError:  # which is said of the other clients
        return
    if own_authorities and not chromium.has_certificates():
        what = "it trusts the usual authorities alone"
        fix = "if your company signs certificates, add its authority (docs/long-crawls.md)"
        yield "note", "browser's certificates", what, fix
