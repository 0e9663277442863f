"""`kb release` and `kb release publish`; `kb restore` brings the content of a release back."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from kb.cli.framework.command import DumpsCommand, command, group
from kb.cli.framework.messages import show, with_options
from kb.cli.framework.options import Dumps, Options, Plan
from kb.core.config.pipeline import Recipe
from kb.core.context import Run
from kb.core.errors import KbError, ReleaseRefused, SettingError
from kb.core.sources import PUBLISHED
from kb.core.summary import Summary

release_app = group("Check, describe and publish release/.")
Only = Annotated[
    list[str] | None,
    typer.Option(
        "--only",
        metavar="SOURCE",
        help="Only this folder (youtube, wiki, reddit, pairs, links); may be repeated.",
    ),
]


class Target(StrEnum):
    """Services that take a release."""

    sandbox = "zenodo-sandbox"
    zenodo = "zenodo"
    hub = "huggingface"


@command(
    release_app,
    main=True,
    json="folders, rows, bytes, sources, and problems if it is refused",
    examples=[
        (
            "kb release                               check every folder,"
            " then write cards, metadata and checksums"
        ),
        "kb release --only links                  only one folder",
        "kb release publish --to zenodo-sandbox   a draft of each folder, for review",
    ],
)
def release(run: Run, only: Only = None) -> Summary:
    """Check the exports, and add card, datasheet, metadata, sample and checksums to each folder.

    Every problem that prevents publishing is listed on a line, and nothing is written (exit code
    1).
    """
    from kb.artifacts.makers import make_artifact
    from kb.store.artifact_registry import RELEASE

    with _problems_listed():
        return make_artifact(run, RELEASE, {"only": only or []})


@command(
    release_app,
    raw=True,
    uses=("wait",),
    json="deposits, drafts, published, unchanged, uploaded, sources;"
    " of a repository: folders, repository, revision, tag, removed, older_revisions, older_tags",
    planned=("to", "only", "repo"),
    examples=[
        "kb release publish --to zenodo-sandbox             upload drafts to the sandbox",
        "kb release publish --to zenodo                     upload drafts",
        (
            "kb release publish --to zenodo --publish           publish the uploaded drafts"
            " (can't be undone)"
        ),
        "kb release publish --to huggingface --plan         what would be uploaded",
        (
            "kb release publish --to huggingface --repo my-lab/minecraft    all folders,"
            " as one data set"
        ),
    ],
)
def publish(
    options: Options,
    to: Annotated[Target, typer.Option("--to", help="The service that takes the release.")],
    publish: Annotated[
        bool, typer.Option("--publish", help="Zenodo: publish the drafts. This can't be undone.")
    ] = False,
    only: Only = None,
    repo: Annotated[
        str | None,
        typer.Option(
            "--repo",
            metavar="ORG/NAME",
            help="Hugging Face: the repository; default: the last one, or ACCOUNT/PROFILE.",
        ),
    ] = None,
    private: Annotated[
        bool,
        typer.Option("--private", help="Hugging Face: make a new repository a private one."),
    ] = False,
    squash_history: Annotated[
        bool,
        typer.Option(
            "--squash-history",
            help="Hugging Face: drop all older revisions and their tags, which keep what was"
            " purged since. This can't be undone.",
        ),
    ] = False,
    plan: Plan = False,
) -> Summary:
    """Upload each folder of release/, after the same checks.

    To Zenodo as a deposit, a draft until --publish makes it public; a folder that was published
    before and has changed becomes a new version of its record. To the Hugging Face hub as one
    repository with a folder each, public at once unless --private, with a tag for each version of
    the data. An interrupted upload resumes.
    """
    _check_options(to, publish=publish, repo=repo, private=private, squash=squash_history)
    from kb.release.publish import publish as upload

    run = options.make_run()
    if plan:
        with _problems_listed():
            return upload.plan(run, str(to), only=only, named=repo)
    hub = {"named": repo, "private": private, "squash": squash_history}
    done: dict[str, Any] = {}
    try:
        how: dict[str, Any] = hub if to is Target.hub else {"publish": publish}
        with _problems_listed():
            summary = upload.publish(run, str(to), only=only, **how)
        done = summary
        return summary
    except KbError as error:
        done = error.summary or {}
        raise
    finally:
        run.progress.close()
        for source, deposit in done.get("sources", {}).items() if not options.json else ():
            facts = (source, *(deposit.get(name) for name in ("state", "id", "doi", "page")))
            show("  ".join(str(fact) for fact in facts if fact))


def _check_options(
    to: Target, *, publish: bool, repo: str | None, private: bool, squash: bool
) -> None:
    """Raises SettingError for an option of the other service."""
    hub = to is Target.hub
    given = {
        "--publish": publish and hub,
        "--repo": repo is not None and not hub,
        "--private": private and not hub,
        "--squash-history": squash and not hub,
    }
    for name in (name for name, wrong in given.items() if wrong):
        raise SettingError(
            f"{name} has no effect with --to {to}",
            hint="a repository has no drafts; --private keeps it to yourself"
            if hub
            else "it is for --to huggingface",
        )


@contextlib.contextmanager
def _problems_listed() -> Iterator[None]:
    """The reasons of a refusal go to stderr, one line each."""
    try:
        yield
    except ReleaseRefused as error:
        for line in error.problems:
            show(with_options(line), err=True)
        raise


restore_app = group("Restore the content of a downloaded release with your own keys.")


# Parts that can be restored; releases of the other sources are complete.
_PARTS = [name for name, published in PUBLISHED.items() if published.restored]
RestorePart = StrEnum("RestorePart", _PARTS)  # type: ignore[misc]


@command(
    restore_app,
    raw=True,
    uses=("workers", "wait"),
    limit="Stop after N more items of each source (exit code 3); the next run resumes.",
    again="Ask for everything again, including what is in restored/ or was missing last time.",
    json="sources (the summary of each), requests, missing",
    planned=("folders", "dumps", "only"),
    cls=DumpsCommand,
    data="makes",
    examples=[
        "kb restore .                             the release in the current folder",
        "kb restore release --plan                requests by service, and the keys they need",
        ("kb restore youtube reddit --dumps RS_*.zst RC_*.zst    posts and comments without a key"),
        "kb restore . --only youtube --limit 100  100 videos now, the rest with the next run",
    ],
)
def restore(
    options: Options,
    folders: Annotated[
        list[Path],
        typer.Argument(
            metavar="FOLDER...", help="Release folders, or a folder that holds several of them."
        ),
    ],
    dumps: Dumps = None,
    only: Annotated[
        RestorePart | None, typer.Option("--only", help="Restore only this part.")
    ] = None,
    plan: Plan = False,
) -> Summary:
    """Restore the content of downloaded releases: videos, transcripts, posts, comments, texts.

    Videos need YOUTUBE_API_KEY; posts and comments need archive dumps (--dumps) or a Reddit key.
    The folders are first compared with their SHA256SUMS, and their profile is used. Everything is
    written to restored/ in the data root and can be queried as restored.*; restored.missing lists
    what could not be restored, with the reason. Typed in the folder of a release or above several,
    which stays as it is, without --data and KB_DATA, the data root is ../FOLDER-restored. After an
    interruption the same command resumes.
    """
    from kb.artifacts.data_roots import download_around
    from kb.core.config.settings import load_settings
    from kb.release.folders import find, profile_of

    releases = find(folders)
    settings = load_settings(kb_data=options.data)
    if "kb_data" not in settings.model_fields_set:
        here = Path.cwd()
        typed_there = any(folder.expanduser().resolve() == here for folder in folders)
        around = download_around(settings.kb_data, named=False) or (here if typed_there else None)
        if around is not None:
            options = replace(options, data=around.with_name(f"{around.name}-restored"))
    own = profile_of(releases)
    is_theirs = options.profile is None and own is not None
    run = options.make_run(kb_profile=str(own)) if is_theirs else options.make_run()
    step = Recipe("restore").defined("plan" if plan else "restore")
    summary: Summary = step(run, releases, dumps or (), only.value if only else None)
    return summary
