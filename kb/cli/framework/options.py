"""The options that commands share, and the Run made from them."""

from __future__ import annotations

import copy
import os
import re
from dataclasses import dataclass, fields
from datetime import datetime
from enum import StrEnum
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
import typer.main

from kb.cli.framework.messages import warn
from kb.cli.framework.progress_bars import choose_progress
from kb.core import clock
from kb.core.errors import DamagedData, MissingExtra, ProfileError, SettingError

if TYPE_CHECKING:
    from kb.core.config.profile import Profile
    from kb.core.config.settings import Settings
    from kb.core.context import Run


class Engine(StrEnum):
    """Where stages run."""

    local = "local"
    dask = "dask"


RUNS: list[Run] = []
"""Those that the command which runs now has made; a nested one makes its own."""

DataUse = Literal["writes", "makes", "reads", "may read", "ignores"]
"""What a command does with its data root, which decides what it accepts as `--data`:

    writes      a data root that is there
    makes       a data root, which need not be there yet
    reads       a data root or a download that is there; what it makes of one goes elsewhere
    may read    the same, but where none is named, none need be there
    ignores     anything
"""


@dataclass(frozen=True)
class Options:
    """The options that commands share, and their values in one command line.

    A command has those of COMMON and those that it declares. Each command describes `limit`,
    `again` and `json` itself (see `command`). `use` is no option but what the command declares.
    """

    workers: Annotated[
        int | None,
        typer.Option(
            "--workers",
            min=1,
            metavar="N",
            help="Parallel workers. [default: one a core, and no more processes for a few MiB]",
        ),
    ] = None
    limit: Annotated[int | None, typer.Option("--limit", min=1, metavar="N")] = None
    wait: Annotated[
        bool,
        typer.Option(
            "--wait", help="Sleep until a spent quota or limit is reset instead of stopping."
        ),
    ] = False
    again: Annotated[bool, typer.Option("--again")] = False
    engine: Annotated[
        Engine,
        typer.Option(
            "--engine", help="Where stages run: processes on this machine, or a Dask cluster."
        ),
    ] = Engine.local
    scheduler: Annotated[
        str | None,
        typer.Option(
            "--scheduler", metavar="ADDRESS", help="The Dask scheduler, e.g. tcp://10.0.0.1:8786."
        ),
    ] = None
    data: Annotated[
        Path | None,
        typer.Option("--data", metavar="DIR", help="The data root. [default: KB_DATA, or data]"),
    ] = None
    profile: Annotated[
        str | None,
        typer.Option(
            "--profile",
            metavar="NAME|FILE",
            help="The domain: a shipped profile or a .toml file."
            " [default: KB_PROFILE, or the data root's own, or minecraft]",
        ),
    ] = None
    quiet: Annotated[
        bool, typer.Option("--quiet", help="No progress; warnings and errors only.")
    ] = False
    json: Annotated[bool, typer.Option("--json")] = False
    debug: Annotated[bool, typer.Option("--debug", help="More log lines, and tracebacks.")] = False
    log: Annotated[
        Path | None,
        typer.Option(
            "--log",
            metavar="FILE",
            help="Append a line an event to FILE; a new one begins at 10 MB, five are kept."
            " [default: KB_LOG]",
        ),
    ] = None
    use: DataUse = "ignores"

    def make_run(
        self,
        *,
        dotenv: bool = True,
        needs: str = "profile",
        checks: bool = False,
        addresses: bool = False,
        **settings: object,
    ) -> Run:
        """The Run of these options; `settings` (field names) win over the environment.

        `needs`: "profile"; "root" for a command that reads the data root without a profile's
        rules, so that it works where the profile's file is missing; "nothing" for one that reads
        neither. `checks`: refuse a profile with errors in it or its keyword lists. `addresses`: the
        data root may be an address, which the command itself reads.
        Raises UsageError for a data root that `use` does not allow, SettingError, ProfileError or
        OtherService, before anything is sent or written.
        """
        from kb.core.arrow_without_pandas import without_pandas
        from kb.core.config.addresses import address_of
        from kb.core.config.settings import load_settings, unknown_names
        from kb.core.context import Run, default_workers
        from kb.net import redact

        without_pandas()
        given = {"kb_data": self.data, "kb_profile": self.profile, **settings}
        loaded = load_settings(dotenv=dotenv, **given)
        redact.know(loaded.secret_values())
        for line in unknown_names(dotenv=dotenv):
            warn(line)
        if self.scheduler and self.engine != Engine.dask:
            raise SettingError("--scheduler needs --engine dask")
        if self.engine == Engine.dask:
            from kb.core.dask_engine import check_scheduler

            check_scheduler(self.scheduler)
        root = loaded.kb_data.expanduser().absolute()
        if root.exists() and not root.is_dir():
            raise SettingError(
                f"the data root {root} is not a folder",
                hint="choose another with --data or KB_DATA",
            )
        # Not what a `.env` names, which may have come with somebody's data.
        named = "kb_profile" not in settings and bool(self.profile or os.environ.get("KB_PROFILE"))
        profile = _profile(loaded.kb_profile, root, needs, named=named)
        if checks:
            from kb.cli.commands.profile_files import refuse

            refuse(profile)
        address = address_of(loaded.kb_data)
        if address and not addresses:
            raise SettingError(
                f"this command reads no addresses such as {address}",
                hint="download the release, or use `kb query` or kb.load in Python",
            )
        if not address:
            root = self.check_root(root, named="kb_data" in loaded.model_fields_set)
        if needs == "profile":
            loaded, profile = in_demo_root(root, loaded, profile)
        run = Run(
            settings=loaded,
            profile=profile,
            root=root,
            workers=self.workers or default_workers(),
            asked=self.workers is not None,
            limit=self.limit,
            wait=self.wait,
            again=self.again,
            engine=str(self.engine),
            scheduler=self.scheduler,
            progress=choose_progress(quiet=self.quiet),
        )
        RUNS.append(run)
        return run

    def check_root(self, root: Path, *, named: bool) -> Path:
        """The data root that an existing `root` names (see `existing`), if `use` allows it; `named`
        by an option or a setting. Raises UsageError.
        """
        from kb.artifacts.data_roots import require_known_format
        from kb.artifacts.table_catalog import existing, refuse_download

        if self.use in ("reads", "writes") or (self.use == "may read" and self.data is not None):
            root = existing(root)
        else:
            require_known_format(root)
        if self.use in ("writes", "makes"):
            refuse_download(root, named=named)
        return root


