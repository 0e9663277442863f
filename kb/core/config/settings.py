"""Settings from the environment or `.env` (the environment wins). Secrets never print.

Names and meanings are the contract's; `.env.example` lists them.
"""

import logging
import os
import re
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

from dotenv import dotenv_values
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    SecretStr,
    ValidationError,
    ValidationInfo,
    create_model,
    field_validator,
)

from kb.core import clock, terminal
from kb.core.config.addresses import is_contact, root_of
from kb.core.errors import MissingCredential, SettingError
from kb.core.regular_file import check_regular
from kb.core.sources import SOURCES
from kb.core.suggestions import similar

_log = logging.getLogger("kb.settings")
_CONTROL = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029]")
_OF_TESTS = ("KB_TEST_", "KB_BENCH_", "KB_RECORDED")
_LATIN = re.compile("[\x00-\xff]*")
_ADDRESSES = ("_endpoint", "_web", "_url")  # a name and a password may stand in them
REDDIT = ("reddit_client_id", "reddit_client_secret", "kb_contact")  # what asking Reddit needs
# What the packages of sources add.
_ADDED = {name: setting for source in SOURCES.values() for name, setting in source.settings.items()}
# What names of settings begin with.
_OURS = ("KB_", "YOUTUBE_", "REDDIT_", "ZENODO_", *(f"{n.split('_')[0]}_".upper() for n in _ADDED))
# Secrets, of which an empty one says something.
_MAY_BE_EMPTY = (
    "youtube_api_key",
    "reddit_client_id",
    "reddit_client_secret",
    "zenodo_token",
    "hf_token",
    *(name for name, added in _ADDED.items() if added.secret),
)


