"""JSON schemas that every server with structured output takes.

The strictest of them want every field required and ``additionalProperties: false``, and know no limits of numbers or lengths. What is
left out here is still checked when the reply is validated.
"""

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel

from seo_slam.errors import ConfigError

_KEPT = ("type", "enum", "description")
_DEEPEST = 32


def schema_of(model: type[BaseModel]) -> dict[str, Any]:
    """Return the JSON schema of a reply model in the strict common subset.

    Raises:
        ConfigError: the model has a part that the subset cannot say: a mapping with free keys, a type inside itself, anything at all.
    """
    return strict_schema(model.model_json_schema(), model.__name__)


def strict_schema(schema: Mapping[str, Any], name: str = "reply") -> dict[str, Any]:
    """Return a JSON schema without what strict servers refuse; references are written out.

    Every field becomes required: a field with a default must be said too, "null" where it may be null.

    Raises:
        ConfigError: as ``schema_of``.
    """
    definitions = {**schema.get("definitions", {}), **schema.get("$defs", {})}
    return _strict(schema, definitions, name, 0)


def _strict(schema: Any, definitions: Mapping[str, Any], where: str, depth: int) -> dict[str, Any]:
    if depth > _DEEPEST:
        raise ConfigError(f"schema of {where:.200}: a type holds itself, or is nested deeper than {_DEEPEST}; strict replies cannot")
    if not isinstance(schema, Mapping):
        raise ConfigError(f"schema of {where}: got {schema!r:.60}, wanted a mapping")
    if "$ref" in schema:
        target = definitions.get(str(schema["$ref"]).rpartition("/")[2])
        return _strict(target, definitions, where, depth + 1)
    if len(schema.get("allOf", ())) == 1:
        return _strict(schema["allOf"][0], definitions, where, depth + 1)
    out: dict[str, Any] = {key: schema[key] for key in _KEPT if key in schema}
    if "const" in schema:
        out["enum"] = [schema["const"]]
    choices = schema.get("anyOf") or schema.get("oneOf")
    if choices:
        return out | {"anyOf": [_strict(choice, definitions, where, depth + 1) for choice in choices]}
    if out.get("type") == "object" or "properties" in schema:
        return out | _object(schema, definitions, where, depth)
    if out.get("type") == "array":
        return out | {"items": _items(schema, definitions, where, depth)}
    if not {"type", "enum"} & out.keys():
        raise ConfigError(f"schema of {where}: got {dict(schema)!r:.80}, wanted a type; strict replies cannot hold just anything")
    return out


def _object(schema: Mapping[str, Any], definitions: Mapping[str, Any], where: str, depth: int) -> dict[str, Any]:
    properties = schema.get("properties")
    if not isinstance(properties, Mapping):
        raise ConfigError(f"schema of {where}: a mapping with free keys; strict replies need every field named")
    fields = {key: _strict(value, definitions, f"{where}.{key}", depth + 1) for key, value in properties.items()}
    return {"type": "object", "properties": fields, "required": list(fields), "additionalProperties": False}


def _items(schema: Mapping[str, Any], definitions: Mapping[str, Any], where: str, depth: int) -> dict[str, Any]:
    if "prefixItems" not in schema:
        return _strict(schema.get("items", {}), definitions, f"{where}[]", depth + 1)
    kinds: list[dict[str, Any]] = []
    for kind in (_strict(item, definitions, f"{where}[]", depth + 1) for item in schema["prefixItems"]):
        if kind not in kinds:
            kinds.append(kind)
    return kinds[0] if len(kinds) == 1 else {"anyOf": kinds}
