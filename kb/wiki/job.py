"""What the phases of one crawl share."""

from __future__ import annotations

from dataclasses import dataclass

from kb.core.context import Run
from kb.core.profile.wiki import Wiki
from kb.store.frontier import Frontier
from kb.store.recorder import Recorder
from kb.wiki.web import Web


@dataclass(kw_only=True)
class Job:
    """One run of the crawl under the writer's lock; `answered` counts pages that did not fail."""

    run: Run
    url: str
    section: Wiki
    frontier: Frontier
    recorder: Recorder
    web: Web
    answered: int = 0