class Settings(BaseModel):
    """Everything that is not about the domain.

    Field names are the variables' names in lower case.
    """

    model_config = ConfigDict(extra="ignore", frozen=True)

    youtube_api_key: SecretStr | None = Field(None, description="YouTube Data API v3 key")
    reddit_client_id: SecretStr | None = Field(None, description="id of your own Reddit app")
    reddit_client_secret: SecretStr | None = Field(
        None, description="its secret; empty for an installed app"
    )
    zenodo_token: SecretStr | None = Field(None, description="token for `kb release publish`")
    hf_token: SecretStr | None = Field(None, description="token of the Hugging Face hub")
    kb_log: Path | None = Field(None, description="file that a command's events are appended to")
    kb_contact: str | None = Field(None, description="e-mail or web address in the User-Agent")
    kb_data: Path = Field(Path("data"), description="the data root")
    kb_profile: str | None = Field(
        None,
        description="the profile: a name or a path; default: the data root's own, or `minecraft`",
    )
    kb_youtube_endpoint: str | None = Field(
        None, description="root of the Data API instead of Google's"
    )
    kb_youtube_web: str | None = Field(
        None, description="root of the YouTube web site instead of youtube.com"
    )
    kb_reddit_endpoint: str | None = Field(
        None, description="root for Reddit's web and OAuth hosts"
    )
    kb_wiki_url: str | None = Field(None, description="the wiki's root instead of the profile's")
    kb_zenodo_endpoint: str | None = Field(None, description="root of the deposit API")
    hf_endpoint: str | None = Field(None, description="root of the Hugging Face hub")
    kb_models_endpoint: str | None = Field(None, description="root of the hosts of model files")
    kb_toxicity_model: str = Field(
        "original", description="Detoxify model name, or a checkpoint file"
    )
    kb_toxicity_sha256: str | None = Field(None, description="SHA-256 of your own checkpoint file")
    kb_import_memory_gb: float = Field(
        3,
        gt=0,
        description="memory limit in GB for the dumps of an import; a single dump is always read",
    )
    source_date_epoch: int | None = Field(
        None,
        ge=0,
        le=253_402_300_799,
        description="build date of releases, in seconds since 1970",
        examples=[1767225600],
    )
    kb_now: str | None = Field(
        None,
        description="fixed date for data and quota days, for tests",
        examples=["2026-11-20T12:00:00Z"],
    )

    @field_validator("*", mode="before")
    @classmethod
    def _is_clean(cls, value: object, info: ValidationInfo) -> object:
        """Spaces around a value are dropped, and an empty one is unset:
        a line of `.env` that is not filled in.
        """
        if isinstance(value, str):
            value = value.strip()
            if _CONTROL.search(value):
                raise ValueError("must not contain line breaks or other control characters")
        # An empty secret says something of its own: a Reddit app that has none.
        if value == "" and info.field_name not in _MAY_BE_EMPTY:
            return cls.model_fields[info.field_name or ""].default
        return value

    @field_validator("*", mode="before")
    @classmethod
    def _fits_a_header(cls, value: object, info: ValidationInfo) -> object:
        sent = info.field_name in _MAY_BE_EMPTY or info.field_name == "kb_contact"
        if sent and isinstance(value, str) and not _LATIN.fullmatch(value):
            raise ValueError(
                "must consist of Latin letters, digits and signs, as it is sent in a header"
            )
        return value

    @field_validator(
        "kb_youtube_endpoint",
        "kb_youtube_web",
        "kb_reddit_endpoint",
        "kb_wiki_url",
        "kb_zenodo_endpoint",
        "hf_endpoint",
        "kb_models_endpoint",
    )
    @classmethod
    def _is_root(cls, value: str | None) -> str | None:
        return root_of(value, "http://127.0.0.1:8000") if value else None

    @field_validator("kb_now")
    @classmethod
    def _is_time(cls, value: str | None) -> str | None:
        if value:
            try:
                known = clock.FIRST <= clock.parse(value) <= clock.LAST
            except OverflowError:
                known = False
            except ValueError:
                raise ValueError("must be a date and time: 2026-11-20T12:00:00Z") from None
            if not known:
                raise ValueError("must be a time from the years 1970 to 2200")
        return value

    def secret_values(self) -> list[str]:
        """The literal secrets that must never leave, for redaction and the release gate."""
        values = (getattr(self, name) for name in type(self).model_fields)
        texts = (value.get_secret_value() for value in values if isinstance(value, SecretStr))
        return [text for text in texts if text]

    def need(self, field: str) -> str:
        """The secret or text of `field`. Raises as `require`."""
        self.require(field)
        value = getattr(self, field)
        if not isinstance(value, SecretStr):
            return str(value)
        secret = value.get_secret_value()
        if 0 < len(secret) < terminal.SHORTEST_SECRET:
            _warn_of_short(field.upper())
        return secret

    def require(self, *fields: str) -> None:
        """Raises MissingCredential that names all fields which are not set, SettingError for a
        contact that is not an address.
        """
        missing = [field for field in dict.fromkeys(fields) if not self._has(field)]
        if missing:
            known = type(self).model_fields
            facts = [f"{name.upper()} is not set ({known[name].description})" for name in missing]
            raise MissingCredential(
                ", ".join(facts),
                hint=f"set {'it' if len(facts) == 1 else 'them'} in the environment or in .env, as"
                " .env.example shows; `kb doctor` lists every one",
            )
        if "kb_contact" in fields:
            self.check_contact()

    def _has(self, field: str) -> bool:
        value = getattr(self, field)
        text = value.get_secret_value() if isinstance(value, SecretStr) else value
        return text is not None and (text != "" or field == "reddit_client_secret")

    def named(self, field: str) -> str:
        """The variable of `field`, and whether it is set: for a plan."""
        return field.upper() if getattr(self, field) is not None else f"{field.upper()} (not set)"

    def check_contact(self) -> None:
        """Raises SettingError for a contact that is neither an e-mail nor a web address."""
        if self.kb_contact and not is_contact(self.kb_contact):
            raise SettingError(
                f"KB_CONTACT is {terminal.shown(self.kb_contact)}:"
                " must contain an e-mail or web address",
                hint="such as me@example.org or https://example.org/about;"
                " services see it in the User-Agent",
            )


