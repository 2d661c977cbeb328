"""The type of a config's key that takes a kind: `Annotated[Attack, KindOf("attack")]`."""

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import PydanticCustomError, core_schema

from jaxnet.kinds import registry
from jaxnet.kinds.kind import Kind, KindError
from jaxnet.outside.families import base_of


class KindOf:
    """A kind of a family: an object, or a mapping with `kind` and the kind's keys, or the name alone.

    A mapping without `kind` means the kind `default`, if there is one.
    """

    def __init__(self, family: str, default: str | None = None):
        self.family, self.default = family, default

    def validate(self, value: object) -> Kind:
        base = base_of(self.family)
        if isinstance(value, str):
            value = {"kind": value}
        if isinstance(value, Kind) and isinstance(value, base):
            return value
        if not isinstance(value, dict):
            known = ", ".join(registry.kind_names(self.family))
            raise PydanticCustomError(
                "kind", "must be a mapping, or one of {known}", {"known": known}
            )
        if self.default is not None:
            value = {"kind": self.default, **value}
        try:
            if not isinstance(value.get("kind"), str):
                raise registry.unknown_kind(self.family, value.get("kind"))
            found = registry.find(self.family, value["kind"])
        except KindError as error:
            raise PydanticCustomError(
                "kind_name", "{error}", {"error": str(error), "family": self.family}
            ) from error
        return found.model_validate({key: each for key, each in value.items() if key != "kind"})

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        return core_schema.no_info_plain_validator_function(
            self.validate,
            serialization=core_schema.plain_serializer_function_ser_schema(
                lambda kind: kind.model_dump()
            ),
        )

    def __get_pydantic_json_schema__(
        self, schema: core_schema.CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """A placeholder, which `config.schema` replaces by a reference."""
        return {"family": self.family}
