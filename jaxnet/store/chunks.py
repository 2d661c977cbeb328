"""The gate of a store of arrays: metadata as jaxnet writes them, and chunks as these promise.

A store of Zarr version 2 may name codecs that run code. A small file may claim to be a huge array.
"""

import asyncio
import json
import math
from collections.abc import Callable, Iterator, Mapping
from typing import Annotated, Literal, NamedTuple, TypeVar

import google_crc32c
import numpy as np
import pyarrow as pa
from pydantic import AliasPath, BaseModel, Field, ValidationError
from zarr.abc.store import ByteRequest, RangeByteRequest, Store
from zarr.core.buffer import Buffer, BufferPrototype
from zarr.storage import WrapperStore

from jaxnet.store import gate
from jaxnet.store.gate import FolderError

METADATA = "zarr.json"
MOST_METADATA = 2**24  # bytes of a file
MOST_CHUNK = 2**31  # bytes of a chunk of numbers
MOST_LABELS = 2**27  # entries of an array of one dimension, which is read as a whole
MOST_LABEL_BYTES = 2**26  # bytes of a chunk of labels
CHECKSUM = 4  # bytes at a chunk's end
CHAINS = (["bytes", "zstd", "crc32c"], ["bytes", "zstd"], ["vlen-utf8", "zstd"])
Due = Callable[[int, int], bool]  # of a cell and a block of samples: whether their chunk is stored
AnyMetadata = TypeVar("AnyMetadata", bound=BaseModel)
Size = Annotated[int, Field(ge=0, strict=True)]


class Codec(BaseModel):
    name: Literal["bytes", "vlen-utf8", "zstd", "crc32c"]


class GroupMetadata(BaseModel):
    zarr_format: Literal[3]
    node_type: Literal["group"]


class ArrayMetadata(BaseModel):
    zarr_format: Literal[3]
    node_type: Literal["array"]
    data_type: Literal["float32", "float64", "int8", "int16", "int32", "int64", "bool", "string"]
    shape: list[Size]
    chunk: list[Size] = Field(
        validation_alias=AliasPath("chunk_grid", "configuration", "chunk_shape")
    )
    codecs: list[Codec]
    storage_transformers: Annotated[list[object], Field(max_length=0)] | None = None
    dimension_names: list[str]

    def promise(self) -> "Promise":
        text, entries = self.data_type == "string", math.prod(self.chunk)
        size = None if text else entries * np.dtype(self.data_type).itemsize
        return Promise(entries, size, self.codecs[-1].name == "crc32c")

    def faults(self, sizes: Mapping[str, int]) -> Iterator[str]:
        """Yield what no single entry shows, given the sizes that are due along dimensions."""
        names = [each.name for each in self.codecs]
        if not len(self.shape) == len(self.chunk) == len(self.dimension_names):
            yield f"it has the shape {self.shape}, in chunks of {self.chunk}"
        if names not in CHAINS or (self.data_type == "string") != (names[0] == "vlen-utf8"):
            yield f"it has the codecs {names}"
            return
        size = self.promise().size or 8 * math.prod(self.chunk)
        if size > MOST_CHUNK or (len(self.shape) == 1 and self.shape[0] > MOST_LABELS):
            yield f"it is too large: {self.shape}, in chunks of {self.chunk}"
        for dim, length, part in zip(self.dimension_names, self.shape, self.chunk, strict=False):
            due = sizes.get(dim, length)
            if length != due or (dim != "sample" and part > max(length, 1)):
                yield f"it has {length} along {dim[:60]} in chunks of {part}, and {due} are due"


class Promise(NamedTuple):
    """What the metadata of an array promise of each of its chunks."""

    entries: int
    size: int | None  # bytes; None: text
    summed: bool  # whether it ends with a checksum


class GatedStore(WrapperStore[Store]):
    """A store at a place whose files all pass the gate.

    `sizes` are due along dimensions, and `due` tells which chunks are in the store. A store that
    jaxnet could not have written, and a chunk that is missing, corrupt or larger than promised,
    raise FolderError.
    """

    def __init__(self, store: Store, place: str, sizes: Mapping[str, int], due: Due | None):
        super().__init__(store)
        self.place, self.sizes, self.due = place, sizes, due
        self.promises: dict[str, Promise] = {}  # of arrays, as their metadata are read

    def _with_store(self, store: Store) -> "GatedStore":
        found = GatedStore(store, self.place, self.sizes, self.due)
        found.promises = self.promises
        return found

    async def get(
        self, key: str, prototype: BufferPrototype, byte_range: ByteRequest | None = None
    ) -> Buffer | None:
        """Content of a file of the store; None where there is none."""
        name, file = key.split("/")[0], f"{self.place}/{key}"
        if key.endswith(METADATA):
            found = await self._store.get(key, prototype, RangeByteRequest(0, MOST_METADATA + 1))
            if found is not None and key == METADATA:
                parsed_metadata(GroupMetadata, file, found.to_bytes())
            elif found is not None:
                array = parsed_metadata(ArrayMetadata, file, found.to_bytes())
                if wrong := next(array.faults(self.sizes), ""):
                    raise FolderError(f"{file}: no array of ours: {wrong}")
                self.promises[name] = array.promise()
            return found
        if (promise := self.promises.get(name)) is None:  # a name of another version of Zarr
            return None
        size = MOST_LABEL_BYTES if promise.size is None else promise.size
        most = size + size // 128 + 2**10  # the bound of Zstandard
        found = await self._store.get(key, prototype, RangeByteRequest(0, most + 1))
        if found is not None:
            await asyncio.to_thread(check_chunk, file, found.to_bytes(), promise, most)
        elif promise.summed and self.due is not None and self.due(*map(int, key.split("/")[2:4])):
            raise FolderError(f"{file} is missing; jaxnet run simulates its lanes again")
        return found


def parsed_metadata(kind: type[AnyMetadata], file: str, content: bytes) -> AnyMetadata:
    with gate.reading(file, "has no metadata of Zarr"):
        if len(content) > MOST_METADATA:
            raise FolderError(f"{file} has over {MOST_METADATA:,} bytes, and fewer are due")
        found = json.loads(content)
    try:
        return kind.model_validate(found)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        entry = ".".join(map(str, fault["loc"]))
        told = f"its {entry} is {json.dumps(fault['input'])[:60]}"
        if fault["type"] == "missing" or not entry:
            told = f"it has no {entry}" if entry else "it is no mapping"
        raise FolderError(f"{file}: no array of ours: {told}") from error


def check_chunk(file: str, content: bytes, promise: Promise, most: int) -> None:
    """Raise FolderError for a chunk that is corrupt or larger than its promise."""
    with gate.reading(file, "is corrupt"):
        if promise.summed and not is_summed(content):
            raise ValueError("its checksum is another")
        if len(content) > most:
            raise ValueError(f"it has more than {most:,} bytes")
        body = content[:-CHECKSUM] if promise.summed else content
        if promise.size is not None:
            pa.decompress(body, decompressed_size=promise.size, codec="zstd")
            return
        text = pa.CompressedInputStream(pa.BufferReader(body), "zstd").read(MOST_LABEL_BYTES + 1)
        if len(text) > MOST_LABEL_BYTES or int.from_bytes(text[:4], "little") != promise.entries:
            raise ValueError("it has more labels than are due")


def checksum_of(chunk: bytes) -> int:
    return int.from_bytes(chunk[-CHECKSUM:], "little")


def is_summed(chunk: bytes) -> bool:
    return google_crc32c.value(chunk[:-CHECKSUM]) == checksum_of(chunk)