def _declared() -> type[Settings]:
    """The settings, with those that the packages of sources add. Raises SettingError."""
    if twice := sorted(_ADDED.keys() & Settings.model_fields.keys()):
        raise SettingError(
            f"a source adds the setting {twice[0]}, which is one of Lorecrawl's",
            hint="give it another name in the package's schemas/sources",
        )
    added: dict[str, Any] = {
        name: (
            (SecretStr if setting.secret else str) | None,
            Field(None, description=setting.description),
        )
        for name, setting in _ADDED.items()
    }
    return create_model("Settings", __base__=Settings, **added)


DECLARED = _declared()


@cache  # once for each process
def _warn_of_short(name: str) -> None:
    _log.warning(
        "%s has fewer than %d characters, too few to be hidden in messages:"
        " check that it is complete",
        name,
        terminal.SHORTEST_SECRET,
    )


def load_settings(*, dotenv: bool = True, **values: object) -> Settings:
    """Settings of this process; `values` (field names) win over everything.

    Raises SettingError that names the variable and what is allowed, never the value of a secret.
    """
    given = {name: value for name, value in values.items() if value is not None}
    try:
        if dotenv and Path(".env").is_fifo():  # the library would wait for it
            check_regular(".env")
        settings = DECLARED.model_validate({**_variables(dotenv), **given})
    except ValidationError as error:
        wrong = []
        for detail in error.errors(include_url=False):
            name = str(detail["loc"][0]) if detail["loc"] else ""
            secret = name not in DECLARED.model_fields or name.endswith(_ADDRESSES)
            secret = secret or name in _MAY_BE_EMPTY
            shown = "" if secret else f" is {terminal.shown(str(detail['input']))}"
            wrong.append(f"{name.upper()}{shown}: {detail['msg'].removeprefix('Value error, ')}")
        raise SettingError("; ".join(wrong), hint="see .env.example") from None
    except (OSError, UnicodeDecodeError) as error:
        what = (
            error.strerror
            if isinstance(error, OSError)
            else f"not UTF-8 text (byte {error.start + 1})"
        )
        raise SettingError(
            f"{Path('.env').absolute()} can't be read: {what}",
            hint="save it as plain UTF-8; see .env.example",
        ) from None
    if settings.kb_now:
        # The clock reads the environment, so that worker processes see the same date.
        os.environ["KB_NOW"] = settings.kb_now
    return settings


def _variables(dotenv: bool) -> dict[str, str | None]:
    """What `.env` and the environment, which wins, set, by names in lower case."""
    there = dotenv_values(".env") if dotenv and Path(".env").is_file() else {}
    return {name.lower(): value for name, value in (*there.items(), *os.environ.items())}


def unknown_names(*, dotenv: bool = True) -> list[str]:
    """One line for each name, with the nearest right one, and never with its value.

    Other programs have settings that begin with YOUTUBE_ or REDDIT_: in the environment only
    KB_ is ours.
    """
    lines = []
    if dotenv and Path(".env").is_file():
        lines += _lines(".env", dotenv_values(".env", interpolate=False), _OURS)
    return lines + _lines("the environment", os.environ, ("KB_",))


def _lines(where: str, names: Iterable[str], prefixes: tuple[str, ...]) -> list[str]:
    known = [name.upper() for name in DECLARED.model_fields]
    lines = []
    for name in names:
        upper = name.upper()
        if not upper.startswith(prefixes) or upper in known or upper.startswith(_OF_TESTS):
            continue
        near = similar(upper, known, most=1)
        guess = f"; did you mean {near[0]}?" if near else "; see .env.example"
        lines.append(f"{name} in {where} is not a setting and has no effect{guess}")
    return lines
