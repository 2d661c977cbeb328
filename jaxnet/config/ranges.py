"""Keys that a search chooses: each is drawn from its range in `search.over` when no search runs."""

from jaxnet.config.document import Document, Plain, Problem, set_value, split_key, spot
from jaxnet.config.keys import KINDS, Scenario
from jaxnet.config.known import model_of
from jaxnet.kinds.fields import FULL_TURN, is_drawn
from jaxnet.kinds.kind import KindError


def write_distributions(document: Document) -> None:
    """Write each range in `search.over` into a document; models refuse values that are no range."""
    search = document.data.get("search")
    over = search.get("over") if isinstance(search, dict) else None
    for name, given in over.items() if isinstance(over, dict) else ():
        key, at = str(name), document.place(("search", "over", name))
        root = key.partition(".")[0]
        if root in KINDS:
            default = Scenario.model_fields[root].default
            document.data.setdefault(root, {"kind": default.reference()})
        try:
            if name in document.overridden:
                told = f"search.over.{key} replaces what is given on the command line;"
                raise LookupError(f"{told} override that instead")
            if (drawn := distribution_of(document, key, given)) is not None:
                set_value(document.data, split_key(key), drawn)
                document.places[spot(split_key(key))] = at
        except (LookupError, KindError) as error:
            document.problems.append(Problem(at, f"search.over.{key}", str(error.args[0])))


def distribution_of(document: Document, key: str, given: Plain) -> Plain:
    """Return the distribution of a range in the form of a config, None if the value is no range."""
    match given:
        case [[*_], *_]:
            return [distribution_of(document, key, each) for each in given]
        case [int() | float() as low, int() | float() as high] if low <= high:
            return {"uniform": given}
        case {"each": [int() | float() as low, int() | float() as high] as bounds} if low <= high:
            return {"each": {"uniform": bounds}}
        case {"choose": number}:
            return {"random": number}
        case "each":
            return own_distribution(document, key)
    return None


def own_distribution(document: Document, key: str) -> Plain:
    """Return the default distribution of a kind's key, or a full turn for an angle."""
    root, _, name = key.partition(".")
    there = document.data.get(root)
    model = model_of(root, there) if root in KINDS and isinstance(there, dict) else None
    field = model.model_fields.get(name) if model else None
    if field is not None and is_drawn(field.default):
        return field.default.model_dump()
    if field is not None and (field.description or "").startswith("[rad]"):
        return FULL_TURN.model_dump()
    told = "give the bounds between which to search: {each: [a, b]}"
    raise LookupError(f"{told} (got each for {key})")
