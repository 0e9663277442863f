"""`kb models fetch`: the published checkpoint with its configuration and vocabulary, verified.

A file is downloaded to `.NAME.part` beside its place, goes on there when it was cut off, and takes
its name only when its sha256 is right, or, where none is published, when it is what its name says:
a network's log-in page answers 200 too. The checkpoint comes last: when it is there, all is.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import requests

from kb.core import signals
from kb.core.context import Run
from kb.core.errors import DamagedData, FatalError, Retryable, SettingError
from kb.core.summary import Summary
from kb.net import bounded
from kb.net.retry import attempt
from kb.net.session import HttpSession, failure, send
from kb.store.atomic import sync_file, sync_folder
from kb.store.checkpoint import PUBLISHED, Published, models_folder, problem_of, sha256_of
from kb.store.exhausted import full_disk_is_resumable

MODEL_BYTES, MODEL_S = 4 << 30, 24 * 3600.0  # at most, of one file


def fetch(
    run: Run, name: str = "original", published: Published | None = None, folder: Path | None = None
) -> Summary:
    """Download and verify what is not there yet; `published` and `folder` stand in for the known
    ones.

    Raises SettingError (no such model), DamagedData (the address gives another file), FatalError
    (refused or absent there), Unreachable, DiskFull, Interrupted (the same command goes on).
    """
    if published is None:
        if name not in PUBLISHED:
            raise SettingError(f"there is no model {name!r}", hint=f"known: {', '.join(PUBLISHED)}")
        published = PUBLISHED[name]
    sources = published.sources(run.settings.kb_models_endpoint)
    return download(run, published.name, sources, folder or models_folder(published.name))


def download(
    run: Run, model: str, sources: Sequence[tuple[str, str, str]], folder: Path
) -> Summary:
    """Download and verify the files of a model that are not in the folder yet: (name, address,
    sha256 or its beginning) of each. Raises as `fetch` does.
    """
    with full_disk_is_resumable(folder):
        folder.mkdir(parents=True, exist_ok=True)
    session = HttpSession(run.settings)
    # A compressed answer could not be continued in its middle.
    session.headers["Accept-Encoding"] = "identity"
    fetched = present = size = 0
    for file, address, digest in sources:
        path = folder / file
        if path.is_file() and (
            sha256_of(path).startswith(digest) if digest else not problem_of(path)
        ):
            present += 1
            continue
        with run.progress.task(file, None, "bytes") as task:
            size += _download(session, address, path, digest, task)
        fetched += 1
    return Summary(
        command="models fetch",
        model=model,
        fetched=fetched,
        present=present,
        bytes=size,
        folder=str(folder),
    )


def _download(session: HttpSession, address: str, path: Path, digest: str, task: Any) -> int:
    part = path.with_name(f".{path.name}.part")
    for left in (1, 0):
        continued = part.exists()
        attempt(
            lambda: _receive(session, address, part, task), service="the host of the model files"
        )
        sha256 = sha256_of(part)
        problem = "" if digest else problem_of(part, path.name)
        if sha256.startswith(digest) and not problem:
            break
        part.unlink()
        # What was continued may have been the beginning of another file: once more from nothing.
        if not (continued and left):
            raise DamagedData(
                f"{address} is not the published file:"
                f" {problem or f'its sha256 begins {sha256[:12]}, not {digest[:12]}'};"
                " it was deleted",
                hint="try again later or over another network; KB_MODELS_ENDPOINT can name a"
                " mirror",
            )
    sync_file(part)
    part.replace(path)
    sync_folder(path.parent)
    return path.stat().st_size


def _receive(session: HttpSession, address: str, part: Path, task: Any) -> None:
    """One request for what is missing of the file. Raises Retryable when the connection breaks."""
    have = part.stat().st_size if part.exists() else 0
    headers = {"Range": f"bytes={have}-"} if have else {}
    with send(session, "GET", address, headers=headers, stream=True) as response:
        if response.status_code == 416:
            # Nothing is left: it is complete, or longer than the file there.
            total = response.headers.get("Content-Range", "").rpartition("/")[2]
            if total != str(have):
                part.unlink()
                raise Retryable("the partial download is longer than the file")
            return
        if response.status_code not in (200, 206):
            raise FatalError(
                f"{address} answers HTTP {response.status_code}",
                hint="check the address or KB_MODELS_ENDPOINT; the file may have moved",
            )
        begins = response.headers.get("Content-Range", "").startswith(f"bytes {have}-")
        goes_on = response.status_code == 206 and begins
        expected = response.headers.get("Content-Length")
        if expected and expected.isdigit():
            task.expect(int(expected))
        try:
            received = _write(response, part, "ab" if goes_on else "wb", task)
        except requests.RequestException as error:
            raise failure(error, address) from None
        if expected and received != int(expected):
            raise Retryable(f"the download of {address} is incomplete", unreachable=True)


def _write(response: Any, part: Path, mode: str, task: Any) -> int:
    received = 0
    with full_disk_is_resumable(part), part.open(mode) as file:
        for piece in bounded.parts(response, most=MODEL_BYTES, seconds=MODEL_S):
            signals.stop.raise_if_asked()
            file.write(piece)
            received += len(piece)
            task.advance(len(piece))
    return received
