"""`kb profile`: a new domain's profile, and all that can be known about one before a crawl."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from kb.cli.framework.command import command, group

if TYPE_CHECKING:
    from collections.abc import Iterable

    from kb.cli.commands.profile.online import ServiceCheck
    from kb.cli.framework.options import Options
    from kb.core.profile.finding import Finding

app = group("Profiles of domains: a new one, and what is wrong with one.")


@command(
    app,
    raw=True,
    without=("data", "profile"),
    json="path",
    examples=[
        "kb profile new gardening                 a folder with profile.toml and keywords.tsv",
        "kb profile new gardening --wiki https://wiki.example.org --subreddit gardening",
        "kb profile new mine --from minecraft     another profile's values to start from",
    ],
)
def new(
    options: Options,
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="The domain's short name, such as gardening.")
    ],
    wiki: Annotated[
        str | None, typer.Option("--wiki", metavar="URL", help="The root of its MediaWiki.")
    ] = None,
    subreddit: Annotated[
        str | None, typer.Option("--subreddit", metavar="NAME", help="Its subreddit, without r/.")
    ] = None,
    source: Annotated[
        str | None,
        typer.Option("--from", metavar="NAME|FILE", help="A profile whose values are taken."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="DIR",
            help="The folder to write."
            " [default: data/profiles/NAME in a checkout, elsewhere ./NAME]",
        ),
    ] = None,
) -> None:
    """Write a commented profile and keyword list of a new domain, ready to be filled in.

    Every key stands in it with its default, its unit and what it is for; FILL-IN marks what only
    you know. Nothing is overwritten. In the end it prints the commands that come next.
    """
    from kb.cli.commands.profile.new import as_given, write_new
    from kb.cli.framework import outcome

    folder, files = write_new(name, out, source=source, wiki=wiki, subreddit=subreddit)
    given = as_given(name, folder)
    if options.json:
        outcome.show_summary({"command": "profile new", "path": str(folder)}, True)
        return
    typer.echo(f"{folder}/ holds {' and '.join(files)}. Next:\n")
    typer.echo(f"  kb profile check {given}")
    typer.echo(f"  kb demo --profile {given} --data data/{name}-demo")
    typer.echo(f"  kb youtube crawl --profile {given} --data data/{name} --plan")


@command(
    app,
    raw=True,
    json="errors, warnings, notes, findings (level, file, line, key, what, mend), hits",
    examples=[
        "kb profile check                         the profile that other commands would use",
        "kb profile check gardening               what is missing or wrong, all of it",
        "kb profile check gardening --data DIR    and what each keyword hits in transcripts there",
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
            " five of its pages, on which the selectors are tried, the subreddit.",
        ),
    ] = False,
) -> None:
    """Check a profile and its keyword lists: all that is wrong at once, with how to mend it.

    Sends nothing without --online. With --data (or KB_DATA) it shows what each keyword hits in the
    transcripts of clean/youtube, and tries the wiki's selectors on captured pages. Exit code 2
    where there is an error; warnings and notes are 0.
    """
    from kb.cli.commands.profile.check import contact_of, examine
    from kb.cli.commands.profile.hits import hits_of, looks_at_data, run_of
    from kb.cli.commands.profile.selectors import captured_pages, findings_of
    from kb.cli.framework import outcome
    from kb.core.errors import SettingError
    from kb.core.profile import find_profile
    from kb.core.profile.finding import ERROR, LEVELS, NOTE, Finding
    from kb.core.verdict import Summary

    if name is not None and options.profile not in (None, name):
        raise SettingError(f"two profiles are named, {name} and {options.profile}")
    path = find_profile(name) if name is not None else _usual(options)
    checked = examine(path)
    findings = list(checked.findings)
    hits: list[dict[str, Any]] = []
    answers: list[ServiceCheck] = []
    usable = all(one.level != ERROR for one in findings)
    if usable and checked.profile is not None:
        run = run_of(options, checked.profile)
        pages: list[str] = []
        if looks_at_data(options, run):
            hits, told = hits_of(run)
            findings += told
            pages = captured_pages(run.root)
        findings += contact_of(run)
        if online:
            from kb.cli.commands.profile.online import ask

            answers = list(ask(run))
            findings += [answer.finding for answer in answers]
            pages += [page for answer in answers for page in answer.pages]
        if pages:
            findings += findings_of(checked.profile, pages)
    elif online or options.data is not None:
        said = "keywords and services were not tried"
        findings.append(Finding(NOTE, path.name, 0, "", said, "mend the errors first"))
    if not options.json:
        typer.echo(_table(findings) if findings else f"{path}: nothing to mend")
        _show_hits(hits)
    summary = Summary(
        command="profile check",
        profile=checked.profile.name if checked.profile else str(path),
        **{f"{level}s": sum(one.level == level for one in findings) for level in LEVELS},
    )
    if online:
        summary |= {
            "requests": sum(answer.requests for answer in answers),
            "units": sum(answer.units for answer in answers),
        }
    if options.json:
        summary["findings"] = [one._asdict() for one in findings]
        summary["hits"] = hits
    outcome.show_summary(summary, options.json)
    code = _code(findings, answers)
    if code:
        raise typer.Exit(code)


@command(
    app,
    raw=True,
    json="keywords, not_proposed, not_proposed_by, path",
    examples=[
        "kb profile keywords --data data/gardening                    rows to stdout",
        "kb profile keywords --data data/gardening --out more.tsv     into a file of its own",
    ],
)
def keywords(
    options: Options,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help="The file to write. [default: stdout]"),
    ] = None,
) -> None:
    """Propose rows of the keyword list from the crawled wiki's titles, redirects and categories.

    For a person to strike from: a title is the keyword, redirects are its forms, a category is its
    kind; everyday words get the rule near. What the profile's list has is left out. Sends nothing.
    """
    from kb.cli.commands.profile.keywords import proposed
    from kb.cli.framework import outcome
    from kb.core.errors import SettingError
    from kb.core.verdict import Summary
    from kb.store.atomic import write_text

    run = options.make_run()
    proposal = proposed(run)
    text = proposal.text(run.profile.title)
    if out is None:
        typer.echo(text, nl=False)
    else:
        if out.exists() or out.is_symlink():
            raise SettingError(f"{out} is there already, and is not overwritten")
        write_text(out.expanduser().absolute(), text)
    summary = Summary(
        command="profile keywords",
        keywords=len(proposal.rows),
        not_proposed=proposal.left.total(),
        not_proposed_by=dict(sorted(proposal.left.items())),
    )
    if options.json or out is not None:
        outcome.show_summary(summary, options.json)
    else:  # stdout is the list alone, ready to be sent into a file
        typer.echo(summary.line(), err=True)


def _usual(options: Options) -> Path:
    """The file of the profile that a command with these options would use."""
    from kb.artifacts import belonging
    from kb.core.profile import DEFAULT, find_profile
    from kb.core.settings import load_settings

    settings = load_settings(kb_data=options.data, kb_profile=options.profile)
    if settings.kb_profile is not None:
        return find_profile(settings.kb_profile)
    root = settings.kb_data.expanduser().absolute()
    bound = belonging.remembered(root)
    if bound is None:
        return find_profile(DEFAULT)
    return belonging.load(root, bound)[0].path


def _show_hits(hits: list[dict[str, Any]]) -> None:
    from kb.core import terminal

    shown = [hit for hit in hits if hit["matches"]]
    if not shown:
        return
    typer.echo("\nkeyword\tkind\trule\tmatches\talone")
    for hit in shown:
        cells = ("keyword", "kind", "rule", "matches", "alone")
        typer.echo("\t".join(terminal.one_line(str(hit[name])) for name in cells))
        for example in hit["examples"]:
            typer.echo(f"    {terminal.one_line(example)}")
    typer.echo("")


def _table(findings: Iterable[Finding]) -> str:
    """Level, where, what and how to mend it, in columns."""
    from kb.core import terminal

    one = terminal.one_line
    rows = [("level", "where", "finding", "how to mend it")]
    rows += [(one.level, one.where, one.what, one.mend) for one in findings]
    rows = [(one(level), one(where), one(what), one(mend)) for level, where, what, mend in rows]
    widths = [max(len(row[column]) for row in rows) for column in range(2)]
    lines = []
    for level, where, what, mend in rows:
        rest = f"{what}  |  {mend}" if mend else what
        lines.append(f"{level:<{widths[0]}}  {where:<{widths[1]}}  {rest}")
    return "\n".join(lines)


def _code(findings: Iterable[Finding], answers: Iterable[Any]) -> int:
    """2 where the profile can't be used, else what a service's answer means."""
    from kb.core.profile.finding import ERROR

    codes = {answer.code for answer in answers}
    offline = any(one.level == ERROR and not one.file.startswith("online") for one in findings)
    if offline or 2 in codes:
        return 2
    return min(codes - {0}, default=0)
