"""A real MediaWiki on loopback: Debian's packages, SQLite, PHP's own server. Seeded in one import.

Run as a script it installs the packages (root and apt needed): `python tests/wiki/mediawiki.py`.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import socket
import subprocess
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

CODE = Path("/usr/share/mediawiki")
PACKAGES = (
    "mediawiki",
    "php-cli",
    "php-sqlite3",
    "php-mbstring",
    "php-xml",
    "php-intl",
    "imagemagick",
)

SETTINGS = """<?php
$wgServer = "@url"; $wgScriptPath = "/w"; $wgArticlePath = "/wiki/$1";
$wgSitename = "Kiln Valley Wiki";
$wgDBtype = "sqlite"; $wgDBserver = ""; $wgDBname = "kiln"; $wgDBuser = ""; $wgDBpassword = "";
$wgSQLiteDataDir = "@data";
$wgObjectCaches[CACHE_DB] = [ 'class' => SqlBagOStuff::class, 'loggroup' => 'SQLBagOStuff',
  'server' => [ 'type' => 'sqlite', 'dbname' => 'wikicache', 'tablePrefix' => '',
  'variables' => [ 'synchronous' => 'NORMAL' ], 'dbDirectory' => $wgSQLiteDataDir,
  'trxMode' => 'IMMEDIATE', 'flags' => 0 ] ];
$wgMainCacheType = CACHE_NONE; $wgParserCacheType = CACHE_NONE; $wgMessageCacheType = CACHE_NONE;
$wgSessionCacheType = CACHE_DB;
$wgLocalisationCacheConf['storeDirectory'] = "@data"; $wgCacheDirectory = "@data";
$wgTmpDirectory = "@data";
$wgSecretKey = "not-a-secret"; $wgUpgradeKey = "0"; $wgEnableUploads = true;
$wgUploadDirectory = "@images"; $wgUploadPath = "/images";
$wgHashedUploadDirectory = true; $wgUseImageMagick = true;
$wgImageMagickConvertCommand = "/usr/bin/convert"; $wgMaxImageArea = 2e8;
$wgFileExtensions = [ 'png', 'gif', 'jpg', 'svg', 'apng' ]; $wgStrictFileExtensions = false;
$wgVerifyMimeType = false; $wgSVGConverter = false;
$wgParserEnableLegacyMediaDOM = false;
$wgRightsUrl = "https://creativecommons.org/licenses/by-sa/4.0/"; $wgRightsText = "CC BY-SA 4.0";
$wgJobRunRate = 0; $wgUseInstantCommons = false; $wgEnableEmail = false;
$wgShowExceptionDetails = true; $wgDiff3 = "";
$wgGenerateThumbnailOnParse = true; $wgNativeImageLazyLoading = true; $wgAllowDisplayTitle = true;
$wgExternalLinkTarget = false;
$wgRawHtml = true;
$wgMemoryLimit = "512M"; $wgPhpCli = "/usr/bin/php"; $wgUseFileCache = false; $wgRateLimits = [];
foreach ( [ 'Vector', 'MonoBook', 'MinervaNeue', 'Timeless' ] as $skin ) { wfLoadSkin( $skin ); }
$wgDefaultSkin = "vector";
"""

ROUTER = """<?php
$path = rawurldecode( parse_url( $_SERVER['REQUEST_URI'], PHP_URL_PATH ) );
$code = "@code"; $serve = null;
$seen = [ 'address' => $_SERVER['REQUEST_URI'], 'agent' => $_SERVER['HTTP_USER_AGENT'] ?? '',
  'dest' => $_SERVER['HTTP_SEC_FETCH_DEST'] ?? null ];
file_put_contents( "@data/requests.ndjson", json_encode( $seen ) . "\n", FILE_APPEND | LOCK_EX );
if ( $path === '/robots.txt' ) {
  header( 'Content-Type: text/plain' ); echo file_get_contents( "@data/robots.txt" ); return true;
}
if ( $path === '/' ) { header( 'Location: /wiki/Main_Page', true, 301 ); return true; }
if ( preg_match( '#^/w/(index|api|load|thumb)\\.php#', $path, $m ) ) { $serve = "$m[1].php"; }
elseif ( strpos( $path, '/wiki/' ) === 0 ) {
  $serve = 'index.php'; $_SERVER['PATH_INFO'] = substr( $path, 5 );
}
if ( $serve ) {
  $_SERVER['SCRIPT_NAME'] = $_SERVER['PHP_SELF'] = "/w/$serve";
  $_SERVER['SCRIPT_FILENAME'] = "$code/$serve"; chdir( $code );
  require "$code/$serve"; return true;
}
$file = strpos( $path, '/images/' ) === 0 ? "@images" . substr( $path, 7 )
  : "$code" . preg_replace( '#^/w#', '', $path );
if ( strpos( $path, '..' ) !== false || !is_file( $file ) ) {
  http_response_code( 404 ); return true;
}
$types = [ 'png' => 'image/png', 'gif' => 'image/gif', 'jpg' => 'image/jpeg',
  'svg' => 'image/svg+xml', 'css' => 'text/css', 'js' => 'text/javascript' ];
