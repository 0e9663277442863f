"""[pairs], [clips], [score], [tasks], [toxicity], [report]: what is made of rows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, create_model, field_validator, model_validator

from kb.core.config.section import Phrases, RecipeSection, Section, lies_beside
from kb.core.sources import SOURCES

_Words = Annotated[str, Field(min_length=1)]


class Pairs(RecipeSection):
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
        (),
        description="phrases that never match, including keywords inside them; a slash stands"
        " between words of which each may stand there (`bed/block wars`)",
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
            if not lies_beside(name, ".tsv"):
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


class Checkpoint(Section):
    """A CLIP checkpoint that `kb models fetch clip` downloads."""

    url: str | None = Field(
        None,
        pattern=r"^https?://\S+$",
        description="address of a CLIP checkpoint, which `kb models fetch clip` downloads",
        examples=["https://example.org/ViT-B-16.safetensors"],
    )
    sha256: str | None = Field(
        None,
        pattern=r"^[0-9a-f]{64}$",
        description="SHA-256 of that file, in hex digits",
        examples=["0" * 64],
    )

    @model_validator(mode="after")
    def _both(self) -> Checkpoint:
        if (self.url is None) != (self.sha256 is None):
            raise ValueError("needs both url and sha256")
        return self


class Scoring(Section):
    """The score part of a profile."""

    table = "score"
    about = "Score: how well clips show what texts say, by a CLIP model (`kb pairs score`)"

    checkpoint: Checkpoint = Field(
        Checkpoint(), description="the model that `kb models fetch clip` downloads"
    )
    wanted_precision: float = Field(
        0.8,
        gt=0,
        lt=1,
        description="share of pairs that should show what their text names; the card says from"
        " which similarity on people's judgements confirm it",
    )
    align_middle: float = Field(
        2.0,
        ge=-100,
        le=100,
        allow_inf_nan=False,
        description="the peak, in standard deviations, at which a text is as probably shown near"
        " its words as not; `kb pairs align --fit` finds it by people's judgements",
    )
    align_slope: float = Field(
        2.0,
        gt=0,
        le=1000,
        description="how fast that probability grows with the peak",
    )


if TYPE_CHECKING:
    _FromSection = RecipeSection
else:  # `from` is a word of Python, which no class body can annotate
    _FromSection = create_model(
        "_FromSection",
        __base__=RecipeSection,
        **{
            "from": (
                Literal["all", "playlists"],
                Field(
                    "all",
                    description="which videos give tasks: all of them, or those that a playlist"
                    " lists, as in the paper",
                ),
            )
        },
    )


class Tasks(_FromSection):
    """The tasks part of a profile (MineDojo paper, appendix on the benchmark: task mining)."""

    table = "tasks"
    about = "Tasks: titles that say what is done in a video, as prompts"

    @property
    def from_playlists(self) -> bool:
        """Whether only what a playlist lists gives a task."""
        return bool(getattr(self, "from") == "playlists")

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
        description="phrases before the verb that do not belong to a prompt",
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
    things: dict[_Words, _Words] = Field(
        {},
        description="what a title may name without a verb, and the verb of its prompt: with"
        ' `farm = "build"` the title "Easy iron farm tutorial" gives "build easy iron farm"',
    )
    marks: Phrases = Field(
        (
            *("tutorial", "tutorials", "guide", "how to", "walkthrough", "step by step", "design"),
            *("designs", "schematic", "build", "per hour", "per minute", "made easy", "explained"),
        ),
        description="phrases by which a title that names a thing is about making it",
    )
    praise: Phrases = Field(
        (
            *("easy", "easiest", "simple", "simplest", "best", "automatic", "fully automatic"),
            *("auto", "efficient", "most efficient", "fast", "fastest", "compact", "cheap"),
        ),
        description="words that say the same where a thing's name begins with them",
    )
    nouns: Phrases = Field(
        (),
        description="verbs that are more often nouns or adjectives: without a lead-in they count"
        " only before an article or a keyword",
    )
    endings: Phrases = Field(
        (), description="words that say nothing at the end of a title's part, such as `hardcore`"
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
    owners: Phrases = Field(
        ("my", "our"), description="words that are left out before one of `things`"
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


Score = Annotated[float, Field(gt=0, le=1)]


class EntityLinks(RecipeSection):
    """The links part of a profile."""

    table = "links"
    about = "Links: where each source names the keywords of pairs"


class SourceThresholds(Section):
    """A text whose largest category is above its source's number is dropped;
    without one, none is.
    """


if TYPE_CHECKING:
    Thresholds = SourceThresholds
else:
    Thresholds = create_model(
        "Thresholds",
        __base__=SourceThresholds,
        __module__=__name__,
        __doc__=SourceThresholds.__doc__,
        **{
            name: (Score | None, Field(None, description=f"for {source.scored}"))
            for name, source in SOURCES.items()
            if source.scored
        },
    )


class Toxicity(Section):
    """How texts are scored. Scores are kept, so that a changed threshold scores nothing again."""

    table = "toxicity"
    about = 'Toxicity: how texts are scored; toxicity.toxicity = "off" leaves the scores out'

    toxicity: Literal["on", "off"] = Field(
        "on", description="off: no text is scored, and the release says so"
    )
    thresholds: Thresholds = Field(
        Thresholds(), description="maximum score that is kept, per source"
    )

    @model_validator(mode="before")
    @classmethod
    def _word(cls, value: Any) -> Any:
        return {"toxicity": value} if isinstance(value, str) else value

    @property
    def on(self) -> bool:
        """Whether texts are scored."""
        return self.toxicity == "on"

    def threshold(self, source: str) -> float | None:
        """The largest score that a row of the source may have; None when none is dropped for it."""
        return getattr(self.thresholds, source, None) if self.on else None


class Report(Section):
    """The report part of a profile (figures of the MineDojo paper's data appendix)."""

    table = "report"
    about = "Report: how much the figures show"

    trim_percentile: float = Field(
        85,
        gt=0,
        le=100,
        description="durations above this percentile are left out of their histogram,"
        " as in the paper",
    )
    cloud_words: int = Field(150, ge=10, le=1000, description="words in the word cloud")
    stop_words: tuple[str, ...] = Field(
        (), description="words excluded from the word cloud, besides the usual ones"
    )
    top_keywords: int = Field(25, ge=1, le=100, description="keywords shown in the pairs figure")
    samples: int = Field(8, ge=0, le=100, description="rows of each table shown on the page")
