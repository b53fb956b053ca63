"""What every table of a scene file has in common: fixed fields, strict types, immutability, documented fields."""

from typing import Any, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError


class Table(BaseModel):
    """A table of a scene file. Its docstring and its fields' descriptions are what ``scenes/README.md`` shows."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, data: Any) -> Any:
        """Refuse unknown keys here, where the known ones are at hand for a suggestion."""
        if isinstance(data, dict):
            known = list(cls.model_fields)
            unknown = [key for key in data if key not in known]
            if unknown:
                raise PydanticCustomError(
                    "unknown_key", "{key} is unknown", {"key": unknown[0], "known": known, "more": len(unknown) - 1}
                )
        return data


class Choice(Table):
    """A table in which exactly one of several fields must be given (the ones without a default of their own)."""

    @classmethod
    def choices(cls) -> list[str]:
        """The fields of which one must be given."""
        extras = {name: info.json_schema_extra for name, info in cls.model_fields.items()}
        return [name for name, extra in extras.items() if isinstance(extra, dict) and extra.get("choice")]

    @model_validator(mode="after")
    def _exactly_one(self) -> Self:
        given = [name for name in self.choices() if getattr(self, name) is not None]
        if len(given) != 1:
            raise PydanticCustomError("choice", "choose one", {"given": given or None, "choices": self.choices()})
        return self

    @property
    def chosen(self) -> str:
        """The field that was given."""
        return next(name for name in self.choices() if getattr(self, name) is not None)


def field(default: Any, description: str) -> Any:
    """A field with its default (``...`` for none) and its description."""
    return Field(default, description=description)


def choice(description: str) -> Any:
    """A field of a :class:`Choice`."""
    return Field(None, description=description, json_schema_extra={"choice": True})
