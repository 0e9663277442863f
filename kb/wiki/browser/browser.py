"""Runs headless Chromium with its driver: one browser, and a pool of them, one per worker, which
replaces those that hang or die.

The browser gets a fresh profile and home folder, none of our environment variables, and resolves
only the hosts of the wiki.
"""

import base64
import contextlib
import json
import os
import re
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Self, TypeVar
from urllib.parse import urlsplit

from urllib3.exceptions import HTTPError

from kb.core.errors import ItemFinal, MissingExtra, Retryable
from kb.net.proxies import proxy_of
from kb.wiki.browser.chromium import INSTALL, START_SECONDS, DriverProcess, Programs
from kb.wiki.errors import NoResponse, PageTimeout, ServerFault, of_browser

# Requests that Chromium would send to its maker by itself, and prefetching for pages.
FEATURES_OFF = (
    "AutofillServerCommunication",
    "CertificateTransparencyComponentUpdater",
    "HttpsUpgrades",
    "InterestFeedContentSuggestions",
    "MediaRouter",
    "NetworkErrorLogging",
    "NetworkTimeServiceQuerying",
    "OptimizationGuideModelDownloading",
    "OptimizationHints",
    "OptimizationHintsFetching",
    "Prerender2",
    "Reporting",
    "Translate",
)
# Parts of the browser's own interface that cost renderer processes and do not affect pages: lists
# of the address bar, a spare renderer, and pages kept for the back button.
SURFACE_OFF = (
    "BackForwardCache",
    "SpareRendererForSitePerProcess",
    "WebUIOmniboxAimPopup",
    "WebUIOmniboxFullPopup",
    "WebUIOmniboxPopup",
)
PREFERENCES = {
    "alternate_error_pages.enabled": False,
    "credentials_enable_service": False,
    "dns_over_https.mode": "off",
    "net.network_prediction_options": 2,  # no prefetch, preconnect or speculation
    "safebrowsing.enabled": False,
    "search.suggest_enabled": False,
    "session.restore_on_startup": 4,  # the addresses that follow, not its own first page
    "session.startup_urls": ["about:blank"],
    "signin.allowed": False,
    "spellcheck.use_spelling_service": False,
    "translate.enabled": False,
    "webrtc.ip_handling_policy": "disable_non_proxied_udp",
}
FLAGS = (
    "--headless=new",
    "--remote-debugging-pipe",  # it ends with its driver, and nobody else can talk to it
    "--hide-scrollbars",
    "--force-device-scale-factor=1",
    "--force-color-profile=srgb",
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--mute-audio",
    "--no-first-run",
    "--no-default-browser-check",
    "--disable-component-update",
    "--disable-background-networking",
    "--disable-sync",
    "--disable-default-apps",
    "--disable-extensions",
    "--disable-breakpad",
    "--disable-crash-reporter",
    "--no-pings",
    "--disable-domain-reliability",
    "--disable-client-side-phishing-detection",
    f"--disable-features={','.join(FEATURES_OFF + SURFACE_OFF)}",
    "--disable-field-trial-config",
    "--disable-component-extensions-with-background-pages",
    "--disable-search-engine-choice-screen",
    "--metrics-recording-only",
    "--safebrowsing-disable-auto-update",
    "--dns-prefetch-disable",
    "--disable-quic",
    "--webrtc-ip-handling-policy=disable_non_proxied_udp",
    "--force-webrtc-ip-handling-policy=disable_non_proxied_udp",
    "--blink-settings=imageAnimationPolicy=2",
    "--password-store=basic",
    "--use-mock-keychain",
    "--lang=en-US",
)


