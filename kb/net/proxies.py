"""Through which proxy an address is asked: the one that the environment names, and none for this
machine. All clients ask here.
"""

from kb.core.config.addresses import is_loopback


def proxy_of(url: str) -> str | None:
    """The address of the proxy, as `http_proxy`, `https_proxy` or `all_proxy` and `no_proxy` say;
    None where the service is asked directly.
    """
    # A tenth of a second, which a query of local files need not wait for.
    from requests.utils import get_environ_proxies, select_proxy  # noqa: PLC0415

    return None if is_loopback(url) else select_proxy(url, get_environ_proxies(url))
