"""[pairs]: which words are matched in transcripts, how text and clips grow around them,
which pairs are kept. [clips]: the files of clips.
"""

from __future__ import annotations

from typing import Literal

from pydantic import Field, field_validator, model_validator

from kb.core.config.profile.base import Phrases, Section


def is_list_name(name: str) -> bool:
    """Whether it names a keyword list in the profile's own folder."""
    return name.endswith(".tsv") and not name.startswith("/") and ".." not in name.split("/")


class Pairs(Section):
    """The pairs part of a profile (MineDojo paper, data collection appendix: video-text pairs)."""

    table = "pairs"
    about = "Pairs: words that are matched in transcripts, clips and texts around them"

    keyword_files: tuple[str, ...] = Field(
        (),
        description="keyword lists (.tsv) next to the profile, with the columns keyword, kind, rule"
        " and forms; a rule is empty, `topic` (counts in videos that are known to be about the"
        " topic, elsewhere like `near`), `near` or `near:N` (counts within that many words of an"
        " unmistakable keyword), `never` (makes no pair) or `always` (an everyday word that is"
        " meant)",
    )
    include: Phrases = Field((), description="further phrases to match; their kind is `phrase`")
    exclude: Phrases = Field(
        (), description="phrases that never match, including keywords inside them"
    )
    near_words: int = Field(
        20,
        ge=1,
        le=1000,
        description="distance in words within which an everyday word needs an unmistakable keyword",
    )
    min_tokens: int = Field(
        16, ge=3, le=77, description="minimum CLIP tokens of a text, including start and end tokens"
    )
    max_tokens: int = Field(
        77, ge=3, le=77, description="maximum CLIP tokens of a text, including start and end tokens"
    )
    center: Literal["segment", "grown"] = Field(
        "segment",
        description="the clip's centre is drawn inside the cues that hold the phrase,"
        " or inside the grown text (VideoCLIP)",
    )
    min_clip_s: float = Field(8, gt=0, le=3600, description="shortest clip, in seconds")
    max_clip_s: float = Field(16, gt=0, le=3600, description="longest clip, in seconds")
    min_gap_s: float = Field(
        0,
        ge=-3600,
        le=3600,
        description="seconds between two clips of a video; negative: they may overlap by that much",
    )
    max_pairs_per_video: int = Field(0, ge=0, description="maximum pairs per video; 0: no limit")

    @field_validator("keyword_files")
    @classmethod
    def _inside_folder(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        for name in value:
            if not is_list_name(name):
                raise ValueError(f"names {name!r}; it must be a .tsv file in the profile's folder")
        return value

    @model_validator(mode="after")
    def _ranges(self) -> Pairs:
        if self.min_tokens > self.max_tokens:
            raise ValueError("min_tokens is above max_tokens")
        if self.min_clip_s > self.max_clip_s:
            raise ValueError("min_clip_s is above max_clip_s")
        if not (self.keyword_files or self.include):
            raise ValueError("names neither keyword_files nor include: there is nothing to match")
        return self


class ClipFiles(Section):
    """The clips part of a profile."""

    table = "clips"
    about = "Clips: what `kb clips` writes"

    jpeg_quality: int = Field(90, ge=1, le=100, description="quality of the frames in tar shards")