class Browser:
    """A running browser. Every call returns in time or raises Retryable; call `end` afterwards."""

    def __init__(
        self,
        programs: Programs,
        *,
        hosts: Sequence[str],
        origins: Sequence[str],
        user_agent: str,
        viewport: tuple[int, int],
        page_seconds: float,
        before: str = "",
    ) -> None:
        self.page_seconds = page_seconds
        self._driver: Any = None
        self.overdue = self._limited = False
        self.uses = 0
        self.process = DriverProcess(programs.driver)
        try:
            self._open(programs, hosts, origins, user_agent, viewport, page_seconds)
            self._prepare(origins, viewport, before)
        except BaseException:
            self.end()
            raise

    def _open(
        self,
        programs: Programs,
        hosts: Sequence[str],
        origins: Sequence[str],
        user_agent: str,
        viewport: tuple[int, int],
        page_seconds: float,
    ) -> None:
        from selenium.common.exceptions import SessionNotCreatedException, WebDriverException
        from selenium.webdriver import ChromeOptions
        from selenium.webdriver.chrome.remote_connection import ChromeRemoteConnection
        from selenium.webdriver.common.proxy import Proxy, ProxyType
        from selenium.webdriver.remote.client_config import ClientConfig
        from selenium.webdriver.remote.webdriver import WebDriver

        options = ChromeOptions()
        options.binary_location = programs.browser
        options.page_load_strategy = "normal"
        options.unhandled_prompt_behavior = "dismiss"
        # The performance log has what a page cannot see: statuses and Retry-After.
        options.set_capability("goog:loggingPrefs", {"performance": "ALL"})
        options.add_experimental_option(
            "perfLoggingPrefs", {"enableNetwork": True, "enablePage": False}
        )
        options.add_experimental_option("prefs", PREFERENCES)
        # A host with a port allows that port only: on loopback other ports are other services.
        ways = proxies(origins)
        hosts = [*hosts, *(way.partition(" ")[2] for way in ways.values())]
        rules = ", ".join([*(f"MAP {host} {host}" for host in hosts), "MAP * ~NOTFOUND"])
        flags = [
            *FLAGS,
            proxy_flag(ways),
            f"--window-size={viewport[0]},{viewport[1]}",
            f"--user-agent={user_agent}",
            f"--host-resolver-rules={rules}",
            f"--user-data-dir={self.process.folder}/profile",
        ]
        if hasattr(os, "geteuid") and os.geteuid() == 0:
            flags.append("--no-sandbox")  # Chromium's own sandbox can't be set up by root
        for flag in flags:
            options.add_argument(flag)
        address = f"http://127.0.0.1:{self.process.port}"
        # Selenium waits longer than a page may take: the limits of the driver apply first.
        config = ClientConfig(
            remote_server_addr=address,
            keep_alive=True,
            proxy=Proxy({"proxyType": ProxyType.DIRECT}),  # the driver is on this machine
            timeout=int(page_seconds) + 15,
        )
        try:
            with self.within(START_SECONDS + 15):
                self._driver = WebDriver(
                    command_executor=ChromeRemoteConnection(address, client_config=config),
                    options=options,
                )
        except SessionNotCreatedException as error:
            message = (error.msg or "").splitlines()[0]
            raise MissingExtra(
                f"{programs.driver} can't start {programs.browser}: {message}", hint=INSTALL
            ) from None
        except (WebDriverException, HTTPError, OSError) as error:
            raise Retryable(f"browser_start: {type(error).__name__}") from error
        self._driver.set_page_load_timeout(page_seconds)
        self._driver.set_script_timeout(page_seconds)

    def _prepare(self, origins: Sequence[str], viewport: tuple[int, int], before: str) -> None:
        self.devtools("Network.enable", {})
        # The resolver rules cover hosts only; ports and schemes are blocked here.
        # Favicons are never part of a page's images.
        patterns = [{"urlPattern": f"{origin}/favicon.ico", "block": True} for origin in origins]
        patterns += [{"urlPattern": f"{origin}/*", "block": False} for origin in origins]
        patterns += [
            {"urlPattern": f"{scheme}://*:*/*", "block": True}
            for scheme in ("http", "https", "ws", "wss")
        ]
        self.devtools("Network.setBlockedURLs", {"urlPatterns": patterns})
        self.devtools(
            "Emulation.setDeviceMetricsOverride",
            {"width": viewport[0], "height": viewport[1], "deviceScaleFactor": 1, "mobile": False},
        )
        self.devtools("Browser.setDownloadBehavior", {"behavior": "deny"})
        if before:
            self.devtools("Page.addScriptToEvaluateOnNewDocument", {"source": before})

    @contextlib.contextmanager
    def within(self, seconds: float) -> Iterator[None]:
        """Kill the browser when the block takes longer; pending calls then fail at once."""
        self._begin_timer(seconds)
        self._limited = True
        try:
            yield
        finally:
            self._limited = False
            self._timer.cancel()

    def allow(self, seconds: float) -> None:
        """Give the rest of a `within` block this much time, whatever was used before."""
        if self._limited:
            self._timer.cancel()
            self._begin_timer(seconds)

    def _begin_timer(self, seconds: float) -> None:
        self._timer = threading.Timer(seconds, self._late)
        self._timer.daemon = True
        self._timer.start()

    def _late(self) -> None:
        self.overdue = True
        self.process.kill()

    def go(self, url: str) -> None:
        """Load a URL. Raises Retryable."""
        self._ask("get", url)

    def script(self, source: str, *arguments: Any) -> Any:
        """Run a script and return its value. Raises Retryable."""
        return self._ask("execute_script", source, *arguments)

    def promise(self, source: str, *arguments: Any) -> Any:
        """Run an async script and return its value. Raises Retryable."""
        wrapped = "const done = arguments[arguments.length - 1];"
        wrapped += f"(async () => {{ {source} }})().then(done, (e) => done({{error: String(e)}}))"
        return self._ask("execute_async_script", wrapped, *arguments)

    def devtools(self, command: str, params: dict[str, Any]) -> Any:
        """Send a command of the DevTools protocol and return its answer. Raises Retryable."""
        return self._ask("execute", "executeCdpCommand", {"cmd": command, "params": params})[
            "value"
        ]

    def record(self) -> list[dict[str, Any]]:
        """Return the log entries of requests since the last call. Raises Retryable."""
        answer = self._ask("execute", "getLog", {"type": "performance"})
        return answer["value"]

    def _ask(self, method: str, *arguments: Any) -> Any:
        from selenium.common.exceptions import TimeoutException, WebDriverException

        try:
            return getattr(self._driver, method)(*arguments)
        except TimeoutException:
            raise PageTimeout from None
        except (WebDriverException, HTTPError, OSError, ValueError) as error:
            if self.overdue:
                raise PageTimeout from None
            message = (getattr(error, "msg", "") or type(error).__name__).splitlines()[0]
            match = re.search(r"net::(ERR_\w+)", message)
            if match:
                raise of_browser(match[1].lower()) from None
            raise Retryable(f"browser: {message[:120]}") from None

    def end(self) -> None:
        """End every process of the browser and remove its profile."""
        self.process.end()


