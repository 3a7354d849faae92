"""Bodies of requests made from an OpenAPI document alone: valid by it, or just outside."""

import math
import re
from random import Random

LETTERS = "aZ9 _-.()éλ漢"
WILD = (0.0, 1.0, -1.0, 0.5, 3.7, 100.0, -1e4, 1e9, -1e308, 1e308, 5e-324)  # without limits


def bodies(document):
    """Yield method, path and schema of each route that takes a JSON object."""
    for path, verbs in document["paths"].items():
        for method, operation in verbs.items():
            content = operation.get("requestBody", {}).get("content", {})
            if "application/json" in content:
                schema = whole(content["application/json"]["schema"], document)
                yield method.upper(), path, without_null(schema)


def whole(schema, document):
    """Return a schema with what its references stand for in their place."""
    if isinstance(schema, list):
        return [whole(part, document) for part in schema]
    if not isinstance(schema, dict):
        return schema
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        return whole(document["components"]["schemas"][name], document)
    return {key: whole(part, document) for key, part in schema.items()}


def without_null(schema):
    options = [part for part in schema.get("anyOf", ()) if part.get("type") != "null"]
    return options[0] if options else schema


def valid(schema, draw: Random):
    """Return a value that is valid by a schema; often at an end of what it allows."""
    if "anyOf" in schema:
        return valid(draw.choice(schema["anyOf"]), draw)
    if "enum" in schema:
        return draw.choice(schema["enum"])
    if "const" in schema:
        return schema["const"]
    return VALID[schema["type"]](schema, draw)


def _object(schema, draw):
    required = schema.get("required", ())
    return {
        name: valid(part, draw)
        for name, part in schema.get("properties", {}).items()
        if name in required or draw.random() < 0.7
    }


def _array(schema, draw):
    if "prefixItems" in schema:
        return [valid(part, draw) for part in schema["prefixItems"]]
    least, most = schema.get("minItems", 0), schema.get("maxItems", 6)
    count = draw.choice((least, min(least + 1, most), min(least + 3, most), min(most, 40)))
    items = [valid(schema["items"], draw) for _ in range(count)]
    if schema.get("uniqueItems"):
        items = [item for number, item in enumerate(items) if item not in items[:number]]
    return items


def _number(schema, draw):
    if "minimum" not in schema:
        return draw.choice(WILD)
    low, high = schema["minimum"], schema["maximum"]
    return draw.choice((low, high, draw.uniform(low, high), draw.uniform(low, high)))


def _integer(schema, draw):
    if "minimum" not in schema:
        return int(draw.choice((0, 1, 2, -1, -7, 50, 10**9, 10**30)))
    low, high = schema["minimum"], schema["maximum"]
    return draw.choice((low, high, draw.randint(low, high), min(low + 1, high)))


def _string(schema, draw):
    least, most = schema.get("minLength", 0), schema.get("maxLength", 30)
    for _ in range(200):
        count = draw.choice((least, most, draw.randint(least, most)))
        text = "".join(draw.choice(LETTERS) for _ in range(count))
        if re.search(schema.get("pattern", ""), text):
            return text
    return "a" * max(least, 1)


VALID = {
    "object": _object,
    "array": _array,
    "number": _number,
    "integer": _integer,
    "string": _string,
    "boolean": lambda schema, draw: draw.random() < 0.5,
    "null": lambda schema, draw: None,
}


def outside(schema, draw):
    """Yield pairs of a field's name and a body whose only value that is not valid is there."""
    needed = {name: schema["properties"][name] for name in schema.get("required", ())}
    body = {name: valid(part, draw) for name, part in needed.items()}
    for name, part in schema["properties"].items():
        for held in _beyond(without_null(part), draw):
            yield name, {**body, name: held}


def _beyond(schema, draw):
    """Yield values just outside of what a schema allows."""
    if schema.get("type") == "integer" and "minimum" in schema:
        yield from (schema["minimum"] - 1, schema["maximum"] + 1)
    elif schema.get("type") == "number" and "minimum" in schema:
        yield math.nextafter(schema["minimum"], -math.inf)
        yield math.nextafter(schema["maximum"], math.inf)
    elif schema.get("type") == "string":
        yield from _beyond_text(schema)
    elif schema.get("type") == "array":
        yield from _beyond_list(schema, draw)


def _beyond_text(schema):
    if "enum" in schema:
        yield "no such choice"
    elif schema.get("minLength"):
        yield ""
    if "maxLength" in schema:
        yield "a" * (schema["maxLength"] + 1)


def _beyond_list(schema, draw):
    parts = schema.get("prefixItems") or [schema["items"]] * max(schema.get("minItems", 0), 1)
    held = [valid(part, draw) for part in parts]
    for number, part in enumerate(parts):
        for wrong in _beyond(part, draw):
            yield [*held[:number], wrong, *held[number + 1 :]]
    if "prefixItems" in schema:
        yield held[:-1]
        return
    if schema.get("minItems"):
        yield held[:-1]
    if "maxItems" in schema:
        more = [valid(parts[0], draw) for _ in range(schema["maxItems"] + 1)]
        if schema.get("uniqueItems"):
            more = list(range(schema["maxItems"] + 1))
        yield more
    if schema.get("uniqueItems"):
        yield [held[0], held[0]]


def numbers(schema, place=()):
    """Yield place and schema of every number in a schema."""
    if schema.get("type") in ("number", "integer"):
        yield place, schema
    for key in ("anyOf", "prefixItems"):
        for part in schema.get(key, ()):
            yield from numbers(part, place)
    if "items" in schema:
        yield from numbers(schema["items"], place)
    for name, part in schema.get("properties", {}).items():
        yield from numbers(part, (*place, name))
