"""Rows: one per lane, `lanes/NNNNN.parquet` per shard, with a stamp that says what the file holds.

A file is read as if anything may have happened to it: one that was cut short, that has a page whose checksum
is wrong or that holds another study's lanes is none.
"""

import itertools
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.dataset as ds
import pyarrow.parquet as pq
from upath import UPath

from jaxnet.config.cells import Cell
from jaxnet.config.keys import Config
from jaxnet.engine.plan import Outcome
from jaxnet.engine.status import Status
from jaxnet.store.folder import Folder, FolderError
from jaxnet.store.layout import Shard

STAMP = b"jaxnet.shard"  # in a file's metadata
OK: Any = ds.field("status") == "ok"


class TornError(Exception):
    """A row file that cannot be used; says why."""


class Stamp(NamedTuple):
    """What a row file says of itself."""

    jaxnet: str  # version that wrote it
    study: str  # hash
    cell: int
    first: int  # sample
    size: int  # samples of a whole shard
    filled: dict[str, str]  # stores that its lanes are in, by name, and their identities
    checksums: dict[str, int]  # of its chunks there by array, or of the file of arrays beside it


def column_types(study: Config, cells: Sequence[Cell]) -> dict[str, pa.DataType]:
    """Types of the swept keys' columns, the same in every shard."""
    return {key: column_type(study, key, label) for key, label in cells[0].labels.items()}


def column_type(study: Config, key: str, label: Any) -> pa.DataType:
    """Type of a swept key's column."""
    if isinstance(label, str):
        return pa.string()
    given = study.sweep[key]
    whole = isinstance(given, list) and all(isinstance(value, int) for value in given)
    return pa.int64() if whole else pa.float64()


def table_of(shard: Shard, outcome: Outcome, types: Mapping[str, pa.DataType]) -> pa.Table:
    """One row per lane, columns as the contract orders them."""
    count = len(shard.samples)
    columns: dict[str, Any] = {
        "cell": np.full(count, shard.cell.number, dtype=np.int64),
        "sample": np.array(shard.samples, dtype=np.int64),
    }
    for key, label in shard.cell.labels.items():
        columns[key] = pa.array([label] * count, type=types[key])
    columns["status"] = [Status(code).name for code in outcome.status]
    columns |= {metric.name: outcome.metrics[metric.name] for metric in shard.cell.scenario.measured()}
    columns |= {
        "steps": outcome.steps.astype(np.int64),
        "switches": outcome.switches.astype(np.int64),
    }
    return pa.table(columns)


def column_names(cell: Cell) -> list[str]:
    """Names of a row file's columns, in their order."""
    metrics = [metric.name for metric in cell.scenario.measured()]
    return ["cell", "sample", *cell.labels, "status", *metrics, "steps", "switches"]


def name_of(number: int) -> str:
    """The row file of a shard."""
    return f"lanes/{number:05d}.parquet"


def number_of(name: str) -> int | None:
    """The shard of a row file, None for another file."""
    found = re.fullmatch(r"(\d{5,12})\.parquet", name)
    return int(found[1]) if found else None


def write_rows(folder: Folder, number: int, rows: pa.Table, stamp: Stamp) -> None:
    """Write a shard's rows, stamped."""
    stamped = rows.replace_schema_metadata({STAMP: json.dumps(stamp._asdict())})
    folder.put(
        name_of(number),
        lambda file: pq.write_table(stamped, file, compression="zstd", write_page_checksum=True),
    )


def read_rows(path: UPath) -> tuple[pa.Table, Stamp]:
    """A row file, every page checked, and its stamp; raises FileNotFoundError or TornError."""
    content = pa.BufferReader(path.fs.cat_file(path.path))
    try:
        rows = pq.read_table(content, page_checksum_verification=True)
        if strange := strange_columns(rows.schema):
            raise TornError(f"not a row file of ours: {strange}")
        return rows, Stamp(**json.loads((rows.schema.metadata or {})[STAMP]))
    except (pa.ArrowException, OSError) as error:
        raise TornError(f"torn ({str(error).rstrip('.').splitlines()[0]})") from error
    except (KeyError, ValueError, TypeError) as error:
        raise TornError("not a row file of ours") from error


TEXT = {pa.string(), pa.large_string()}  # the latter if other programs have written a file again
NUMBERS = {pa.int64(), pa.float64()}
NEEDED = {"cell": {pa.int64()}, "sample": {pa.int64()}, "status": TEXT, "tail_mean": {pa.float64()}}


def strange_columns(schema: pa.Schema) -> str:
    """What a column is that none of our files has; empty if there is none."""
    for name in NEEDED:
        if name not in schema.names:
            return f"it has no column {name}"
    for column in schema:
        if column.type not in NEEDED.get(column.name, TEXT | NUMBERS):
            return f"its column {column.name} holds {column.type}"
    return ""


def any_stamp(folder: Folder) -> Stamp | None:
    """Stamp of some row file that can be read, if there is one."""
    for path in sorted(folder.path.glob("lanes/[0-9]*.parquet")):
        try:
            return read_rows(path)[1]
        except TornError:
            continue
    return None


def scan(
    folder: Folder, shards: Sequence[Shard], columns: Sequence[str] | None = None, where: Any = None
) -> Iterator[tuple[int, pd.DataFrame]]:
    """Cell by cell in their order, its rows by sample: these columns of those that a condition holds for.

    One pass over the shards' files, with one cell's rows in memory; cells without rows are passed over, and
    so are samples beyond those of the shards, which a part of a longer run may have written.
    Raises FolderError if a file cannot be read, or holds lanes of another study than the manifest tells of.
    """
    if not shards:
        return
    ordered = sorted(shards, key=lambda shard: (shard.cell.number, shard.number))
    files = [(folder.path / name_of(shard.number)).path for shard in ordered]
    wanted = None if columns is None else list(dict.fromkeys(["cell", *columns]))
    within = ds.field("sample") < max(shard.samples.stop for shard in shards)
    options = ds.ParquetFragmentScanOptions(page_checksum_verification=True, pre_buffer=True)
    form = ds.ParquetFileFormat(default_fragment_scan_options=options)
    try:
        data = ds.dataset(files, filesystem=folder.path.fs, format=form)
        if strange := strange_columns(data.schema):
            raise FolderError(f"{folder.path}/lanes holds no rows of ours: {strange}")
        study = folder.manifest.get("hash")
        data_of_ours = data.replace_schema(data.schema.remove_metadata())  # pandas would heed its own there
        scanner = data_of_ours.scanner(columns=wanted, filter=within if where is None else within & where)
        found = (batch_of(study, each) for each in scanner.scan_batches())
        batches = (batch for batch in found if batch.num_rows)
        for cell, mine in itertools.groupby(batches, lambda batch: batch["cell"][0].as_py()):
            yield cell, pa.Table.from_batches(mine).to_pandas()
    except (pa.ArrowException, OSError) as error:
        raise FolderError(f"{folder.path}: {error}; jaxnet run simulates again what is torn") from error


def batch_of(study: str | None, found: Any) -> pa.RecordBatch:
    """Rows of a scan; raises FolderError if their file's stamp is of another study."""
    stamp = (found.fragment.metadata.metadata or {}).get(STAMP)
    if study is not None and stamp is not None and json.loads(stamp)["study"] != study:
        raise FolderError(f"{found.fragment.path} holds lanes of another study; jaxnet run replaces them")
    return found.record_batch


def read_all(folder: Folder, shards: Sequence[Shard]) -> pd.DataFrame:
    """All rows of some shards by cell and sample."""
    return pd.concat([rows for _, rows in scan(folder, shards)], ignore_index=True)
