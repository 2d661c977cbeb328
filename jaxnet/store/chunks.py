"""Chunks of a store of arrays as they are read: each as large as the metadata promise, and whole."""

import asyncio
from collections.abc import Callable, Mapping
from typing import Any

import google_crc32c
import pyarrow as pa
from zarr.abc.store import ByteRequest, RangeByteRequest, Store
from zarr.core.buffer import Buffer, BufferPrototype
from zarr.storage import WrapperStore

from jaxnet.store import gate
from jaxnet.store.arrays import CHECKSUM
from jaxnet.store.foreign import Promise

MOST_LABEL_BYTES = 2**26  # bytes of a chunk of labels
Due = Callable[
    [int, int], bool
]  # of a cell and a block of samples: whether their chunk is in the store


class GatedStore(WrapperStore[Store]):
    """A store that reads no chunk beyond its promise, and says which chunk is missing or corrupt."""

    def __init__(
        self, store: Store, place: str, promises: Mapping[str, Promise], due: Due | None = None
    ):
        super().__init__(store)
        self.place, self.promises, self.due = place, promises, due

    def _with_store(self, store: Store) -> "GatedStore":
        return GatedStore(store, self.place, self.promises, self.due)

    async def get(
        self, key: str, prototype: BufferPrototype, byte_range: ByteRequest | None = None
    ) -> Buffer | None:
        """Return the content of a file of the store; raise FolderError."""
        promise = self.promises.get(key.split("/")[0])
        if promise is None or key.endswith("zarr.json"):
            return await self._store.get(key, prototype, byte_range)
        most = most_bytes(promise)
        found = await self._store.get(key, prototype, RangeByteRequest(0, most + 1))
        if found is not None:
            await asyncio.to_thread(
                check_chunk, f"{self.place}/{key}", found.to_bytes(), promise, most
            )
        elif promise.summed and self.due is not None and self.due(*map(int, key.split("/")[2:4])):
            raise gate.FolderError(
                f"{self.place}/{key} is missing; jaxnet run simulates its lanes again"
            )
        return found


def most_bytes(promise: Promise) -> int:
    """Return the greatest number of bytes of a compressed chunk (the bound of Zstandard)."""
    size = MOST_LABEL_BYTES if promise.size is None else promise.size
    return size + size // 128 + 2**10


def check_chunk(file: str, content: bytes, promise: Promise, most: int) -> None:
    """Raise FolderError for a chunk that is corrupt or larger than its promise."""
    with gate.reading(file, "is corrupt"):
        body: Any = content
        if promise.summed:
            body, end = content[:-CHECKSUM], content[-CHECKSUM:]
            if google_crc32c.value(body) != int.from_bytes(end, "little"):
                raise ValueError("its checksum is another")
        if len(content) > most:
            raise ValueError(f"it has more than {most:,} bytes")
        if promise.size is not None:
            pa.decompress(body, decompressed_size=promise.size, codec="zstd")
            return
        text = pa.CompressedInputStream(pa.BufferReader(body), "zstd").read(MOST_LABEL_BYTES + 1)
        if len(text) > MOST_LABEL_BYTES or int.from_bytes(text[:4], "little") != promise.entries:
            raise ValueError("it has more labels than are due")
