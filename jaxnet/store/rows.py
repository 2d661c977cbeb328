"""Rows, one for each lane: each shard has a file `lanes/NNNNN.parquet` with a stamp about it.

A reader trusts no file. Truncation, a page's wrong checksum, or lanes of another study raise.
"""

import itertools
import json
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.dataset as ds
import pyarrow.parquet as pq
from upath import UPath

from jaxnet.config.cells import Cell
from jaxnet.config.keys import Config
from jaxnet.config.scenario import interval_of
from jaxnet.config.spacings import multiples
from jaxnet.config.sweep import values_in
from jaxnet.lazy import LazyModule
from jaxnet.store import gate
from jaxnet.store.folder import Folder, FolderError
from jaxnet.store.layout import Shard, samples_of_shard
from jaxnet.store.manifest import MOST_SHARD, Manifest, samples_of_cells

if TYPE_CHECKING:
    from jaxnet.engine import status
    from jaxnet.engine.plan import Outcome
else:
    status = LazyModule("jaxnet.engine.status")

STAMP = b"jaxnet.shard"  # in a file's metadata
MOST_FILE = 2**28  # bytes of a file
READERS = 16  # files looked over at a time
LEAST_PACKED = 256  # rows of a file that is compressed: a smaller one gets no smaller
OK: ds.Expression = ds.field("status") == "ok"


class TornError(Exception):
    """A row file that cannot be used; the message is the reason."""


class Stamp(NamedTuple):
    """Description of a row file, stored in its metadata."""

    jaxnet: str  # version that wrote it
    study: str  # hash
    cell: int
    first: int  # sample
    size: int  # samples of a whole shard
    filled: dict[str, str]  # stores that its lanes are in, by name, and their identities
    checksums: dict[str, int]  # of its chunks there by array, or of the file of arrays beside it


ROW_COUNTS = ("steps", "switches", "unheard")
ISOLATION = {  # columns on vehicles that decisions cut off from the navigator, and their types
    "cut_off": pa.int64(),
    "cut_off_at": pa.float64(),
    "cut_off_vehicles": pa.int64(),
    "cut_off_share": pa.float64(),
    "stopped": pa.int64(),
}


class RowColumns(NamedTuple):
    """Columns of a study's rows that its keys decide, equal in every shard."""

    swept: dict[str, pa.DataType]
    isolation: list[str]  # on vehicles that decisions cut off

    def names(self, cell: Cell) -> list[str]:
        metrics = [metric.name for metric in cell.scenario.measured()]
        names = ["cell", "sample", *self.swept, "status", *metrics, "tail_fall"]
        return [*names, *ROW_COUNTS, *self.isolation]

    def table(self, shard: Shard, outcome: "Outcome") -> pa.Table:
        count, scenario = len(shard.samples), shard.cell.scenario
        columns: dict[str, pa.Array | np.ndarray | list[str]] = {
            "cell": np.full(count, shard.cell.number, dtype=np.int64),
            "sample": np.array(shard.samples, dtype=np.int64),
        }
        for key, kind in self.swept.items():
            columns[key] = pa.array([shard.cell.labels[key]] * count, type=kind)
        columns["status"] = np.array(status.Status._member_names_, object)[outcome.status]
        columns |= {metric.name: outcome.metrics[metric.name] for metric in scenario.measured()}
        columns["tail_fall"] = outcome.tail_fall
        columns |= {name: getattr(outcome, name).astype(np.int64) for name in ROW_COUNTS}
        for name in self.isolation:
            columns[name] = pa.array(outcome.cut_off[name], type=ISOLATION[name])
        if "cut_off_at" in self.isolation:  # times as multiples of the tick, rounded once
            times, tick = outcome.cut_off["cut_off_at"].copy(), interval_of(scenario)
            known = np.isfinite(times)
            times[known] = multiples(tick, np.rint(times[known] / tick).astype(int).tolist())
            columns["cut_off_at"] = times
        return pa.table(columns)


