"""Tables of a run as Apache Parquet: a directory for each table, in parts that are there whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from keystore_audit.errors import UsageError
from keystore_audit.fleet.tables import COLUMNS, Rows
from keystore_audit.opening import flags

PART: Final = 20_000
"""Rows of a part: some MiB in memory, and a fleet has few files."""


def check_available() -> None:
    """Raise errors.UsageError, with what to install, if Parquet cannot be written here."""
    try:
        import pyarrow.parquet  # noqa: F401
    except ImportError as error:
        raise UsageError("Parquet needs pyarrow: install keystore-audit[fleet].") from error


class Datasets:
    """The tables of one run below `directory`, which holds nothing else; a context manager, which writes what is left.

    Raises OSError where a part cannot be written.
    """

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self._waiting: dict[str, list[tuple[Any, ...]]] = {table: [] for table in COLUMNS}
        self._parts: dict[str, int] = dict.fromkeys(COLUMNS, 0)

    def __enter__(self) -> Datasets:
        """Write rows until the block ends."""
        return self

    def __exit__(self, *_: object) -> None:
        """Write what is waiting; a table without rows has one part without rows."""
        for table, rows in self._waiting.items():
            if rows or not self._parts[table]:
                self._write(table)

    def add(self, rows: Rows) -> None:
        """Take rows, and write the parts that are full."""
        for table, added in rows.items():
            self._waiting[table] += added
            if len(self._waiting[table]) >= PART:
                self._write(table)

    def _write(self, table: str) -> None:
        from pyarrow import parquet

        folder = self._directory / table
        folder.mkdir(parents=True, exist_ok=True)
        name = f"part-{self._parts[table]:05}.parquet"
        draft = f".{name}.tmp"
        here = os.open(folder, flags("O_DIRECTORY", "O_NOFOLLOW"))
        try:
            descriptor = os.open(draft, flags("O_WRONLY", "O_CREAT", "O_EXCL", "O_NOFOLLOW"), 0o666, dir_fd=here)
            try:
                with open(descriptor, "wb") as file:
                    parquet.write_table(_table(COLUMNS[table], self._waiting[table]), file, compression="zstd")
                os.replace(draft, name, src_dir_fd=here, dst_dir_fd=here)
            except BaseException:
                os.unlink(draft, dir_fd=here)
                raise
        finally:
            os.close(here)
        self._parts[table] += 1
        self._waiting[table] = []


def _table(columns: Mapping[str, str], rows: list[tuple[Any, ...]]) -> Any:
    import pyarrow as pa

    kinds = {
        "text": pa.string(),
        "texts": pa.list_(pa.string()),
        "number": pa.int32(),
        "answer": pa.bool_(),
        "instant": pa.timestamp("s", tz="UTC"),
    }
    arrays = [
        pa.array([_value(row[place], kind) for row in rows], type=kinds[kind])
        for place, kind in enumerate(columns.values())
    ]
    schema = pa.schema([(name, kinds[kind]) for name, kind in columns.items()])
    return pa.Table.from_arrays(arrays, schema=schema)


def _value(value: Any, kind: str) -> Any:
    """The value; of a text that is no Unicode (a path of odd bytes), what stands for it in every report."""
    if kind == "text" and value is not None:
        return _unicode(value)
    return [_unicode(each) for each in value] if kind == "texts" else value


def _unicode(text: str) -> str:
    return text.encode("utf-8", "backslashreplace").decode()
