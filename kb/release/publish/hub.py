"""A client of the Hugging Face hub on `huggingface_hub`: one data set repository.

Every error of the package becomes one of kb.core.errors, in one line and without the token. Files
go through LFS, also where `hf_xet` is installed: its own process-wide logs, caches and signals are
not ours to answer for, and a part that was sent is not sent again either way.
"""

import contextlib
import logging
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from importlib.util import find_spec
from pathlib import Path
from typing import Any, cast

from kb.core import clock, signals
from kb.core.errors import (
    CredentialRefused,
    FatalError,
    KbError,
    MissingExtra,
    QuotaSpent,
    SettingError,
    Stopped,
    Unreachable,
)
from kb.core.installation import install_extra
from kb.net import redact
from kb.net.certificates import untrusted
from kb.net.hub_client import use_own_client
from kb.net.retry import retry_after
from kb.version import __version__

PUBLIC = "https://huggingface.co"
KIND = "dataset"
MAIN = "main"
THREADS = 4  # files on their way at a time
PACK = 16  # files between two looks at whether the run is asked to end
TIMEOUT_S = (10.0, 300.0)  # seconds to connect, and between two bytes of an answer
_SHOWN = 400  # characters of a message
_GO_ON = "the same command resumes"
_FIRST = "initial commit"  # the hub's own: it holds no data


def check_installed() -> None:
    """Raises MissingExtra."""
    if find_spec("huggingface_hub") is None:
        raise MissingExtra(
            "`--to huggingface` needs the package huggingface-hub", hint=install_extra("hub")
        )


def check_name(name: str) -> None:
    """Raises SettingError for what can't be the name of a repository."""
    from huggingface_hub.errors import HFValidationError
    from huggingface_hub.utils._validators import validate_repo_id

    try:
        validate_repo_id(name)
        valid = name.count("/") == 1
    except HFValidationError:
        valid = False
    if not valid:
        raise SettingError(
            f"--repo {name!r} is not a valid repository name",
            hint="ORG/NAME, of letters, digits, '-', '_' and '.', at most 96 characters, without"
            " '--' or '..', and not ending with '.git'",
        )


@dataclass(frozen=True, slots=True)
class Revision:
    """The newest revision of a repository: file → its digest (SHA-256 of an LFS file, git's
    of another).
    """

    id: str
    private: bool
    files: Mapping[str, str]