$type = $types[ pathinfo( $file, PATHINFO_EXTENSION ) ] ?? 'application/octet-stream';
header( 'Content-Type: ' . $type ); readfile( $file ); return true;
"""


def missing() -> str | None:
    """Why no MediaWiki can be run here; None when it can."""
    if not (CODE / "includes").is_dir() or not shutil.which("php"):
        return f"MediaWiki is not installed: apt-get install {' '.join(PACKAGES)}"
    return None


def install() -> str | None:
    """Install Debian's packages when we may; the reason when that did not go."""
    if missing() is None:
        return None
    if os.geteuid() != 0 or not shutil.which("apt-get"):
        return missing()
    quiet = {
        "stdout": subprocess.DEVNULL,
        "stderr": subprocess.DEVNULL,
        "check": False,
        "env": {**os.environ, "DEBIAN_FRONTEND": "noninteractive"},
    }
    subprocess.run(["apt-get", "update", "-qq"], **quiet)
    subprocess.run(
        ["apt-get", "install", "-y", "-qq", "--no-install-recommends", *PACKAGES], **quiet
    )
    return missing()


class MediaWiki:
    """A running wiki. `url` is its root."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.images, self.data = folder, folder / "images", folder / "data"
        self.images.mkdir(parents=True)
        self.data.mkdir()
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        self.url = f"http://127.0.0.1:{port}"
        self._env = {
            "PATH": os.environ["PATH"],
            "HOME": str(folder),
            "MW_CONFIG_FILE": str(folder / "LocalSettings.php"),
            "PHP_CLI_SERVER_WORKERS": "4",
            "TZ": "UTC",
            "LANG": "C.UTF-8",
        }
        self._fill("router.php", ROUTER)
        self.robots("User-agent: *\nDisallow: /wiki/Special:\n")

    def _fill(self, name: str, text: str) -> None:
        for key, value in (
            ("@url", self.url),
            ("@data", self.data),
            ("@images", self.images),
            ("@code", CODE),
        ):
            text = text.replace(key, str(value))
        (self.folder / name).write_text(text)

    def robots(self, text: str) -> None:
        """What /robots.txt says from now on."""
        (self.data / "robots.txt").write_text(text)

    def php(self, script: str, *arguments: str, text: str = "") -> None:
        """Run a maintenance script."""
        done = subprocess.run(
            ["php", str(CODE / "maintenance" / f"{script}.php"), *arguments],
            input=text,
            text=True,
            capture_output=True,
            env=self._env,
            check=False,
            timeout=120,
        )
        if done.returncode:
            raise RuntimeError(f"{script}: {done.stdout[-1500:]} {done.stderr[-1500:]}")

    def create(self) -> None:
        """An empty wiki."""
        env = {**self._env}
        del env["MW_CONFIG_FILE"]
        done = subprocess.run(
            [
                "php",
                str(CODE / "maintenance" / "install.php"),
                "--dbtype",
                "sqlite",
                "--dbname",
                "kiln",
                "--dbpath",
                str(self.data),
                "--confpath",
                str(self.folder),
                "--server",
                self.url,
                "--scriptpath",
                "/w",
                "--pass",
                "only-for-this-test-1",
                "Kiln",
                "Admin",
            ],
            capture_output=True,
            text=True,
            env=env,
            check=False,
            timeout=120,
        )
        if done.returncode:
            raise RuntimeError(done.stdout[-1500:] + done.stderr[-1500:])
        self._fill("LocalSettings.php", SETTINGS)

    def seed(self, pages: dict[str, str], pictures: Path) -> None:
        """Put in pages and pictures, in the order given."""
        self.php(
            "importImages",
            "--comment",
            "own work",
            "--extensions",
            "png,gif,jpg,svg",
            str(pictures),
        )
        (self.folder / "pages.xml").write_text(_dump(pages), encoding="utf-8")
        self.php("importDump", "--quiet", "--no-updates", str(self.folder / "pages.xml"))

    def requests(self) -> list[dict[str, Any]]:
        """Every request so far: address, agent, dest (Sec-Fetch-Dest, None of other clients)."""
        log = self.data / "requests.ndjson"
        lines = log.read_text(encoding="utf-8").splitlines() if log.exists() else []
        return [json.loads(line) for line in lines]

    def edit(self, title: str, text: str) -> None:
        """Save a new revision."""
        self.php("edit", "--summary", "edit", title, text=text)

    @contextlib.contextmanager
    def serving(self) -> Iterator[MediaWiki]:
        """The wiki answers while the block runs; the process group of PHP is ended after it."""
        port = self.url.rsplit(":", 1)[1]
        process = subprocess.Popen(
            [
                "php",
                "-S",
                f"127.0.0.1:{port}",
                "-t",
                str(self.folder),
                str(self.folder / "router.php"),
            ],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=self._env,
            start_new_session=True,
        )
        try:
            for _ in range(1200):
                with (
                    contextlib.suppress(OSError),
                    urllib.request.urlopen(f"{self.url}/robots.txt", timeout=5),
                ):
                    break
                time.sleep(0.05)
            yield self
        finally:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def _dump(pages: dict[str, str]) -> str:
    """MediaWiki's export format with one revision a page, dated one day after the other."""
    parts = [
        '<mediawiki xmlns="http://www.mediawiki.org/xml/export-0.11/" version="0.11" xml:lang="en">'
    ]
    for day, (title, text) in enumerate(pages.items(), 1):
        css = title.endswith(".css"), title.endswith(".js")
        model, shape = (
            ("css", "text/css")
            if css[0]
            else ("javascript", "text/javascript")
            if css[1]
            else ("wikitext", "text/x-wiki")
        )
        body = (
            f"<model>{model}</model><format>{shape}</format><text"
            f' xml:space="preserve">{escape(text)}</text>'
        )
        parts.append(
            f"<page><title>{escape(title)}</title><ns>0</ns><revision><timestamp>2024-02-{day:02d}T09:00:00Z</timestamp>"
            f"<contributor><username>Tamsin</username></contributor>{body}</revision></page>"
        )
    return "\n".join([*parts, "</mediawiki>"])


if __name__ == "__main__":
    raise SystemExit(install() or 0)
