"""`kb profile`: make a profile for a new domain, and check one before a crawl."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.messages import show_list, show_row, show_summary
from kb.cli.framework.options import Options
from kb.core import terminal
from kb.core.context import Run
from kb.core.errors import SettingError
from kb.core.summary import Summary

if TYPE_CHECKING:
    from kb.core.config.profile import Profile
    from kb.core.config.section import Finding, QuestionCost
    from kb.pairs.keyword_proposal import Proposal


app = group("Make and check the profile of a new domain.")


@command(
    app,
    raw=True,
    without=("data", "profile"),
    json="path",
    data="ignores",
    examples=[
        "kb profile new gardening                 a folder with profile.toml and keywords.tsv",
        "kb profile new gardening --wiki https://wiki.example.org --subreddit gardening",
        "kb profile new mine --from minecraft     start from another profile's values",
        "kb profile new mine --licence CC-BY-4.0 --creator 'Doe, Jane' --contact doe@uni.edu",
    ],
)
def new(
    options: Options,
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="The domain's short name, such as gardening.")
    ],
    wiki: Annotated[
        str | None, typer.Option("--wiki", metavar="URL", help="Root of its MediaWiki.")
    ] = None,
    subreddit: Annotated[
        str | None, typer.Option("--subreddit", metavar="NAME", help="Its subreddit, without r/.")
    ] = None,
    source: Annotated[
        str | None,
        typer.Option("--from", metavar="NAME|FILE", help="Copy the values of this profile."),
    ] = None,
    licence: Annotated[
        str | None,
        typer.Option(
            "--licence", metavar="SPDX", help="Licence of what you release, such as CC-BY-4.0."
        ),
    ] = None,
    creator: Annotated[
        str | None, typer.Option("--creator", metavar="NAME", help="Who makes the data set.")
    ] = None,
    contact: Annotated[
        str | None,
        typer.Option("--contact", metavar="ADDRESS", help="Where requests for removal go."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="DIR",
            help="Write the files there."
            " [default: data/profiles/NAME in a checkout, elsewhere ./NAME]",
        ),
    ] = None,
) -> None:
    """Write a commented profile and keyword list for a new domain, ready to be filled in.

    The profile lists every key with its default, unit and purpose; FILL-IN marks what only you
    know. On a terminal it asks for licence, creator and contact of a release unless they are given;
    without them everything but a release is made. Nothing is overwritten. Finally the next commands
    are printed.
    """
    from kb.cli.commands.profile_files import as_argument, write_new

    owner = {"licence": licence, "creator": creator, "contact": contact}
    if sys.stdin.isatty() and sys.stderr.isatty() and not options.json:
        owner = {key: given or _asked(key) for key, given in owner.items()}
    folder, files = write_new(name, out, source=source, wiki=wiki, subreddit=subreddit, owner=owner)
    argument = as_argument(name, folder)
    if options.json:
        show_summary({"command": "profile new", "path": str(folder)}, True)
        return
    typer.echo(f"{folder}/ contains {' and '.join(files)}. Next:\n")
    typer.echo(f"  kb profile check {argument}")
    typer.echo(f"  kb demo --profile {argument} --data data/{name}-demo")
    typer.echo(f"  kb youtube crawl --profile {argument} --data data/{name} --plan")


_QUESTIONS = {
    "licence": "Licence of what you release, such as CC-BY-4.0 (Enter: decide later)",
    "creator": "Who makes the data set: family name, given name (Enter: decide later)",
    "contact": "E-mail or web address for requests for removal (Enter: decide later)",
}


def _asked(key: str) -> str | None:
    answer: str = typer.prompt(_QUESTIONS[key], default="", show_default=False, err=True)
    return answer.strip() or None


@command(
    app,
    raw=True,
    json="errors, warnings, notes, findings (level, file, line, key, what, fix), hits",
    data="may read",
    examples=[
        "kb profile check                         the profile that other commands would use",
        "kb profile check gardening               everything that is missing or wrong",
        "kb profile check gardening --data DIR    and matches of each keyword in transcripts",
        "kb profile check gardening --online      and whether channels, wiki and subreddit exist",
    ],
)
def check(
    options: Options,
    name: Annotated[
        str | None,
        typer.Argument(metavar="[NAME|FILE]", help="A profile by name, or its .toml file."),
    ] = None,
    online: Annotated[
        bool,
        typer.Option(
            "--online",
            help="Ask each service once: a channel search (1 search unit), the wiki's siteinfo and"
            " five of its pages to try the selectors on, the subreddit.",
        ),
    ] = False,
) -> None:
    """Check a profile and its keyword lists, and list all problems with how to fix them.

    Sends nothing without --online. With --data (or KB_DATA) it counts the matches of each keyword
    in the transcripts of clean/youtube, and tries the wiki's selectors on captured pages. The exit
    code is 2 if there is an error, and 0 with warnings and notes.
    """
    from kb.cli.commands.profile_files import examine
    from kb.core.config.profile import find_profile
    from kb.core.config.section import ERROR, LEVELS, NOTE, Finding

    if name is not None and options.profile not in (None, name):
        raise SettingError(f"two profiles are named, {name} and {options.profile}")
    path = find_profile(name) if name is not None else _current_profile(options)
    checked = examine(path)
    findings = list(checked.findings)
    tried = _Tried([], [], [])
    if checked.profile is not None and all(finding.level != ERROR for finding in findings):
        tried = _try(options, checked.profile, online=online)
        findings += tried.findings
    elif online or options.data is not None:
        what = "keywords and services were not tried"
        findings.append(Finding(NOTE, path.name, 0, "", what, "fix the errors first"))
    if not options.json:
        typer.echo(f"{path}:" if findings else f"{path}: no problems found")
        if findings:
            typer.echo(_table(findings))
        _show_hits(tried.hits)
    summary = Summary(
        command="profile check",
        profile=checked.profile.name if checked.profile else str(path),
        **{f"{level}s": sum(finding.level == level for finding in findings) for level in LEVELS},
    )
    if online:
        summary["requests"] = sum(cost.requests for _, cost, _ in tried.answers)
        summary["units"] = sum(cost.units for _, cost, _ in tried.answers)
    if options.json:
        summary["findings"] = [finding._asdict() for finding in findings]
        summary["hits"] = tried.hits
    show_summary(summary, options.json)
    if code := _exit_code(findings, tried):
        raise typer.Exit(code)


def _exit_code(findings: list[Finding], tried: _Tried) -> int:
    """2 for an error in the profile, else the code of the worst answer of a service, else 0."""
    from kb.core.config.section import ERROR

    if any(found.level == ERROR and not found.file.startswith("online") for found in findings):
        return 2
    codes = {code for _, _, code in tried.answers}
    return next((code for code in (2, 1, 4, 3) if code in codes), 0)  # the worst first


class _Tried(NamedTuple):
    """What the use of a profile without errors has shown: findings, matches of keywords, and the
    answer of each service as a finding, with its cost and exit code.
    """

    findings: list[Finding]
    hits: list[dict[str, Any]]
    answers: list[tuple[Finding, QuestionCost, int]]


def _try(options: Options, profile: Profile, *, online: bool) -> _Tried:
    """Use a profile on the data root, if one is named, and on the services, if `online`."""
    from kb.cli.commands.profile_files import (
        ask,
        captured_pages,
        contact_findings,
        keyword_hits,
        selector_findings,
    )

    # The command only reads, so the data root may be another domain's.
    run = replace(replace(options, profile=None).make_run(needs="nothing"), profile=profile)
    findings: list[Finding] = []
    hits: list[dict[str, Any]] = []
    pages: list[str] = []
    # Not the default data root, which may be any domain's.
    is_named = "kb_data" in run.settings.model_fields_set and run.root.is_dir()
    if options.data is not None or is_named:
        hits, findings = keyword_hits(run)
        pages = captured_pages(run.root)
    findings += contact_findings(run)
    answers = list(ask(run)) if online else []
    findings += [finding for finding, _, _ in answers]
    pages += [page for _, cost, _ in answers for page in cost.pages]
    if pages:
        findings += selector_findings(profile, pages)
    return _Tried(findings, hits, answers)


@command(
    app,
    raw=True,
    json="keywords, not_proposed, not_proposed_by, path",
    data="reads",
    examples=[
        "kb profile keywords --data data/gardening                    rows to stdout",
        "kb profile keywords --data data/gardening --out more.tsv     rows to a new file",
    ],
)
def keywords(
    options: Options,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help="Write to this new file. [default: stdout]"),
    ] = None,
) -> None:
    """Propose rows of the keyword list from the crawled wiki's titles, redirects and categories.

    The rows are for you to choose from: a title is the keyword, redirects are its forms, a category
    is its kind, and everyday words get the rule `near`. Keywords of the profile's own list are left
    out. Sends nothing.
    """
    run = options.make_run()
    proposal = _proposal(run)
    if out is not None and (out.exists() or out.is_symlink()):
        raise SettingError(f"{out} already exists, and is not overwritten")
    summary = Summary(
        command="profile keywords",
        keywords=len(proposal.rows),
        not_proposed=proposal.left.total(),
        not_proposed_by=dict(sorted(proposal.left.items())),
    )
    show_list(proposal.text(run.profile.title), out, summary, options.json)


def _proposal(run: Run) -> Proposal:
    from kb.pairs import keywords
    from kb.pairs.keyword_proposal import propose
    from kb.store.rawlog import rawlog
    from kb.wiki.parse.answers import named_pages

    if not rawlog.segments(run.root, "wiki", "pages"):
        raise SettingError(
            f"no wiki was crawled into {run.root}",
            hint="run `kb wiki crawl` first, or name its data root with --data",
        )
    section = run.profile.pairs
    listed = bool(section and (section.keyword_files or section.include))
    known = keywords.load(run.profile).phrases if listed else ()
    return propose(named_pages(run.root).values(), known)


def _current_profile(options: Options) -> Path:
    """The file of the profile that other commands with these options would use."""
    from kb.artifacts import domain_binding
    from kb.core.config.profile import DEFAULT, find_profile
    from kb.core.config.settings import load_settings

    settings = load_settings(kb_data=options.data, kb_profile=options.profile)
    if settings.kb_profile is not None:
        return find_profile(settings.kb_profile)
    root = settings.kb_data.expanduser().absolute()
    bound = domain_binding.remembered(root)
    return domain_binding.load(root, bound)[0].path if bound else find_profile(DEFAULT)


def _show_hits(hits: list[dict[str, Any]]) -> None:
    columns = ("keyword", "kind", "rule", "matches", "alone")
    shown = [hit for hit in hits if hit["matches"]]
    if not shown:
        return
    typer.echo()
    show_row(columns)
    for hit in shown:
        show_row(hit[name] for name in columns)
        for example in hit["examples"]:
            show_row([example], indent="    ")
    typer.echo()


def _table(findings: list[Finding]) -> str:
    """Level, place, finding and fix, in columns."""
    rows = [("level", "where", "finding", "how to fix it")]
    rows += [(finding.level, finding.where, finding.what, finding.fix) for finding in findings]
    columns = [[terminal.one_line(cell) for cell in column] for column in zip(*rows, strict=True)]
    widths = [max(map(len, column)) for column in columns]
    lines = []
    for level, where, what, fix in zip(*columns, strict=True):
        rest = f"{what}  |  {fix}" if fix else what
        lines.append(f"{level:<{widths[0]}}  {where:<{widths[1]}}  {rest}")
    return "\n".join(lines)
