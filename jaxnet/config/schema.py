"""The JSON schema of a config, by which editors complete and check YAML."""

import json
from typing import Any

from pydantic import BaseModel

from jaxnet.config.document import Plain
from jaxnet.config.keys import KINDS, Channel, Config, Scenario
from jaxnet.kinds import registry
from jaxnet.kinds.attacks import Attack
from jaxnet.kinds.detectors import Detector

JsonSchema = dict[str, Any]


def schema_text() -> str:
    return json.dumps(config_schema(), indent=2, ensure_ascii=False) + "\n"


def config_schema() -> JsonSchema:
    """Return the schema of all keys and of every kind with a name, which may be bare."""
    whole = Config.model_json_schema()
    for family, default in {**DEFAULT_KINDS, "metrics": ""}.items():
        kinds = registry.models(family)
        for name, kind in kinds.items():
            whole["$defs"] |= definitions(kind, name, default)
        whole["$defs"][family] = {
            "anyOf": [
                {"enum": registry.kind_names(family)},
                {"type": "string", "pattern": OUTSIDE},
                *({"$ref": f"#/$defs/{kind.__name__}"} for kind in kinds.values()),
                {
                    "type": "object",
                    "properties": {"kind": {"pattern": OUTSIDE}},
                    "required": ["kind"],
                },
            ],
        }
    add_names(whole["$defs"])
    for family in KINDS:
        whole["properties"][family] |= {"family": family, "default": DEFAULT_KINDS[family]}
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **referring(whole)}


# Families by the kind that stands where none is named.
DEFAULT_KINDS = {family: Scenario.model_fields[family].default.reference() for family in KINDS}
DEFAULT_KINDS["announcement"] = Attack.model_fields["announces"].default.reference()
DEFAULT_KINDS["observer"] = Detector.model_fields["predicts"].default.reference()
DEFAULT_KINDS |= {key: Channel.model_fields[key].default.reference() for key in ("loss", "noise")}

OUTSIDE = r"^[\w.]+:[\w.]+$"  # module:Class


NAME = {"type": "string", "pattern": r"^[^\W\d]\w*$"}
NAME |= {"description": "the name of its column; so a study may have several metrics of a kind"}


def add_names(defined: JsonSchema) -> None:
    """Let each metric have the name of its column beside its keys, and one without keys too."""
    models = registry.models("metrics")
    for model in models.values():
        defined[model.__name__]["properties"]["name"] = NAME
    bare = [name for name in registry.kind_names("metrics") if name not in models]
    keys = {"kind": {"enum": bare}, "name": NAME}
    named = {"type": "object", "properties": keys, "required": ["kind"]}
    defined["metrics"]["anyOf"].append({**named, "additionalProperties": False})


def definitions(kind: type[BaseModel], name: str, default: str) -> JsonSchema:
    """Return the schema of a kind and of its keys. Only the default kind may omit `kind`."""
    own = kind.model_json_schema(ref_template="#/$defs/{model}")
    inner = own.pop("$defs", {})
    own["properties"] = {
        "kind": {"const": name, "default": name, "type": "string"},
        **own["properties"],
    }
    if name != default:
        own["required"] = ["kind", *own.get("required", [])]
    return {**inner, kind.__name__: own}


def referring(part: Plain) -> Plain:
    """Refer to the family in each key that takes a kind (`kinds.registry.KindOf`)."""
    if isinstance(part, list):
        return [referring(each) for each in part]
    if not isinstance(part, dict):
        return part
    if isinstance(part.get("family"), str):
        family = part["family"]
        part = {key: each for key, each in part.items() if key != "family"}
        return {"$ref": f"#/$defs/{family}", **part}
    return {key: referring(each) for key, each in part.items()}
