"""The config's JSON schema, for editors that complete and check YAML."""

import json
from typing import Any

from jaxnet.config.keys import KINDS, Config, Scenario, kind_name


def schema_text() -> str:
    """The schema as JSON."""
    return json.dumps(schema(), indent=2, ensure_ascii=False) + "\n"


def schema() -> dict[str, Any]:
    """The schema: what the models say, and that a kind may stand alone as a string."""
    whole = Config.model_json_schema()
    for field, kinds in KINDS.items():
        whole["properties"][field] = {
            "anyOf": [
                {"enum": [kind_name(kind) for kind in kinds]},
                *({"$ref": f"#/$defs/{kind.__name__}"} for kind in kinds),
            ],
            "default": Scenario.model_fields[field].default.kind,
        }
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **whole}
