"""Which keys there are, by the kinds that a config names, and messages about those that are not."""

import contextlib
import typing
from collections.abc import Iterable, Iterator, Mapping

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from jaxnet.config.document import Keys, Plain, PlainMapping, dotted_key
from jaxnet.config.keys import KINDS, Channel, Config, Initial, Scenario
from jaxnet.config.sweep import is_joint, keys_in
from jaxnet.kinds import registry
from jaxnet.kinds.fields import MARK
from jaxnet.kinds.kind import Kind, KindError
from jaxnet.kinds.refusals import suggestion, value_message
from jaxnet.kinds.registry import KindOf
from jaxnet.outside.families import base_of

RENAMED_KEYS = {"attack.channel": "channel was renamed to links"}
RECORDS: dict[str, type[BaseModel]] = {"initial": Initial, "channel": Channel}


def with_kind(field: str, value: Plain) -> Plain:
    """Return the mapping that a value of a kind's field means, where the value means one."""
    if isinstance(value, str):
        return {"kind": value}
    if isinstance(value, dict) and "kind" not in value and field in KINDS:
        return {"kind": Scenario.model_fields[field].default.reference(), **value}
    return value


def model_of(family: str, value: object) -> type[Kind] | None:
    name = value.get("kind") if isinstance(value, dict) else value
    if isinstance(name, str):
        with contextlib.suppress(KindError):
            return registry.find(family, name)
    return None


def models_in(field: FieldInfo, value: Plain = None) -> Iterator[type[BaseModel]]:
    """Yield the models that a field takes; of a family the kind in `value`, or all its kinds."""
    family = next((mark.family for mark in field.metadata if isinstance(mark, KindOf)), None)
    if family is None:
        yield from records(field.annotation)
    elif value is None:
        yield from subclasses(base_of(family))
    elif found := model_of(family, value):
        yield found


def records(annotation: object) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [found for part in typing.get_args(annotation) for found in records(part)]


def subclasses(model: type[BaseModel]) -> Iterator[type[BaseModel]]:
    yield model
    for each in model.__subclasses__():
        yield from subclasses(each)


def explain(error: ErrorDetails, data: Plain) -> str:
    """Put one of pydantic's errors on some data in a user's words."""
    kind, given, location = error["type"], error["input"], error["loc"]
    if kind in ("extra_forbidden", "invalid_key"):
        renamed, name = RENAMED_KEYS.get(dotted_key(location)), str(location[-1])
        root, *inside = name.split(".")
        if inside and len(location) == 1 and root in Config.model_fields:
            nested = f"{root}: {{{': {'.join(inside)}: …{'}' * len(inside)}"
            places = "sweep, labels, search.over and on the command line"
            return f"dotted keys stand in {places}: give {nested}"
        return renamed or value_message(error) + suggestion(name, keys_beside(location, data))
    if kind == "kind_name":
        name = given.get("kind") if isinstance(given, dict) else given
        return value_message(error) + suggestion(str(name), kinds_by_words(error), fallback=False)
    hint, at = "", written_keys(error)
    if kind == "list_type" and type(given) is int and at == ("attack", "vehicles"):
        hint = f": {{random: {given}}} draws {given} in each lane, [{given}] is vehicle {given}"
    elif at[:2] == ("attack", "vehicles") and isinstance(given, dict) and [*given] == ["random"]:
        hint = ": sweep: {attack.vehicles: [{random: 1}, {random: 2}]} sweeps such numbers"
    elif at == ("recovery",) and type(given) in (int, float):
        hint = f": give {{tau: {given}}}"
    elif kind == "kind" and type(given) in (int, float):
        hint = f": give {offers}" if (offers := " or ".join(kinds_of_number(error))) else ""
    return value_message(error) + hint


def kinds_by_words(error: ErrorDetails) -> dict[str, str]:
    """Names of a family's kinds by name, and by their words in tables."""
    family = error.get("ctx", {})["family"]
    models = registry.models(family).items()
    words = {each.words: name for name, each in models if issubclass(each, Kind)}
    return words | {name: name for name in registry.kind_names(family)}


def kinds_of_number(error: ErrorDetails) -> Iterator[str]:
    """Mappings of the kinds that need this number alone, or of the one kind with keys."""
    models = registry.models(error.get("ctx", {})["family"])
    models = {name: each for name, each in models.items() if {*each.model_fields} != {"label"}}
    for name, model in models.items():
        fields = model.model_fields.items()
        for key in [key for key, each in fields if each.is_required() or len(models) == 1]:
            with contextlib.suppress(ValidationError):
                model.model_validate({key: error["input"]})
                yield f"{{kind: {name}, {key}: {error['input']}}}"
                break


def written_keys(error: ErrorDetails) -> Keys:
    """Return the keys of an error's place as the user writes them, without the tags of unions."""
    keys = tuple(part for part in error["loc"] if not str(part).startswith((MARK, "[key]")))
    if error["type"] == "invalid_key":
        return (*keys[:-1], error["input"])
    if error["type"] == "missing" and isinstance(keys[-1], int):
        return keys[:-1]
    in_mapping = error["type"] in ("kind", "kind_name") and isinstance(error["input"], dict)
    return (*keys, "kind") if in_mapping else keys


def keys_beside(location: Keys, data: Plain) -> list[str]:
    """Return the keys allowed in the mapping in which pydantic found an unknown key."""
    if location[0] == "metrics":
        return [*registry.find("metrics", data["metrics"][location[1]]["kind"]).keys, "name"]
    models: list[type[BaseModel]] = [Config]
    for part in (part for part in location[:-1] if not isinstance(part, int)):
        if str(part).startswith(MARK):
            models = [each for each in models if f"{MARK}{each.__name__}" == part]
            continue
        data = data.get(part) if isinstance(data, dict) else None
        fields = [each.model_fields[part] for each in models if part in each.model_fields]
        models = [model for field in fields for model in models_in(field, data or "")]
    return fields_in(models)


class KnownKeys:
    """The dotted keys of a study's cells, which depend on the kinds that it names or sweeps."""

    def __init__(self, data: PlainMapping, values: Mapping[str, list[Plain]]):
        self.models: dict[str, list[type[BaseModel]]] = {k: [each] for k, each in RECORDS.items()}
        for root in KINDS:
            given = [with_kind(root, each) for each in (data.get(root, {}), *values.get(root, []))]
            self.models[root] = [model for each in given if (model := model_of(root, each))]

    def has(self, key: str) -> bool:
        if is_joint(key):
            return all(map(self.has, keys_in(key)))
        root, *inside = key.split(".")
        models = self.models.get(root, [])
        anything = any(each.model_config.get("extra") == "allow" for each in models)
        anything |= root in self.models and not models  # an unknown kind, refused as such
        known = not inside or anything or inside[0] in self.inside(root)
        return root in Scenario.model_fields and known

    def unknown(self, key: str) -> str:
        root, *inside = key.split(".")
        found = self.inside(root)
        if root in self.models:
            return RENAMED_KEYS.get(key) or f"unknown key{suggestion(inside[0], found)}"
        return f"unknown key (known here: {', '.join(found or [root])})"

    def inside(self, root: str) -> list[str]:
        """Return the keys inside a key, without `kind`; the indices of a list."""
        if root == "gain":
            return list(map(str, range(len(Scenario.model_fields[root].default))))
        return fields_in(self.models.get(root, []))


def fields_in(models: Iterable[type[BaseModel]]) -> list[str]:
    return list(dict.fromkeys(key for each in models for key in each.model_fields))