def row_columns(study: Config, cells: Sequence[Cell]) -> RowColumns:
    """Columns of swept keys with their types, and columns on vehicles that decisions cut off.

    A study whose defences and alarms cannot cut a vehicle off has none of the latter. Where they
    can, the columns tell who and since when; where such vehicles coast, also how many and for how
    long. Where vehicles may stop, a column tells how many did.
    """
    swept = {}
    for key, label in cells[0].labels.items():
        listed = values_in(study.sweep, key)
        whole = bool(listed) and all(isinstance(value, int) for value in listed)
        number = pa.int64() if whole else pa.float64()
        swept[key] = pa.string() if isinstance(label, str) else number
    coupled = [cell.scenario for cell in cells if cell.scenario.law.couples()]
    isolation = list(ISOLATION) if any(one.defence.coasts() for one in coupled) else []
    if not isolation and any(one.defence.decides or one.detector.cuts_links for one in coupled):
        isolation = ["cut_off", "cut_off_at"]
    stops = any(cell.scenario.vehicle.standstill == "stop" for cell in cells)
    if stops and "stopped" not in isolation:
        isolation.append("stopped")
    return RowColumns(swept, isolation)


def row_file(number: int) -> str:
    return f"lanes/{number:05d}.parquet"


def write_rows(folder: Folder, number: int, rows: pa.Table, stamp: Stamp) -> None:
    stamped = rows.replace_schema_metadata({STAMP: json.dumps(stamp._asdict())})
    packing: Any = "zstd" if len(rows) >= LEAST_PACKED else "none"
    folder.put(
        row_file(number),
        lambda file: pq.write_table(stamped, file, compression=packing, write_page_checksum=True),
    )


def read_rows(path: UPath) -> tuple[pa.Table, Stamp]:
    """Read a row file and its stamp, and verify every page; raise as `read_columns` does."""
    rows = read_columns(path)
    try:
        return rows, Stamp(**json.loads((rows.schema.metadata or {})[STAMP]))
    except (KeyError, ValueError, TypeError, RecursionError) as error:
        raise TornError("not a row file of ours") from error


def read_columns(path: UPath, columns: Sequence[str] | None = None) -> pa.Table:
    """Read some columns of a row file, by default all, and verify their pages.

    Raises FileNotFoundError, TornError, or FolderError for a folder in place of the file.
    """
    if isinstance(path, Path) and path.is_dir():
        raise FolderError(f"{path} is a folder, where a file of rows is due")
    content = gate.read_whole(path, MOST_FILE)
    try:
        file = pq.ParquetFile(pa.BufferReader(content), page_checksum_verification=True)
        strange = strange_columns(file.schema_arrow)
        groups = map(file.metadata.row_group, range(file.metadata.num_row_groups))
        size = sum(group.total_byte_size for group in groups)
        if file.metadata.num_rows > MOST_SHARD or size > MOST_FILE:  # not decompressed yet
            strange = f"it has {file.metadata.num_rows:,} rows in {size:,} bytes"
        if strange:
            raise TornError(f"not a row file of ours: {strange}")
        return file.read(columns, use_threads=False)
    except (pa.ArrowException, OSError, ValueError, TypeError, KeyError) as error:
        raise TornError(f"torn ({str(error).rstrip('.').splitlines()[0]})") from error


