"""Refusal of stores of arrays that jaxnet could not have written, before anything reads them.

A store of Zarr version 2 may name codecs that run code. A small file may claim to be a huge array.
"""

import json
import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from upath import UPath

from jaxnet.store import gate
from jaxnet.store.gate import FolderError

CODECS = {"bytes", "vlen-utf8", "zstd", "crc32c"}
CHAINS = (["bytes", "zstd", "crc32c"], ["bytes", "zstd"], ["vlen-utf8", "zstd"])
ARRAY_TYPES = {"float32", "float64", "int8", "int16", "int32", "int64", "bool", "string"}
MOST_METADATA = 2**24  # bytes of a file
MOST_CHUNK = 2**31  # bytes of a chunk of numbers
MOST_LABELS = 2**27  # entries of an array of one dimension, which is read as a whole


class Promise(NamedTuple):
    """What the metadata of an array promise of each of its chunks."""

    entries: int
    size: int | None  # bytes; None: text
    summed: bool  # whether it ends with a checksum


def refuse_foreign(path: UPath, sizes: Mapping[str, int] | None = None) -> dict[str, Promise]:
    """Return the promises of a store's arrays by name.

    Raises FolderError for a store that is not of version 3, or has arrays unlike ours or of other `sizes`
    along these dimensions.
    """
    file = path / "zarr.json"
    if not file.exists():
        raise FolderError(f"{path} is no store of ours: it has no zarr.json, of version 3 of Zarr")
    root = metadata(file)
    if wrong := next(wrong_in_group(root), ""):
        raise FolderError(f"{file}: no store of ours: {wrong}")
    together = root.get("consolidated_metadata") or {}
    told = together.get("metadata") if isinstance(together, dict) else None
    arrays, found = dict(told) if isinstance(told, dict) else {}, {}
    for each in path.glob("*/zarr.json"):
        name = each.parent.name
        for array in (metadata(each), arrays.pop(name, None)):
            if array is not None and (wrong := next(wrong_in_array(array, sizes or {}), "")):
                raise FolderError(f"{each}: no array of ours: {wrong}")
            if array is not None and found.setdefault(name, promise_of(array)) != promise_of(array):
                raise FolderError(f"{each}: no array of ours: {file} tells of other chunks")
    if arrays:
        raise FolderError(
            f"{file}: no store of ours: it tells of {sorted(arrays)[0]!r}, which is not there"
        )
    return found


def promise_of(array: dict[str, Any]) -> Promise:
    """Return the promise of an array of ours."""
    entries = math.prod(array["chunk_grid"]["configuration"]["chunk_shape"])
    kind, summed = array["data_type"], array["codecs"][-1]["name"] == "crc32c"
    return Promise(entries, None if kind == "string" else entries * np.dtype(kind).itemsize, summed)


def metadata(file: UPath) -> dict[str, object]:
    """Read a file of metadata; raise FolderError."""
    with gate.reading(file, "has no metadata of Zarr"):
        found = json.loads(gate.read_whole(file, MOST_METADATA))
    if not isinstance(found, dict):
        raise FolderError(f"{file}: no metadata of Zarr: it is no mapping")
    return found


def wrong_in_group(found: dict[str, object]) -> Iterator[str]:
    """Yield what distinguishes a group from one of ours."""
    if (found.get("zarr_format"), found.get("node_type")) != (3, "group"):
        yield "it is no group of version 3"


def wrong_in_array(found: object, sizes: Mapping[str, int]) -> Iterator[str]:
    """Yield what distinguishes an array from one of ours, with these sizes along its dimensions."""
    if not isinstance(found, dict) or (found.get("zarr_format"), found.get("node_type")) != (
        3,
        "array",
    ):
        yield "it is no array of version 3"
        return
    kind: Any = found.get("data_type")
    shape: Any = found.get("shape")
    if not isinstance(kind, str) or kind not in ARRAY_TYPES:
        yield f"its type is {json.dumps(kind)[:60]}"
        return
    grid = found.get("chunk_grid")
    settings = grid.get("configuration") if isinstance(grid, dict) else None
    chunk: Any = settings.get("chunk_shape") if isinstance(settings, dict) else None
    if not is_shape(shape) or not is_shape(chunk) or len(shape) != len(chunk):
        yield "it has no shape, or no shape of chunks"
        return
    size = 8 if kind == "string" else np.dtype(kind).itemsize
    if math.prod(chunk) * size > MOST_CHUNK or (len(shape) == 1 and shape[0] > MOST_LABELS):
        yield f"it is too large: {shape}, in chunks of {chunk}"
    dims = found.get("dimension_names")
    named = zip(dims, shape, chunk, strict=False) if isinstance(dims, list) else ()
    for dim, length, part in named:
        due = sizes.get(dim, length) if isinstance(dim, str) else -1
        if length != due or (dim != "sample" and part > max(length, 1)):
            yield f"it has {length} along {json.dumps(dim)[:60]} in chunks of {part}, and {due} are due"
    codecs = found.get("codecs")
    codecs = codecs if isinstance(codecs, list) and codecs else [None]
    names = [each.get("name") if isinstance(each, dict) else each for each in codecs]
    for name in names:
        if not isinstance(name, str) or name not in CODECS:
            yield f"it needs the codec {json.dumps(name)[:60]}"
    if names not in CHAINS or (kind == "string") != (names[0] == "vlen-utf8"):
        yield f"it has the codecs {json.dumps(names)[:60]}"
    if found.get("storage_transformers"):
        yield "it has storage transformers"


def is_shape(given: object) -> bool:
    """Return whether a value is a list of nonnegative integers."""
    return isinstance(given, list) and all(type(each) is int and each >= 0 for each in given)