def data_folder(data: Path | None) -> Path:
    """What --data names, else KB_DATA, else `data` in the working folder."""
    return (data or Path(os.environ.get("KB_DATA") or "data")).expanduser()


# Each command describes these itself.
DESCRIBED = ("limit", "again", "json")
COMMON = ("data", "profile", "quiet", "json", "debug", "log")
SHARED = tuple(field.name for field in fields(Options) if field.name != "use")
# Options of single commands that name what is written; none of it may lie in a download.
WRITTEN = ("out", "env", "truth", "films")
RUNNING = tuple(name for name in SHARED if name not in COMMON)
CLUSTER = ("workers", "engine", "scheduler")  # of what runs in worker processes


@cache
def _shared_options() -> dict[str, Any]:
    declared = typer.Typer(rich_markup_mode=None, add_completion=False)
    declared.command()(Options)
    return {option.name: option for option in typer.main.get_command(declared).params}


def shared_option(name: str, help: str | None = None) -> Any:
    """The shared option of that name for one command, with a `help` of its own."""
    option = copy.copy(_shared_options()[name])
    option.help = help or option.help
    return option


def _profile(name: str | None, root: Path, needs: str, *, named: bool) -> Profile:
    """The profile of that name, which the user may have `named`, else the data root's own, else
    that of a download, else the default.
    """
    from kb.artifacts import domain_binding
    from kb.core.config.profile import DEFAULT, Profile, find_profile, load_profile
    from kb.store.artifact_registry import SUMS

    if needs == "nothing":
        return Profile(name="none", title="none")
    if name is not None:
        place = find_profile(name).resolve().parent
        is_released = (place / SUMS).exists()  # no release runs code
        profile = load_profile(name, named=named and not is_released)
        domain_binding.require_domain(root, profile)
        return profile
    bound = domain_binding.remembered(root)
    try:
        if bound is None:
            return load_profile(domain_binding.profile_of(root) or DEFAULT)
        profile, note = domain_binding.load(root, bound)
    except (ProfileError, DamagedData) as error:
        if needs == "profile":
            raise
        warn(f"{error}; {error.hint}" if error.hint else str(error))
        return Profile(name=bound.name, title=bound.name) if bound else load_profile(DEFAULT)
    if note:
        warn(note)
    return profile


