"""`kb profile`: a new domain's profile, and everything that can be known about one before a crawl."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from kb.cli.command import command, group

if TYPE_CHECKING:
    from collections.abc import Iterable

    from kb.cli.options import Options
    from kb.core.context import Run
    from kb.core.profile import Profile
    from kb.core.profile.finding import Finding

app = group("Profiles of domains: a new one, and what is wrong with one.")

_UNUSED = 10  # keywords without a hit that are named
_EXAMPLES = 3


@command(
    app,
    raw=True,
    without=("data", "profile"),
    examples=[
        "kb profile new gardening                       a folder with profile.toml and keywords.tsv",
        "kb profile new gardening --wiki https://wiki.example.org --subreddit gardening",
        "kb profile new mine --from minecraft           another profile's values to start from",
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
    from kb.cli import outcome
    from kb.core.errors import SettingError
    from kb.core.profile import load_profile
    from kb.core.profile.new import KEYWORDS, profile_text
    from kb.store.atomic import write_text

    _check_name(name)
    base = load_profile(source) if source is not None else None
    folder = out if out is not None else _home() / name
    files = {
        folder / "profile.toml": profile_text(name, wiki=wiki, subreddit=subreddit, source=base)
    }
    if base is None:
        files[folder / "keywords.tsv"] = KEYWORDS
    elif base.pairs is not None:
        for listed in base.pairs.keyword_files:
            files[folder / listed] = _list_of(base.beside(listed))
    for path in files:
        if path.exists() or path.is_symlink():
            raise SettingError(
                f"{path} is there already, and is not overwritten",
                hint="choose another NAME, or a folder with --out",
            )
    for path, text in files.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, text)
    given = _as_given(name, folder)
    if options.json:
        outcome.show_summary({"command": "profile new", "path": str(folder)}, True)
        return
    typer.echo(f"{folder}/ holds {' and '.join(path.name for path in files)}. Next:\n")
    typer.echo(f"  kb profile check {given}")
    typer.echo(f"  kb demo --profile {given} --data data/{name}-demo")
    typer.echo(f"  kb youtube crawl --profile {given} --data data/{name} --plan")


def _check_name(name: str) -> None:
    import re

    from kb.core.errors import SettingError

    if re.fullmatch(r"[a-z0-9][a-z0-9_-]*", name):
        return
    plain = re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")
    raise SettingError(
        f"{name!r} is no name of a profile: small letters, digits, - and _ only",
        hint=f"write {plain}" if plain else "such as rock-gardens",
    )


def _home() -> Path:
    """Where new profiles go: with the others in the checkout that one stands in, else here."""
    from kb.core.resources import folder

    profiles, here = folder("profiles"), Path.cwd()
    checkout = profiles.parent.parent
    if (checkout / "pyproject.toml").is_file() and here.is_relative_to(checkout):
        return profiles
    return Path()


def _list_of(path: Path) -> str:
    from kb.core.errors import ProfileError

    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ProfileError(f"the keyword list {path} can't be read: {error}") from None


def _as_given(name: str, folder: Path) -> str:
    """How the new profile is named to other commands."""
    from kb.core.profile import is_shipped
    from kb.core.resources import folder as part

    if is_shipped(name) and folder.resolve() == (part("profiles") / name).resolve():
        return name
    return shlex.quote(str(folder / "profile.toml"))


@command(
    app,
    raw=True,
    examples=[
        "kb profile check                               the profile that other commands would use",
        "kb profile check gardening                     what is missing or wrong, all of it",
        "kb profile check gardening --data data/demo    and what each keyword hits in transcripts there",
        "kb profile check gardening --online            and whether channels, wiki and subreddit are there",
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
            help="Ask each service once: a channel search (1 search unit), the wiki's siteinfo,"
            " the subreddit.",
        ),
    ] = False,
) -> None:
    """Check a profile and its keyword lists: everything that is wrong, at once, with how to mend it.

    Sends nothing without --online. With --data (or KB_DATA) it shows what each keyword hits in the
    transcripts of clean/youtube. Exit code 2 where there is an error; warnings and notes are 0.
    """
    from kb.cli import outcome
    from kb.cli.profile_check import examine
    from kb.core.errors import SettingError
    from kb.core.profile import find_profile
    from kb.core.profile.finding import ERROR, LEVELS, NOTE, Finding
    from kb.core.verdict import Summary

    if name is not None and options.profile not in (None, name):
        raise SettingError(f"two profiles are named, {name} and {options.profile}")
    path = find_profile(name) if name is not None else _usual(options)
    checked = examine(path)
    findings, hits, answers = list(checked.findings), [], []
    usable = all(one.level != ERROR for one in findings)
    if usable and checked.profile is not None:
        run = _run(options, checked.profile)
        if _looks_at_data(options, run):
            hits, told = _hits(run)
            findings += told
        if online:
            from kb.cli.profile_online import ask

            answers = list(ask(run))
            findings += [answer.finding for answer in answers]
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


def _usual(options: Options) -> Path:
    """The file of the profile that a command with these options would use."""
    from kb.core.profile import DEFAULT, find_profile
    from kb.core.settings import load_settings
    from kb.store import belonging

    settings = load_settings(kb_data=options.data, kb_profile=options.profile)
    if settings.kb_profile is not None:
        return find_profile(settings.kb_profile)
    root = settings.kb_data.expanduser().absolute()
    bound = belonging.remembered(root)
    if bound is None:
        return find_profile(DEFAULT)
    return belonging.load(root, bound)[0].path


def _run(options: Options, profile: Profile) -> Run:
    """A Run of the checked profile. It only reads, so the data root may be another domain's."""
    from dataclasses import replace

    from kb.core.errors import SettingError

    run = replace(options, profile=None).make_run(needs="nothing")
    if options.data is not None and not run.root.is_dir():
        raise SettingError(
            f"there is no data root {run.root}",
            hint="check --data; `kb demo` makes one to try on",
        )
    return replace(run, profile=profile)


def _looks_at_data(options: Options, run: Run) -> bool:
    """Whether a data root was named, by option or setting; the default one may be anybody's."""
    return options.data is not None or (
        "kb_data" in run.settings.model_fields_set and run.root.is_dir()
    )


def _hits(run: Run) -> tuple[list[dict[str, Any]], list[Finding]]:
    """What each keyword hits in clean transcripts, most first; and what stands in the way."""
    from kb.core.errors import FatalError, MissingExtra
    from kb.core.profile.finding import NOTE, Finding
    from kb.pairs.show import keyword_lines

    if run.profile.pairs is None:
        return [], []
    try:
        lines = list(keyword_lines(run, _EXAMPLES, rare=True))
    except (FatalError, MissingExtra) as error:
        note = Finding(NOTE, "keywords", 0, "", f"were not tried: {error}", error.hint)
        return [], [note]
    found = [line._asdict() for line in lines]
    unused = [line.keyword for line in lines if not line.matches]
    if not unused:
        return found, []
    named = ", ".join(unused[:_UNUSED]) + (" …" if len(unused) > _UNUSED else "")
    said = f"{len(unused):,} of {len(lines):,} hit nothing in {run.root}: {named}"
    mend = "people may say them otherwise: add forms"
    return found, [Finding(NOTE, "keywords", 0, "", said, mend)]


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

    rows = [("level", "where", "finding", "how to mend it")]
    rows += [(one.level, one.where, one.what, one.mend) for one in findings]
    rows = [tuple(terminal.one_line(cell) for cell in row) for row in rows]
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
