"""Finds out whether an error means that a certificate is not trusted, whichever library met it."""

import ssl

from kb.core.errors import Untrusted


def untrusted(error: BaseException, place: str) -> Untrusted | None:
    """The error for a service at `place` whose certificate is not trusted; None where `error` has
    another cause.
    """
    for cause in causes(error):
        if isinstance(cause, ssl.SSLCertVerificationError):
            return Untrusted(
                f"the certificate of {place} is not trusted: {cause.verify_message or cause}",
                hint="check this machine's clock; if a proxy or your company signs it, name the"
                " file of its authority in REQUESTS_CA_BUNDLE and SSL_CERT_FILE",
            )
    return None


def causes(error: BaseException) -> list[BaseException]:
    """An error and all that led to it."""
    found: list[BaseException] = []
    waiting: list[object] = [error]
    while waiting:
        cause = waiting.pop()
        if isinstance(cause, BaseException) and cause not in found:
            found.append(cause)
            # urllib3 and requests hand on what happened in an argument.
            waiting += [cause.__context__, cause.__cause__, getattr(cause, "reason", None)]
            waiting += cause.args
    return found
