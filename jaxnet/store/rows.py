"""Rows, one a lane: a file `lanes/NNNNN.parquet` a shard, with a stamp that describes the file.

A reader trusts no file. A truncated file, a page's wrong checksum, or lanes of another study are errors.
"""

import itertools
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.dataset as ds
import pyarrow.parquet as pq
from jaxtyping import Float
from upath import UPath

from jaxnet.config.cells import Cell
from jaxnet.config.keys import Config, Scenario
from jaxnet.config.scenario import interval_of
from jaxnet.config.spacings import multiples
from jaxnet.lazy import LazyModule
from jaxnet.store import gate
from jaxnet.store.folder import MOST, Folder, FolderError, Manifest, samples_of_cells
from jaxnet.store.layout import CellLabel, Shard, samples_of_shard

if TYPE_CHECKING:
    from jaxnet.engine import status
    from jaxnet.engine.plan import Outcome
else:
    status = LazyModule("jaxnet.engine.status")

STAMP = b"jaxnet.shard"  # in a file's metadata
MOST_ROWS, MOST_FILE = MOST["shard_size"], 2**28  # of a file, the latter in bytes
READERS = 16  # files looked over at a time
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


def column_types(study: Config, cells: Sequence[Cell]) -> dict[str, pa.DataType]:
    """Return the types of the swept keys' columns, equal in every shard."""
    return {key: column_type(study, key, label) for key, label in cells[0].labels.items()}


def column_type(study: Config, key: str, label: CellLabel) -> pa.DataType:
    """Return the type of a swept key's column."""
    if isinstance(label, str):
        return pa.string()
    given = study.sweep[key]
    whole = isinstance(given, list) and all(isinstance(value, int) for value in given)
    return pa.int64() if whole else pa.float64()


ROW_COUNTS = ("steps", "switches", "unheard")
ISOLATION = {  # columns on vehicles that decisions cut off from the navigator, and their types
    "cut_off": pa.int64(),
    "cut_off_at": pa.float64(),
    "cut_off_vehicles": pa.int64(),
    "cut_off_share": pa.float64(),
    "stopped": pa.int64(),
}


def isolation_columns(cells: Sequence[Cell]) -> list[str]:
    """Return the columns of a study on vehicles that decisions cut off, equal in every shard.

    A study whose defences cannot cut a vehicle off has none. Where they can, the columns tell who and since
    when; where such vehicles coast, also how many, for how long, and how many stopped.
    """
    defences = [cell.scenario.defence for cell in cells if cell.scenario.law.couples()]
    if any(defence.coasts() for defence in defences):
        return list(ISOLATION)
    return ["cut_off", "cut_off_at"] if any(defence.decides for defence in defences) else []


def outcome_table(
    shard: Shard, outcome: "Outcome", types: Mapping[str, pa.DataType], isolation: Sequence[str]
) -> pa.Table:
    """Return the rows of a shard's lanes, with columns in the documented order.

    `isolation` are the study's columns on vehicles that decisions cut off.
    """
    count = len(shard.samples)
    columns: dict[str, pa.Array | np.ndarray | list[str]] = {
        "cell": np.full(count, shard.cell.number, dtype=np.int64),
        "sample": np.array(shard.samples, dtype=np.int64),
    }
    for key, label in shard.cell.labels.items():
        columns[key] = pa.array([label] * count, type=types[key])
    columns["status"] = [status.Status(code).name for code in outcome.status]
    columns |= {
        metric.name: outcome.metrics[metric.name] for metric in shard.cell.scenario.measured()
    }
    columns |= {name: getattr(outcome, name).astype(np.int64) for name in ROW_COUNTS}
    columns |= {name: pa.array(outcome.cut_off[name], type=ISOLATION[name]) for name in isolation}
    if isolation:
        columns["cut_off_at"] = tick_times(shard.cell.scenario, outcome.cut_off["cut_off_at"])
    return pa.table(columns)


def tick_times(
    scenario: Scenario, times: Float[np.ndarray, " lanes"]
) -> Float[np.ndarray, " lanes"]:
    """Return times of the engine [s] as multiples of the tick, rounded once."""
    known, found, tick = np.isfinite(times), times.copy(), interval_of(scenario)
    found[known] = multiples(tick, np.rint(times[known] / tick).astype(int).tolist())
    return found


