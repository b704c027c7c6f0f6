"""The simplest JSON that fits a schema: what a simulated model says to questions that it knows nothing of."""

import json
from collections.abc import Mapping
from typing import Any

from seo_slam.interfaces import ChatRequest


def simplest_reply(request: ChatRequest) -> str:
    """Return the simplest reply that fits the schema of a request; "ok" where it has none."""
    if request.schema is None:
        return "ok"
    return json.dumps(simplest_value(request.schema, request.schema.get("$defs", {})))


def simplest_value(schema: Mapping[str, Any], named: Mapping[str, Any]) -> Any:
    """Return the simplest value of a JSON schema.

    Args:
        schema: of the value.
        named: schemas that ``$ref`` may name, by the last part of the reference.
    """
    if "$ref" in schema:
        return simplest_value(named.get(str(schema["$ref"]).rpartition("/")[2], {}), named)
    if "const" in schema:
        return schema["const"]
    if schema.get("enum"):
        return schema["enum"][0]
    if schema.get("anyOf"):
        return simplest_value(schema["anyOf"][0], named)
    kind = schema.get("type")
    kind = kind[0] if isinstance(kind, list) and kind else kind
    if kind == "object":
        return {key: simplest_value(part, named) for key, part in schema.get("properties", {}).items()}
    plain = {"array": [], "string": "", "integer": 0, "number": 0.0, "boolean": True}
    return plain.get(kind) if isinstance(kind, str) else None