def refuse_lost(folder: Folder, manifest: Manifest) -> None:
    """Raise FolderError unless a finished run's folder has the rows that its manifest promises.

    Each sample of each cell stands once, in the file of its shard. Further samples of the cell do
    not count: a part of a run with more samples may have added them.
    """
    samples, size = samples_of_cells(manifest, manifest["cells"]), manifest["shard_size"]
    numbers = range(-(-max(samples, default=0) // size) * len(samples))
    there = {f"lanes/{path.name}" for path in folder.path.glob("lanes/*")}

    def lost(number: int) -> str:
        cell, wanted = samples_of_shard(samples, size, number)
        if not wanted:
            return ""
        try:
            rows = read_columns(folder.path / row_file(number), ("cell", "sample"))
            foreign = is_foreign(rows.schema.metadata, manifest["hash"])
            why = "holds lanes of another study" if foreign else wrong_rows(rows, cell, wanted)
        except (FileNotFoundError, NotADirectoryError):
            why = "is missing"
        except TornError as error:
            why = f"is {error}"
        samples_told = f"samples {wanted[0]} to {wanted[-1]}"
        return why and f"{row_file(number)} (cell {cell}, {samples_told}) {why}"

    looked = []
    for number in numbers:
        looked.append(number)
        if row_file(number) not in there and samples_of_shard(samples, size, number)[1]:
            break  # a manifest may promise more than any folder holds
    with ThreadPoolExecutor(READERS) as pool:
        found = list(filter(None, pool.map(lost, looked)))
    if found:
        more = f" and {len(found) - 3} more files" if len(found) > 3 else ""
        told = f"{folder.path} lacks rows of its run: {'; '.join(found[:3])}{more}"
        raise FolderError(f"{told}; jaxnet run simulates them again")


def wrong_rows(rows: pa.Table, cell: int, wanted: range) -> str:
    """Fault of a shard whose rows lack a sample or have one twice; "" without a fault."""
    samples = rows["sample"].to_numpy()
    if (rows["cell"].to_numpy() != cell).any():
        return "holds rows of another cell"
    samples = np.sort(samples[samples < wanted.stop])
    if len(samples) < len(wanted):
        return f"lost {len(wanted) - len(samples)} of {len(wanted)} rows"
    return "" if np.array_equal(samples, wanted) else "lost samples, or has some twice"


# the latter if other programs have written a file again
TEXT_TYPES = {pa.string(), pa.large_string()}
NUMBER_TYPES = {pa.int64(), pa.float64()}
COLUMN_TYPES = {
    "cell": {pa.int64()},
    "sample": {pa.int64()},
    "status": TEXT_TYPES,
    "tail_mean": {pa.float64()},
}


def strange_columns(schema: pa.Schema) -> str:
    for name in COLUMN_TYPES:
        if name not in schema.names:
            return f"it has no column {name}"
    for column in schema:
        if column.type not in COLUMN_TYPES.get(column.name, TEXT_TYPES | NUMBER_TYPES):
            return f"its column {column.name} holds {column.type}"
    return ""


def scan_cells(
    folder: Folder,
    shards: Sequence[Shard],
    columns: Sequence[str] | None = None,
    where: ds.Expression | None = None,
) -> Iterator[tuple[int, pd.DataFrame]]:
    """Yield the number of each cell and its rows, sorted by sample.

    `columns` and `where` select columns and rows. The scan reads the files once, with the rows of
    one cell in memory. It omits cells without rows, and samples beyond those of the shards. Raises
    FolderError if a file cannot be read or holds lanes of another study than the manifest.
    """
    if not shards:
        return
    ordered = sorted(shards, key=lambda shard: (shard.cell.number, shard.number))
    files = [(folder.path / row_file(shard.number)).path for shard in ordered]
    wanted = None if columns is None else list(dict.fromkeys(["cell", *columns]))
    within = ds.field("sample") < max(shard.samples.stop for shard in shards)
    options = ds.ParquetFragmentScanOptions(page_checksum_verification=True, pre_buffer=True)
    form = ds.ParquetFileFormat(default_fragment_scan_options=options)
    study = folder.manifest.get("hash")

    def checked(found: ds.TaggedRecordBatch) -> pa.RecordBatch:
        if study is not None and is_foreign(found.fragment.metadata.metadata, study):
            told = "holds lanes of another study; jaxnet run replaces them"
            raise FolderError(f"{found.fragment.path} {told}")
        return found.record_batch

    with gate.reading(f"{folder.path}/lanes", "cannot be read; jaxnet run simulates them again"):
        data = ds.dataset(files, filesystem=folder.path.fs, format=form)
        if strange := strange_columns(data.schema):
            raise FolderError(f"{folder.path}/lanes holds no rows of ours: {strange}")
        # pandas would heed its own metadata there
        bare = data.replace_schema(data.schema.remove_metadata())
        scanner = bare.scanner(columns=wanted, filter=within if where is None else within & where)
        batches = (batch for batch in map(checked, scanner.scan_batches()) if batch.num_rows)
        for cell, mine in itertools.groupby(batches, lambda batch: batch["cell"][0].as_py()):
            yield cell, pa.Table.from_batches(mine).to_pandas(use_threads=False)


def is_foreign(metadata: Mapping[bytes, bytes] | None, study: str) -> bool:
    stamp = (metadata or {}).get(STAMP)
    try:
        return stamp is not None and json.loads(stamp)["study"] != study
    except (ValueError, KeyError, TypeError, RecursionError):
        return True
