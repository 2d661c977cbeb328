"""Refusal of stores of arrays that jaxnet could not have written, before anything reads them.

A store of Zarr version 2 may name codecs that run code. A small file may claim to be a huge array.
"""

import json
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from upath import UPath

from jaxnet.store.folder import FolderError

CODECS = {"bytes", "vlen-utf8", "zstd", "crc32c"}
ARRAY_TYPES = {"float32", "float64", "int8", "int16", "int32", "int64", "bool", "string"}
MOST_CHUNK = 2**31  # bytes of a chunk of numbers
MOST_LABELS = 2**27  # entries of an array of one dimension, which is read as a whole


def refuse_foreign(path: UPath) -> None:
    """Raise FolderError for a store that is not of version 3 or that has arrays unlike ours."""
    file = path / "zarr.json"
    if not file.exists():
        raise FolderError(f"{path} is no store of ours: it has no zarr.json, of version 3 of Zarr")
    root = metadata(file)
    if wrong := next(wrong_in_group(root), ""):
        raise FolderError(f"{file}: no store of ours: {wrong}")
    together = root.get("consolidated_metadata") or {}
    arrays = dict(together.get("metadata") or {}) if isinstance(together, dict) else {}
    for each in path.glob("*/zarr.json"):
        name = each.parent.name
        for array in (metadata(each), arrays.pop(name, None)):
            if array is not None and (wrong := next(wrong_in_array(array), "")):
                raise FolderError(f"{each}: no array of ours: {wrong}")
    if arrays:
        raise FolderError(f"{file}: no store of ours: it tells of {sorted(arrays)[0]!r}, which is not there")


def metadata(file: UPath) -> dict[str, object]:
    """Read a file of metadata; raise FolderError."""
    try:
        found = json.loads(file.read_bytes())
    except (ValueError, RecursionError) as error:
        raise FolderError(f"{file}: no metadata of Zarr: {error}") from error
    if not isinstance(found, dict):
        raise FolderError(f"{file}: no metadata of Zarr: it is no mapping")
    return found


def wrong_in_group(found: dict[str, object]) -> Iterator[str]:
    """Yield what distinguishes a group from one of ours."""
    if (found.get("zarr_format"), found.get("node_type")) != (3, "group"):
        yield "it is no group of version 3"


def wrong_in_array(found: object) -> Iterator[str]:
    """Yield what distinguishes an array from one of ours."""
    if not isinstance(found, dict) or (found.get("zarr_format"), found.get("node_type")) != (3, "array"):
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
    codecs = found.get("codecs")
    for codec in codecs if isinstance(codecs, list) else [None]:
        name = codec.get("name") if isinstance(codec, dict) else codec
        if not isinstance(name, str) or name not in CODECS:
            yield f"it needs the codec {json.dumps(name)[:60]}"
    if found.get("storage_transformers"):
        yield "it has storage transformers"


def is_shape(given: object) -> bool:
    """Return whether a value is a list of nonnegative integers."""
    return isinstance(given, list) and all(type(each) is int and each >= 0 for each in given)
