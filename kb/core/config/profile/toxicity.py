"""[toxicity] of a profile. `toxicity = "off"` instead of the table leaves the scores out."""

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from kb.core.config.profile.base import Section

Score = Annotated[float, Field(ge=0, le=1)]


class Thresholds(Section):
    """A text whose largest category is above its source's number is dropped;
    without one, none is.
    """

    youtube: Score | None = Field(None, description="for titles and descriptions of videos")
    wiki: Score | None = Field(None, description="for a page's whole text")
    reddit: Score | None = Field(None, description="for titles, bodies and comments")


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