DUMPS = "--dumps"
Dumps = Annotated[
    list[Path] | None,
    typer.Option(
        DUMPS,
        metavar="FILE...",
        help="Archive dumps of posts and comments (zstd, zst_blocks, gzip or plain NDJSON), or a"
        " folder of them, to read instead of asking Reddit. Needs no key and no network.",
    ),
]


class Device(StrEnum):
    """Where a model runs."""

    auto = "auto"
    cpu = "cpu"
    cuda = "cuda"


DeviceOption = Annotated[
    Device,
    typer.Option("--device", help="Where the model runs; auto uses a GPU if there is one."),
]
Films = Annotated[
    list[Path],
    typer.Option(
        "--videos", metavar="DIR", help="A folder with video files; may be given repeatedly."
    ),
]
OnlyPairs = Annotated[
    Path | None,
    typer.Option(
        "--pairs", metavar="FILE", help="Only these pairs: Parquet, as `kb pairs draw` writes."
    ),
]
Aligned = Annotated[
    bool,
    typer.Option(
        "--aligned",
        help="Clips at the times that `kb pairs align` found, without pairs that have none.",
    ),
]
Alignable = Annotated[
    float | None,
    typer.Option(
        "--alignable",
        min=0,
        max=1,
        metavar="P",
        help="With --aligned: only pairs whose text is shown there with this probability or more.",
    ),
]
Plan = Annotated[
    bool, typer.Option("--plan", help="Print what is left and what it costs; send nothing.")
]
Part = Annotated[
    str | None,
    typer.Option("--part", metavar="I/N", help="The I-th of N parts, for N machines."),
]


def least_alignable(aligned: bool, alignable: float | None) -> float | None:
    """The least probability of --aligned, None without it. Raises SettingError."""
    if alignable is not None and not aligned:
        raise SettingError("--alignable has no effect without --aligned")
    return (alignable or 0.0) if aligned else None


def parse_part(text: str | None) -> tuple[int, int] | None:
    """ "2/4" as (2, 4), counted from 1. Raises SettingError."""
    if text is None:
        return None
    match = re.fullmatch(r"([0-9]{1,9})/([0-9]{1,9})", text)
    number, count = (int(match[1]), int(match[2])) if match else (0, 0)
    if not 1 <= number <= count:
        raise SettingError(f"--part is {text!r}", hint="write it like 1/4, from 1/4 to 4/4")
    return number, count


def parse_span(since: str | None, until: str | None) -> tuple[datetime | None, datetime | None]:
    """The times of --since and --until. Raises SettingError."""
    bounds: list[datetime | None] = []
    for name, text in (("--since", since), ("--until", until)):
        try:
            bounds.append(clock.parse(text) if text is not None else None)
        except ValueError:
            raise SettingError(
                f"{name} is {text!r}, not a date",
                hint="write it like 2026-01-31 or 2026-01-31T12:00:00Z",
            ) from None
    begin, end = bounds
    if begin and end and begin >= end:
        raise SettingError(f"--since {since} is not earlier than --until {until}", hint="swap them")
    return begin, end


def in_demo_root(root: Path, settings: Settings, profile: Profile) -> tuple[Settings, Profile]:
    """Settings and profile for another command in a demo's root; unchanged in any other root.

    What only an owner can say of a release, the demo's world says of its own. The root's scores are
    the tiny model's, so that model is used again unless the user names another. Scoring stays off
    where the demo had to do without the model.
    """
    from kb.store.state import demo_mark

    if demo_mark.read_mark(root) is None:
        return settings, profile
    from kb.sandbox import toxicity
    from kb.sandbox.domain import signed

    profile = signed(profile)
    if "kb_toxicity_model" in settings.model_fields_set:
        return settings, profile

    try:
        model = str(toxicity.tiny_checkpoint())
    except MissingExtra:
        return settings, without_scores(profile)
    return settings.model_copy(update={"kb_toxicity_model": model}), profile


def without_scores(profile: Profile) -> Profile:
    """The profile with toxicity scoring switched off."""
    off = profile.toxicity.model_copy(update={"toxicity": "off"})
    return profile.model_copy(update={"toxicity": off})