def column_names(cell: Cell, isolation: Sequence[str]) -> list[str]:
    """Return the names of a row file's columns, in order."""
    metrics = [metric.name for metric in cell.scenario.measured()]
    return ["cell", "sample", *cell.labels, "status", *metrics, *ROW_COUNTS, *isolation]


def row_file(number: int) -> str:
    """Return the name of a shard's row file."""
    return f"lanes/{number:05d}.parquet"


def shard_number(name: str) -> int | None:
    """Return the number of the shard of a row file; None for any other file."""
    found = re.fullmatch(r"(\d{5,12})\.parquet", name)
    return int(found[1]) if found else None


def write_rows(folder: Folder, number: int, rows: pa.Table, stamp: Stamp) -> None:
    """Write a shard's rows with their stamp."""
    stamped = rows.replace_schema_metadata({STAMP: json.dumps(stamp._asdict())})
    folder.put(
        row_file(number),
        lambda file: pq.write_table(stamped, file, compression="zstd", write_page_checksum=True),
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
        if strange := strange_file(file.metadata, file.schema_arrow):
            raise TornError(f"not a row file of ours: {strange}")
        return file.read(columns)
    except (pa.ArrowException, OSError, ValueError, TypeError, KeyError) as error:
        raise TornError(f"torn ({str(error).rstrip('.').splitlines()[0]})") from error


def strange_file(metadata: pq.FileMetaData, schema: pa.Schema) -> str:
    """Return what is wrong with a row file, before its rows are decompressed; "" if nothing is."""
    bytes_of = sum(
        metadata.row_group(number).total_byte_size for number in range(metadata.num_row_groups)
    )
    if metadata.num_rows > MOST_ROWS or bytes_of > MOST_FILE:
        return f"it has {metadata.num_rows:,} rows in {bytes_of:,} bytes"
    return strange_columns(schema)


def refuse_lost(folder: Folder, manifest: Manifest) -> None:
    """Raise FolderError unless the folder of a finished run has the rows that its manifest promises.

    Each sample of each cell stands once, in the file of its shard. Further samples of the cell do not count:
    a part of a run with more samples may have added them.
    """
    samples, size = samples_of_cells(manifest, manifest["cells"]), manifest["shard_size"]
    numbers = range(-(-max(samples, default=0) // size) * len(samples))
    due = ((number, *samples_of_shard(samples, size, number)) for number in numbers)
    there = {path.name for path in folder.path.glob("lanes/*")}
    parts: list[tuple[int, int, range]] = []

    def lost(part: tuple[int, int, range]) -> str:
        number, cell, wanted = part
        try:
            rows = read_columns(folder.path / row_file(number), ("cell", "sample"))
            foreign = is_foreign(rows.schema.metadata, manifest["hash"])
            why = "holds lanes of another study" if foreign else wrong_rows(rows, cell, wanted)
        except (FileNotFoundError, NotADirectoryError):
            why = "is missing"
        except TornError as error:
            why = f"is {error}"
        return (
            why and f"{row_file(number)} (cell {cell}, samples {wanted[0]} to {wanted[-1]}) {why}"
        )

    for part in (part for part in due if part[-1]):
        parts.append(part)
        if (
            Path(row_file(part[0])).name not in there
        ):  # a manifest may promise more than any folder holds
            break
    with ThreadPoolExecutor(READERS) as pool:
        found = list(filter(None, pool.map(lost, parts)))
    if found:
        more = f" and {len(found) - 3} more files" if len(found) > 3 else ""
        told = f"{folder.path} lacks rows of its run: {'; '.join(found[:3])}{more}"
        raise FolderError(f"{told}; jaxnet run simulates them again")


def wrong_rows(rows: pa.Table, cell: int, wanted: range) -> str:
    """Return what is wrong with a shard's rows if they lack a sample of the cell or have one twice; or ""."""
    samples = rows["sample"].to_numpy()
    if (rows["cell"].to_numpy() != cell).any():
        return "holds rows of another cell"
    samples = np.sort(samples[samples < wanted.stop])
    if len(samples) < len(wanted):
        return f"lost {len(wanted) - len(samples)} of {len(wanted)} rows"
    return "" if np.array_equal(samples, wanted) else "lost samples, or has some twice"


TEXT_TYPES = {
    pa.string(),
    pa.large_string(),
}  # the latter if other programs have written a file again
NUMBER_TYPES = {pa.int64(), pa.float64()}
COLUMN_TYPES = {
    "cell": {pa.int64()},
    "sample": {pa.int64()},
    "status": TEXT_TYPES,
    "tail_mean": {pa.float64()},
}


def strange_columns(schema: pa.Schema) -> str:
    """Return what is wrong with the columns of a row file; "" if nothing is."""
    for name in COLUMN_TYPES:
        if name not in schema.names:
            return f"it has no column {name}"
    for column in schema:
        if column.type not in COLUMN_TYPES.get(column.name, TEXT_TYPES | NUMBER_TYPES):
            return f"its column {column.name} holds {column.type}"
    return ""


def any_stamp(folder: Folder) -> Stamp | None:
    """Return the stamp of any readable row file; None without one."""
    for path in sorted(folder.path.glob("lanes/[0-9]*.parquet")):
        try:
            return read_rows(path)[1]
        except TornError:
            continue
    return None


def scan_cells(
    folder: Folder,
    shards: Sequence[Shard],
    columns: Sequence[str] | None = None,
    where: ds.Expression | None = None,
) -> Iterator[tuple[int, pd.DataFrame]]:
    """Yield cell by cell the number of the cell and its rows, sorted by sample.

    `columns` and `where` select columns and rows. The scan reads the files once, with the rows of one cell in
    memory. It omits cells without rows, and samples beyond those of the shards.
    Raises FolderError if a file cannot be read or holds lanes of another study than the manifest.
    """
    if not shards:
        return
    ordered = sorted(shards, key=lambda shard: (shard.cell.number, shard.number))
    files = [(folder.path / row_file(shard.number)).path for shard in ordered]
    wanted = None if columns is None else list(dict.fromkeys(["cell", *columns]))
    within = ds.field("sample") < max(shard.samples.stop for shard in shards)
    options = ds.ParquetFragmentScanOptions(page_checksum_verification=True, pre_buffer=True)
    form = ds.ParquetFileFormat(default_fragment_scan_options=options)
    try:
        data = ds.dataset(files, filesystem=folder.path.fs, format=form)
        if strange := strange_columns(data.schema):
            raise FolderError(f"{folder.path}/lanes holds no rows of ours: {strange}")
        study = folder.manifest.get("hash")
        data_of_ours = data.replace_schema(
            data.schema.remove_metadata()
        )  # pandas would heed its own there
        scanner = data_of_ours.scanner(
            columns=wanted, filter=within if where is None else within & where
        )
        found = (checked_batch(study, each) for each in scanner.scan_batches())
        batches = (batch for batch in found if batch.num_rows)
        for cell, mine in itertools.groupby(batches, lambda batch: batch["cell"][0].as_py()):
            yield cell, pa.Table.from_batches(mine).to_pandas()
    except (pa.ArrowException, OSError, ValueError) as error:
        if isinstance(error, FolderError):
            raise
        reason = str(error).splitlines()[0]
        raise FolderError(
            f"{folder.path}/lanes: {reason}; jaxnet run simulates again what is torn"
        ) from error


def checked_batch(study: str | None, found: ds.TaggedRecordBatch) -> pa.RecordBatch:
    """Return the rows of a scanned batch; raise FolderError if their file belongs to another study."""
    if study is not None and is_foreign(found.fragment.metadata.metadata, study):
        raise FolderError(
            f"{found.fragment.path} holds lanes of another study; jaxnet run replaces them"
        )
    return found.record_batch


def is_foreign(metadata: Mapping[bytes, bytes] | None, study: str) -> bool:
    """Return whether a row file has the stamp of another study than that of this hash."""
    stamp = (metadata or {}).get(STAMP)
    try:
        return stamp is not None and json.loads(stamp)["study"] != study
    except (ValueError, KeyError, TypeError, RecursionError):
        return True


def read_lanes(folder: Folder, shards: Sequence[Shard]) -> pd.DataFrame:
    """Return all rows of these shards, sorted by cell and sample."""
    return pd.concat([rows for _, rows in scan_cells(folder, shards)], ignore_index=True)