def proxies(origins: Sequence[str]) -> dict[str, str]:
    """By origin the proxy that the environment names for it, "PROXY HOST:PORT" as Chromium has it;
    none for this machine. Chromium takes no user name and password of a proxy.
    """
    ways = {}
    for origin in origins:
        if proxy := proxy_of(origin):
            parts = urlsplit(proxy if "://" in proxy else f"http://{proxy}")
            kind = {"https": "HTTPS", "http": "PROXY"}.get(parts.scheme, "SOCKS5")
            port = parts.port or {"HTTPS": 443, "PROXY": 80}.get(kind, 1080)
            ways[origin] = f"{kind} {parts.hostname}:{port}"
    return ways


def proxy_flag(ways: Mapping[str, str]) -> str:
    """The flag by which only these origins are asked through a proxy. All others are asked
    directly, so that the resolver's rules refuse those that are not allowed.
    """
    if not ways:
        return "--no-proxy-server"
    script = (
        f"const ways = {json.dumps(ways)};"
        "function FindProxyForURL(url) {"
        " for (const origin in ways) if (url.startsWith(origin + '/')) return ways[origin];"
        " return 'DIRECT'; }"
    )
    packed = base64.b64encode(script.encode()).decode()
    return f"--proxy-pac-url=data:application/x-ns-proxy-autoconfig;base64,{packed}"


def reach(url: str, others: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return the hosts and origins that a browser may request for the wiki at `url`.

    Both schemes are allowed, because a wiki may name its pages with the other one.
    """
    parts = urlsplit(url)
    host = f"[{parts.hostname}]" if ":" in (parts.hostname or "") else parts.hostname
    own = [f"{host}:{parts.port}"] if parts.port else [f"{host}:80", f"{host}:443"]
    schemes = sorted({parts.scheme, "https"})
    origins = [f"{scheme}://{parts.netloc}" for scheme in ("http", "https")]
    return [*own, *others], [
        *origins,
        *(f"{scheme}://{other}" for other in others for scheme in schemes),
    ]


Result = TypeVar("Result")
PAGES = 250  # pages per browser: its memory grows, and a new one costs about a second


class Pool:
    """Starts one browser at once, so that a broken installation shows, and others on demand.

    Raises MissingExtra when the browser does not start.
    """

    def __init__(self, start: Callable[[], Browser], seconds: float) -> None:
        self._start, self._seconds = start, seconds
        self._lock = threading.Lock()
        self._all: set[Browser] = set()
        self._idle = [self._new()]
        self._entry, self._left, self._in_use = threading.Lock(), threading.Condition(), 0

    def _new(self) -> Browser:
        browser = self._start()
        with self._lock:
            self._all.add(browser)
        return browser

    def use(
        self,
        work: Callable[[Browser], Result],
        first: Callable[[], None] = lambda: None,
        *,
        alone: bool = False,
    ) -> Result:
        """Run `work` with an exclusive browser, limited to `seconds`; `alone`: while no other one
        works.

        `first` runs before the limit starts (waiting for a turn). Raises what `work` raises. The
        browser is reused after success and after errors of the server, and replaced after others.
        """
        with self._place(alone=alone):
            return self._use(work, first)

    @contextlib.contextmanager
    def _place(self, *, alone: bool) -> Iterator[None]:
        """A place among those that work; from the moment that one waits to be alone, nobody else
        begins.
        """
        with contextlib.ExitStack() as entry:
            entry.enter_context(self._entry)
            with self._left:
                while alone and self._in_use:
                    self._left.wait()
                self._in_use += 1
            if not alone:
                entry.close()
            try:
                yield
            finally:
                with self._left:
                    self._in_use -= 1
                    self._left.notify_all()

    def _use(self, work: Callable[[Browser], Result], first: Callable[[], None]) -> Result:
        with self._lock:
            browser = self._idle.pop() if self._idle else None
        try:
            browser = browser or self._new()
        except MissingExtra as error:  # one has started before
            raise Retryable(f"browser_start: {error}") from error
        healthy = False
        try:
            first()
            with browser.within(self._seconds):
                result = work(browser)
            healthy = True
            return result
        except (ItemFinal, ServerFault, NoResponse):
            healthy = True
            raise
        finally:
            browser.uses += 1
            if healthy and not browser.overdue and browser.uses < PAGES:
                with self._lock:
                    self._idle.append(browser)
            else:
                with self._lock:
                    self._all.discard(browser)
                browser.end()

    def close(self) -> None:
        """End all browsers and their processes."""
        with contextlib.ExitStack() as stack:
            for browser in list(self._all):
                stack.callback(browser.end)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
