"""[tasks]: which titles say what is done in a video, and when it begins and ends there."""

from __future__ import annotations

from pydantic import Field

from kb.core.config.profile.base import Phrases, Section


class Tasks(Section):
    """The tasks part of a profile (MineDojo paper, appendix on the benchmark: task mining)."""

    table = "tasks"
    about = "Tasks: titles that say what is done in a video, as prompts"

    verbs: Phrases = Field(
        (
            *("make makes making made", "build builds building built", "create creates creating"),
            *("draw draws drawing drew", "cook cooks cooking cooked", "grow grows growing grew"),
            *("find finds finding found", "get gets getting got", "fix fixes fixing fixed"),
            *("repair repairs repairing repaired", "clean cleans cleaning cleaned"),
            *("install installs installing", "use uses using", "play plays playing played"),
        ),
        description="verbs of tasks with their other forms; a prompt has the first form",
    )
    lead_ins: Phrases = Field(
        (
            *("how to", "how i", "how we", "how you can", "learn to", "learn how to", "let's"),
            *("i show you how to", "i will show you how to", "i'll show you how to"),
            *("i'm going to show you how to", "we", "i", "the easiest way to", "the best way to"),
        ),
        description="phrases before the verb that are no part of a prompt",
    )
    talk: Phrases = Field(
        (
            *("in this video", "in this episode", "in todays video", "in today's video", "today"),
            *("tutorial", "guide", "walkthrough", "step by step", "easy tutorial", "full tutorial"),
            *("episode #", "ep #", "part #", "day #", "season #", "lesson #", "no #"),
            *("in # minutes", "in under # minutes", "official", "new", "subscribe"),
        ),
        description="channel talk that is removed from titles; # stands for a number",
    )
    never: Phrases = Field(
        (
            *("vs", "versus", "but", "or", "# days", "# hours"),
            *("battle", "challenge", "competition", "speedrun"),
            *("ideas", "tips", "hacks", "tricks", "mistakes", "things", "reasons", "reaction"),
            *("my", "our", "me", "us", "he", "she", "they", "who", "why", "what", "when"),
        ),
        description="words and phrases that make a title no task; # stands for a number",
    )
    fillers: Phrases = Field(
        ("a", "an", "the", "your", "own", "some", "this", "these", "any"),
        description="words that do not tell two prompts apart, nor belong to an object",
    )
    joints: Phrases = Field(
        (
            *("in", "on", "at", "with", "without", "from", "for", "to", "of", "by", "and", "into"),
            *("inside", "under", "over", "using", "as", "that", "so"),
        ),
        description="words at which the object ends; none of them ends a prompt",
    )
    max_words: int = Field(12, ge=2, le=50, description="maximum words of a prompt")
    max_gap_s: float = Field(
        60,
        gt=0,
        le=3600,
        description="seconds without a mention of the object after which the subject has changed",
    )
