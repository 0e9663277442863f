"""`kb profile check --data`: what each keyword hits in the transcripts of a data root."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from kb.core.errors import FatalError, MissingExtra
from kb.core.profile.finding import NOTE, Finding
from kb.pairs.keyword_hits import keyword_lines

if TYPE_CHECKING:
    from kb.cli.framework.options import Options
    from kb.core.context import Run
    from kb.core.profile import Profile

_UNUSED = 10  # keywords without a hit that are named
_EXAMPLES = 3


def run_of(options: Options, profile: Profile) -> Run:
    """A Run of the checked profile. It only reads, so the data root may be another domain's."""
    named = options.data is not None
    run = replace(options, profile=None).make_run(needs="nothing", exists=named)
    return replace(run, profile=profile)


def looks_at_data(options: Options, run: Run) -> bool:
    """Whether a data root was named, by option or setting; the default one may be anybody's."""
    return options.data is not None or (
        "kb_data" in run.settings.model_fields_set and run.root.is_dir()
    )


def hits_of(run: Run) -> tuple[list[dict[str, Any]], list[Finding]]:
    """What each keyword hits in clean transcripts, most first; and what stands in the way."""
    if run.profile.pairs is None:
        return [], []
    try:
        lines = list(keyword_lines(run, _EXAMPLES, rare=True))
    except (FatalError, MissingExtra) as error:
        note = Finding(NOTE, "keywords", 0, "", f"were not tried: {error}", error.hint)
        return [], [note]
    rows = [line._asdict() for line in lines]
    unused = [line.keyword for line in lines if not line.matches]
    if not unused:
        return rows, []
    named = ", ".join(unused[:_UNUSED]) + (" …" if len(unused) > _UNUSED else "")
    said = f"{len(unused):,} of {len(lines):,} hit nothing in {run.root}: {named}"
    mend = "people may say them otherwise: add forms"
    return rows, [Finding(NOTE, "keywords", 0, "", said, mend)]