class Hub:
    """One account at one hub. The token goes into the header only, and to that hub only."""

    def __init__(self, endpoint: str, token: str) -> None:
        check_installed()
        import huggingface_hub
        from huggingface_hub import constants
        from huggingface_hub.utils.tqdm import disable_progress_bars

        constants.HF_HUB_DISABLE_XET = True
        # Its retries are no news: what they come to is an error of ours.
        logging.getLogger("huggingface_hub").setLevel(logging.CRITICAL)
        disable_progress_bars()

        use_own_client(endpoint, TIMEOUT_S)
        self.root = endpoint.rstrip("/")
        self._token = token
        self._api = huggingface_hub.HfApi(
            endpoint=self.root, token=token, library_name="lorecrawl", library_version=__version__
        )

    def account(self) -> str:
        """Whose token it is. Raises CredentialRefused."""
        with self._errors():
            return str(self._api.whoami()["name"])

    def newest(self, repo: str) -> Revision | None:
        """The newest revision; None where there is no such repository, or none that the token may
        see.
        """
        from huggingface_hub import RepoFile
        from huggingface_hub.errors import RepositoryNotFoundError

        with self._errors(repo):
            try:
                info = self._api.repo_info(repo, repo_type=KIND, revision=MAIN)
            except RepositoryNotFoundError:
                return None
            there = self._api.list_repo_tree(
                repo, repo_type=KIND, revision=info.sha, recursive=True
            )
            files = {
                file.path: file.lfs.sha256 if file.lfs else file.blob_id
                for file in there
                if isinstance(file, RepoFile)
            }
            return Revision(str(info.sha), bool(info.private), files)

    def create(self, repo: str, *, private: bool) -> None:
        """A new repository. Raises FatalError where the name is taken or the token may not."""
        with self._errors(repo):
            self._api.create_repo(repo, repo_type=KIND, private=private)

    def text(self, repo: str, revision: str, path: str) -> str:
        """A small file of a revision."""
        from huggingface_hub import HfFileSystem

        with self._errors(repo):
            files = HfFileSystem(endpoint=self.root, token=self._token, skip_instance_cache=True)
            where = f"datasets/{repo}@{revision}/{path}"
            return cast("bytes", files.cat_file(where)).decode("utf-8")

    def commit(
        self,
        repo: str,
        parent: str,
        files: Mapping[str, Path | bytes],
        removed: Sequence[str],
        title: str,
        sent: Callable[[int], None],
    ) -> str:
        """A new revision after `parent` with these files (path → its place or content) and without
        those removed; its id.

        Large files go first; those that the hub has already, from an earlier run too, are not sent.
        `sent` is told the bytes that left. Raises Interrupted between two packs of files.
        """
        from huggingface_hub import CommitOperationAdd, CommitOperationDelete

        with self._errors(repo):
            added = [CommitOperationAdd(path, content) for path, content in files.items()]
            for start in range(0, len(added), PACK):
                pack = added[start : start + PACK]
                self._api.preupload_lfs_files(repo, pack, repo_type=KIND, num_threads=THREADS)
                sent(sum(operation.upload_info.size for operation in pack))
                signals.stop.raise_if_asked()
            operations: list[Any] = [*added, *map(CommitOperationDelete, removed)]
            done = self._api.create_commit(
                repo,
                operations,
                commit_message=title,
                repo_type=KIND,
                parent_commit=parent,
            )
            return str(done.oid)

    def tags(self, repo: str) -> dict[str, str]:
        """Tag → the revision that it names."""
        with self._errors(repo):
            refs = self._api.list_repo_refs(repo, repo_type=KIND)
            return {tag.name: str(tag.target_commit) for tag in refs.tags}

    def tag(self, repo: str, name: str, revision: str) -> None:
        """A new tag."""
        with self._errors(repo):
            self._api.create_tag(repo, tag=name, revision=revision, repo_type=KIND)

    def untag(self, repo: str, name: str) -> None:
        """Remove a tag."""
        with self._errors(repo):
            self._api.delete_tag(repo, tag=name, repo_type=KIND)

    def older(self, repo: str) -> int:
        """How many revisions with data are older than the newest."""
        with self._errors(repo):
            commits = self._api.list_repo_commits(repo, repo_type=KIND)
            return sum(commit.title.lower() != _FIRST for commit in commits[1:])

    def squash(self, repo: str, title: str) -> str:
        """Make the newest files the only revision of the branch; its id. Can't be undone."""
        with self._errors(repo):
            self._api.super_squash_history(repo, commit_message=title, repo_type=KIND)
            return str(self._api.repo_info(repo, repo_type=KIND, revision=MAIN).sha)

    def drop_objects(self, repo: str, kept: Collection[str]) -> int:
        """Delete for good the large files that are stored there and are not `kept` (SHA-256): a
        squash removes their names only. How many.
        """
        with self._errors(repo):
            there = list(self._api.list_lfs_files(repo, repo_type=KIND))
            if not set(kept) <= {
                name for stored in there for name in (stored.oid, stored.file_oid)
            }:
                raise FatalError(
                    f"the hub's list of stored files misses some of {repo}; none was deleted",
                    hint="delete older files under Settings, Storage of the repository",
                )
            lost = [stored for stored in there if not {stored.oid, stored.file_oid} & set(kept)]
            if lost:  # no revision names them any more
                self._api.permanently_delete_lfs_files(
                    repo, lost, rewrite_history=False, repo_type=KIND
                )
            return len(lost)

    @contextlib.contextmanager
    def _errors(self, repo: str = "") -> Iterator[None]:
        """Raise what an error of the package means."""
        try:
            yield
        except KbError:
            raise
        except Exception as error:  # noqa: BLE001  its errors have no common base
            raise self._meaning(error, repo) from None

    def _meaning(self, error: BaseException, repo: str) -> Exception:
        import httpx2
        from huggingface_hub.errors import (
            HfHubHTTPError,
            OfflineModeIsEnabled,
        )

        if problem := untrusted(error, self.root):
            return problem
        chain = _chain(error)
        for cause in chain:
            if isinstance(cause, KbError):
                return cause  # of our own file, in a thread of theirs
            if isinstance(cause, OfflineModeIsEnabled):
                return SettingError(
                    "HF_HUB_OFFLINE is set, so nothing can be uploaded", hint="unset it"
                )
            if isinstance(cause, HfHubHTTPError) and cause.response is not None:
                return self._refused(cause, repo)
            if isinstance(cause, httpx2.TransportError):
                return Unreachable(
                    f"no connection to the hub at {self.root}: {self._line(cause)}",
                    hint=f"check the network; {_GO_ON}",
                )
            if isinstance(cause, OSError) and cause.filename:
                return FatalError(
                    f"{cause.filename} can't be read: {cause.strerror}", hint="run `kb verify`"
                )
        return FatalError(
            f"the hub at {self.root} returns no usable answer:"
            f" {self._line(chain[-1]) or type(chain[-1]).__name__}",
            hint="check HF_ENDPOINT",
        )

    def _refused(self, error: Any, repo: str) -> Exception:
        """What an answer with an error means."""
        status, headers = int(error.response.status_code), error.response.headers
        message = self._line(error.server_message or error.response.reason_phrase or "no message")
        if status == 401:
            return CredentialRefused(
                "the hub does not accept HF_TOKEN",
                hint="make one that may write, under Settings, Access Tokens of the account",
            )
        if status == 403:
            owner = repo.partition("/")[0]
            return CredentialRefused(
                f"HF_TOKEN may not write to {repo}: {message}"
                if repo
                else f"refused (403): {message}",
                hint=f"use a token with write access to {owner}, or another --repo",
            )
        if status == 404:
            return FatalError(
                f"the hub answered 404 for {repo or self.root}: {message}",
                hint="check --repo and HF_ENDPOINT",
            )
        if status == 409:
            return FatalError(
                f"the name {repo} is taken: {message}", hint="choose another name with --repo"
            )
        if status == 412:
            return FatalError(
                f"{repo} was changed by somebody else during the upload",
                hint="run the same command again",
            )
        if status == 429:
            return _limited(headers)
        if status >= 500:
            return Unreachable(f"the hub answers {status}: {message}", hint=_GO_ON)
        return FatalError(
            f"the hub refused ({status}): {message}",
            hint="correct that, then run the same command again",
        )

    def _line(self, text: object) -> str:
        """The first lines of a message as one, without the token."""
        plain = " ".join(str(text).split())
        return redact.text(plain.replace(self._token, redact.MARK))[:_SHOWN]


def _chain(error: BaseException) -> list[BaseException]:
    """An error and its causes."""
    chain: list[BaseException] = []
    cause: BaseException | None = error
    while cause is not None and cause not in chain:
        chain.append(cause)
        cause = cause.__cause__ or cause.__context__
    return chain


def _limited(headers: Any) -> Stopped:
    """The package has waited as long as it does."""
    seconds = retry_after(headers.get("Retry-After"), headers.get("Date"))
    if seconds is None:
        return QuotaSpent("the hub's limit is spent", hint=f"{_GO_ON} later")
    back = datetime.now(UTC) + timedelta(seconds=seconds)
    return QuotaSpent(
        f"the hub's limit is spent until {clock.stamp(back)}",
        hint="run the same command then",
        until=back,
    )
