"""What the fields of messages and settings may hold, in the OpenAPI document."""

import dataclasses
import typing
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, cast

from fastapi import APIRouter
from fastapi.routing import APIRoute

from rona_core.devices.limits import INNER, OF_LISTS, OF_NUMBERS, OF_TEXTS, limits_of, meaning

Schema = dict[str, Any]
_OF_TYPE = {"number": OF_NUMBERS, "integer": OF_NUMBERS, "array": OF_LISTS, "string": OF_TEXTS}


def add_limits(document: Schema, routers: Iterable[APIRouter]) -> None:
    """Add the limits that fields of dataclasses declare to their schemas in a document.

    Args:
        document: An OpenAPI document, which is changed.
        routers: Their routes are looked through for dataclasses.
    """
    schemas = document["components"]["schemas"]
    hints = [
        hint
        for router in routers
        for route in router.routes
        if isinstance(route, APIRoute)
        for hint in typing.get_type_hints(route.endpoint).values()
    ]
    for kind in _dataclasses(hints, set()):
        fields = schemas.get(kind.__name__, {}).get("properties", {})
        for name, words in limits_of(kind).items():
            if words and name in fields:
                _describe(fields[name], words)


def _dataclasses(hints: Iterable[Any], seen: set[Any]) -> Iterator[Any]:
    """Yield the dataclasses in types of parameters and answers, and in those of their fields."""
    for hint in hints:
        if dataclasses.is_dataclass(hint) and hint not in seen:
            seen.add(hint)
            yield hint
            yield from _dataclasses(typing.get_type_hints(hint).values(), seen)
        yield from _dataclasses(typing.get_args(hint), seen)


def _describe(field: Schema, words: Mapping[str, Any]) -> None:
    _limit(field, words)
    if "label" in words:
        field["title"] = words["label"]
    unit = f"In {words['unit']}" if words.get("unit") else ""
    if said := ". ".join(filter(None, (unit, meaning(words)))):
        field["description"] = said


def _limit(schema: Schema, words: Mapping[str, Any]) -> None:
    """Add limits to a schema and to those in it; those of a list to its own alone."""
    allowed = _OF_TYPE.get(schema.get("type", ""), ())
    schema |= {
        name: list(words[name]) if name == "enum" else words[name]
        for name in allowed
        if name in words
    }
    inner = words
    if schema.get("type") == "array":
        inner = {name: word for name, word in words.items() if name not in OF_LISTS}
        inner |= words.get(INNER, {})
    parts = [*schema.get("anyOf", ()), *schema.get("prefixItems", ())]
    for part in (*parts, schema["items"]) if "items" in schema else parts:
        _limit(cast("Schema", part), inner)
