"""The config's JSON schema, for editors that complete and check YAML."""

import json
from typing import Any

from jaxnet.config.keys import KINDS, Config, Scenario
from jaxnet.kinds import registry


def schema_text() -> str:
    """The schema as JSON."""
    return json.dumps(schema(), indent=2, ensure_ascii=False) + "\n"


def schema() -> dict[str, Any]:
    """The schema: what the models say, of every kind that has a name, and that a kind may stand alone as a
    string.
    """
    whole = Config.model_json_schema()
    for family in KINDS:
        kinds = {name: registry.find(family, name) for name in registry.names(family)}
        for name, kind in kinds.items():
            whole["$defs"] |= definitions(kind, name)
        whole["$defs"][family] = {
            "anyOf": [
                {"enum": list(kinds)},
                {"type": "string", "pattern": OUTSIDE},
                *({"$ref": f"#/$defs/{kind.__name__}"} for kind in kinds.values()),
                {"type": "object", "properties": {"kind": {"pattern": OUTSIDE}}, "required": ["kind"]},
            ],
        }
        default = Scenario.model_fields[family].default.reference()
        whole["properties"][family] = {"$ref": f"#/$defs/{family}", "default": default}
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **whole}


OUTSIDE = r"^[\w.]+:[\w.]+$"  # module:Class


def definitions(kind: Any, name: str) -> dict[str, Any]:
    """What the schema says of a kind, and of what its keys take."""
    own = kind.model_json_schema(ref_template="#/$defs/{model}")
    inner = own.pop("$defs", {})
    own["properties"] = {"kind": {"const": name, "default": name, "type": "string"}, **own["properties"]}
    return {**inner, kind.__name__: own}
