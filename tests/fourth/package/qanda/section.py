"""[qanda]: where the site is, which questions are kept."""

from pydantic import Field

from kb.core.config.section import FILL_IN, SourceSection


class QAndASection(SourceSection):
    """The part of a profile for questions and answers."""

    table = "qanda"
    about = "Questions and answers: where the site is, what is kept"
    subject = "url"
    first = {"url": ("The address of the site's API.", FILL_IN)}

    url: str = Field(description="address of the site's API")
    min_score: int = Field(0, description="lowest score of a kept question or answer")
    units_per_day: int = Field(300, ge=1, description="requests that the key may send a day")
    max_age_days: int = Field(30, ge=1, description="questions older than this are read again")
