"""Whose certificates are trusted: those of the file that the environment names, such as that of a
company whose proxy signs every certificate anew; otherwise the usual ones.
"""

import os
import ssl
from pathlib import Path
from urllib.parse import urlsplit

from kb.core.errors import SettingError, Untrusted
from kb.core.regular_file import check_regular

VARIABLES = ("REQUESTS_CA_BUNDLE", "CURL_CA_BUNDLE", "SSL_CERT_FILE")  # the first that is set


def authorities() -> tuple[str, str]:
    """(variable, path of a file in PEM or of a folder as OpenSSL has them), ("", "") where none is
    named. Raises SettingError for one that can't be read or has no certificate.
    """
    name = next((variable for variable in VARIABLES if os.environ.get(variable)), "")
    path = os.environ.get(name, "")
    if path and not Path(path).is_dir():
        try:
            check_regular(path)
            ssl.create_default_context(cafile=path)
        except ssl.SSLError:
            raise _wrong(name, path, "it has no certificate in PEM") from None
        except OSError as error:
            raise _wrong(name, path, str(error.strerror)) from None
    return name, path


def tls() -> ssl.SSLContext | None:
    """What trusts just these; None where none are named. Raises SettingError."""
    _, path = authorities()
    if not path:
        return None
    folder = Path(path).is_dir()
    return ssl.create_default_context(
        cafile=None if folder else path, capath=path if folder else None
    )


def untrusted(error: BaseException, url: str) -> Untrusted | None:
    """The error for a service at `url` whose certificate is not trusted; None where `error` has
    another cause.
    """
    for cause in causes(error):
        # aiohttp's own error is one as well, without OpenSSL's words: they are in its cause.
        if problem := getattr(cause, "verify_message", ""):
            return Untrusted(
                f"the certificate of {urlsplit(url).netloc or url} is not trusted: {problem}",
                hint="check this machine's clock; if a proxy or your company signs it, name the"
                " file of its authority in REQUESTS_CA_BUNDLE (docs/long-crawls.md)",
            )
    return None


def causes(error: BaseException) -> list[BaseException]:
    """An error and all that led to it."""
    passed: list[BaseException] = []
    waiting: list[object] = [error]
    while waiting:
        cause = waiting.pop()
        if isinstance(cause, BaseException) and cause not in passed:
            passed.append(cause)
            # urllib3 and requests hand on what happened in an argument.
            waiting += [cause.__context__, cause.__cause__, getattr(cause, "reason", None)]
            waiting += cause.args
    return passed


def _wrong(name: str, path: str, why: str) -> SettingError:
    return SettingError(
        f"{name} is {path}, which can't be read: {why}",
        hint="name a file of certificates in PEM; docs/long-crawls.md shows how to make one",
    )
