"""`kb profile`: make a profile for a new domain, and check one before a crawl."""

from __future__ import annotations

import re
import shlex
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.messages import show_row, show_summary
from kb.cli.framework.options import Options
from kb.core import terminal
from kb.core.config.profile import is_shipped, load_profile
from kb.core.config.profile.check import check_file
from kb.core.config.profile.check_finding import ERROR
from kb.core.config.profile.new import KEYWORDS, profile_text
from kb.core.config.profile.plausibility import subreddit_meant
from kb.core.context import Run
from kb.core.errors import ProfileError, SettingError
from kb.core.installation import PROFILE_FILE
from kb.core.installation import folder as shared
from kb.core.summary import Summary
from kb.store import leftovers
from kb.store.atomic import write_text

if TYPE_CHECKING:
    from kb.core.config.profile.check_finding import Finding, QuestionCost
    from kb.pairs.keyword_proposal import Proposal


app = group("Make and check the profile of a new domain.")


@command(
    app,
    raw=True,
    without=("data", "profile"),
    json="path",
    examples=[
        "kb profile new gardening                 a folder with profile.toml and keywords.tsv",
        "kb profile new gardening --wiki https://wiki.example.org --subreddit gardening",
        "kb profile new mine --from minecraft     start from another profile's values",
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
    know. Nothing is overwritten. Finally the next commands are printed.
    """
    folder, files = write_new(name, out, source=source, wiki=wiki, subreddit=subreddit)
    argument = as_argument(name, folder)
    if options.json:
        show_summary({"command": "profile new", "path": str(folder)}, True)
        return
    typer.echo(f"{folder}/ contains {' and '.join(files)}. Next:\n")
    typer.echo(f"  kb profile check {argument}")
    typer.echo(f"  kb demo --profile {argument} --data data/{name}-demo")
    typer.echo(f"  kb youtube crawl --profile {argument} --data data/{name} --plan")


@command(
    app,
    raw=True,
    json="errors, warnings, notes, findings (level, file, line, key, what, fix), hits",
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
    from kb.cli.commands.profile_check import (
        captured_pages,
        contact_findings,
        examine,
        keyword_hits,
        selector_findings,
    )
    from kb.core.config.profile import find_profile
    from kb.core.config.profile.check_finding import ERROR, LEVELS, NOTE, Finding

    if name is not None and options.profile not in (None, name):
        raise SettingError(f"two profiles are named, {name} and {options.profile}")
    path = find_profile(name) if name is not None else _current_profile(options)
    checked = examine(path)
    findings = list(checked.findings)
    hits: list[dict[str, Any]] = []
    answers: list[tuple[Finding, QuestionCost, int]] = []
    if checked.profile is not None and all(one.level != ERROR for one in findings):
        # The command only reads, so the data root may be another domain's.
        run = replace(options, profile=None).make_run(needs="nothing", exists=bool(options.data))
        run = replace(run, profile=checked.profile)
        pages: list[str] = []
        # Not the default data root, which may be any domain's.
        is_named = "kb_data" in run.settings.model_fields_set and run.root.is_dir()
        if options.data is not None or is_named:
            hits, more = keyword_hits(run)
            findings += more
            pages = captured_pages(run.root)
        findings += contact_findings(run)
        if online:
            from kb.cli.commands.profile_check import ask

            answers = list(ask(run))
            findings += [finding for finding, _, _ in answers]
            pages += [page for _, cost, _ in answers for page in cost.pages]
        if pages:
            findings += selector_findings(checked.profile, pages)
    elif online or options.data is not None:
        what = "keywords and services were not tried"
        findings.append(Finding(NOTE, path.name, 0, "", what, "fix the errors first"))
    if not options.json:
        typer.echo(_table(findings) if findings else f"{path}: no problems found")
        _show_hits(hits)
    summary = Summary(
        command="profile check",
        profile=checked.profile.name if checked.profile else str(path),
        **{f"{level}s": sum(one.level == level for one in findings) for level in LEVELS},
    )
    if online:
        summary["requests"] = sum(cost.requests for _, cost, _ in answers)
        summary["units"] = sum(cost.units for _, cost, _ in answers)
    if options.json:
        summary["findings"] = [one._asdict() for one in findings]
        summary["hits"] = hits
    show_summary(summary, options.json)
    offline = any(one.level == ERROR and not one.file.startswith("online") for one in findings)
    codes = {code for _, _, code in answers} | ({2} if offline else set())
    code = 2 if 2 in codes else min(codes - {0}, default=0)
    if code:
        raise typer.Exit(code)


@command(
    app,
    raw=True,
    json="keywords, not_proposed, not_proposed_by, path",
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
    from kb.store.atomic import write_text

    run = options.make_run()
    proposal = _proposal(run)
    text = proposal.text(run.profile.title)
    if out is None:
        typer.echo(text, nl=False)
    else:
        if out.exists() or out.is_symlink():
            raise SettingError(f"{out} already exists, and is not overwritten")
        write_text(out.expanduser().absolute(), text)
    summary = Summary(
        command="profile keywords",
        keywords=len(proposal.rows),
        not_proposed=proposal.left.total(),
        not_proposed_by=dict(sorted(proposal.left.items())),
    )
    if options.json or out is not None:
        show_summary(summary, options.json)
    else:  # stdout holds the list alone, ready to be redirected
        typer.echo(summary.line(), err=True)


def _proposal(run: Run) -> Proposal:
    from kb.pairs import keywords
    from kb.pairs.keyword_proposal import PageNames, propose
    from kb.store.rawlog import rawlog
    from kb.wiki.parse.answers import named_pages
    from kb.wiki.source import Wiki

    if not rawlog.segments(run.root, Wiki.name, "pages"):
        raise SettingError(
            f"no wiki was crawled into {run.root}",
            hint="run `kb wiki crawl` first, or name its data root with --data",
        )
    section = run.profile.pairs
    listed = bool(section and (section.keyword_files or section.include))
    known = keywords.load(run.profile).phrases if listed else ()
    names = [
        PageNames(
            page.title.removeprefix(f"{page.prefix}:"),
            [title.removeprefix(f"{page.prefix}:") for title in page.redirects],
            page.categories,
        )
        for page in named_pages(run.root)
    ]
    return propose(names, known)


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
    rows += [(one.level, one.where, one.what, one.fix) for one in findings]
    columns = [[terminal.one_line(cell) for cell in column] for column in zip(*rows, strict=True)]
    widths = [max(map(len, column)) for column in columns]
    lines = []
    for level, where, what, fix in zip(*columns, strict=True):
        rest = f"{what}  |  {fix}" if fix else what
        lines.append(f"{level:<{widths[0]}}  {where:<{widths[1]}}  {rest}")
    return "\n".join(lines)


def write_new(
    name: str,
    out: Path | None,
    *,
    source: str | None = None,
    wiki: str | None = None,
    subreddit: str | None = None,
) -> tuple[Path, list[str]]:
    """Write the files, and return their folder and names. Nothing is overwritten.

    Raises SettingError for a wrong name or URL and for an existing file, ProfileError for a
    `source` that can't be read.
    """
    _check_name(name)
    base = load_profile(source) if source is not None else None
    text = profile_text(name, wiki=wiki, subreddit=subreddit, source=base)
    _check_given(text, wiki=wiki, subreddit=subreddit)
    files = {PROFILE_FILE: text}
    if base is None:
        files["keywords.tsv"] = KEYWORDS
    elif base.pairs is not None:
        files |= {
            listed: _read_list(base.resolve_file(listed)) for listed in base.pairs.keyword_files
        }
    folder = out if out is not None else _home() / name
    existing = [file for file in files if (folder / file).exists() or (folder / file).is_symlink()]
    # A killed run leaves some of the files, with the same content.
    for file in existing:
        if len(existing) == len(files) or not _has_content(folder / file, files[file]):
            raise SettingError(
                f"{folder / file} already exists, and is not overwritten",
                hint="choose another NAME, or another folder with --out",
            )
    for file, content in files.items():
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        leftovers.remove_temporary(folder / file)
        write_text(folder / file, content)
    return folder, list(files)


def _has_content(path: Path, text: str) -> bool:
    try:
        return not path.is_symlink() and path.read_bytes() == text.encode()
    except OSError:
        return False


def as_argument(name: str, folder: Path) -> str:
    """The new profile as an argument of other commands."""
    if is_shipped(name) and folder.resolve() == (shared("profiles") / name).resolve():
        return name
    return shlex.quote(str(folder / PROFILE_FILE))


def _check_name(name: str) -> None:
    if re.fullmatch(r"[a-z0-9][a-z0-9_-]*", name):
        return
    plain = re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")
    raise SettingError(
        f"invalid profile name {name!r}: use only lower-case letters, digits, - and _",
        hint=f"write {plain}" if plain else "for example rock-gardens",
    )


def _check_given(text: str, *, wiki: str | None, subreddit: str | None) -> None:
    """Raise SettingError now for values that would be refused later."""
    given = {"wiki.url": ("--wiki", wiki), "reddit.subreddit": ("--subreddit", subreddit)}
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / PROFILE_FILE
        path.write_text(text, encoding="utf-8")
        wrong = {one.key: one for one in check_file(path).findings if one.level == ERROR}
    for key, (option, value) in given.items():
        if value is not None and key in wrong:
            guess = subreddit_meant(value) if key == "reddit.subreddit" else ""
            raise SettingError(f"{option} is {value!r}", hint=guess or wrong[key].fix)


def _home() -> Path:
    """Where new profiles go: the profiles of the current checkout, else the current folder."""
    profiles, here = shared("profiles"), Path.cwd()
    checkout = profiles.parent.parent
    if (checkout / "pyproject.toml").is_file() and here.is_relative_to(checkout):
        return profiles
    return Path()


def _read_list(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ProfileError(f"the keyword list {path} can't be read: {error}") from None
