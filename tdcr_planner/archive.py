"""The archive: a zip file as data, whose records are read within declared sizes and by their checksums."""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import IO

from tdcr_planner.errors import FormatError
from tdcr_planner.inputs import open_file

# Programs write a few dozen records; the directory of a million takes seconds and gigabytes to read.
_MOST_RECORDS = 10_000
# The two methods that NumPy and torch write. Others can ask for a dictionary of gigabytes.
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_ENCRYPTED = 0x1

# What `zipfile` raises on bytes that are no archive, are cut short, or were changed.
_BROKEN = (
    zipfile.BadZipFile,
    zlib.error,
    EOFError,
    NotImplementedError,
    RuntimeError,
    ValueError,
    OverflowError,
    LookupError,
    struct.error,
)


class Archive:
    """An open archive.

    Attributes:
        path: The file, for messages.
        kind: What the file should be, for messages.
    """

    def __init__(self, path: Path, kind: str, records: zipfile.ZipFile) -> None:
        """Use `open_archive`."""
        self.path = path
        self.kind = kind
        self._records = records

    @property
    def names(self) -> list[str]:
        """Names of all records."""
        return self._records.namelist()

    def size(self, name: str) -> int:
        """Returns the number of bytes that a record declares; reading it gives no more."""
        return self._records.getinfo(name).file_size

    def open(self, name: str) -> IO[bytes]:
        """Returns a stream of a record's bytes; the end of a damaged one raises FormatError."""
        return self._records.open(name)

    def read(self, name: str) -> bytes:
        """Returns a record's bytes, checked against its checksum."""
        return self._records.read(name)

    def check_all(self) -> None:
        """Raises FormatError unless every record's bytes have their checksum."""
        broken = self._records.testzip()
        if broken is not None:
            raise FormatError(self.path, "is damaged: its checksum is wrong", broken)


@contextmanager
def open_archive(path: str | Path, kind: str, largest_bytes: int, content: bytes | None = None) -> Iterator[Archive]:
    """Opens a zip file whose declared sizes are checked before a record is read.

    What `zipfile` raises inside of the `with` block becomes a FormatError too.

    Args:
        path: The file.
        kind: What the file should be, such as "roadmap", for messages.
        largest_bytes: Most bytes that all records may have together when they are unpacked.
        content: The archive's bytes, where it is a record of another archive; None reads the file.

    Raises:
        FormatError: The file is missing or no archive, is damaged, names a record twice, or unpacks to more.
    """
    path = Path(path)
    try:
        source: AbstractContextManager[IO[bytes]] = open_file(path) if content is None else io.BytesIO(content)
        with source as stream, zipfile.ZipFile(stream) as file:
            _check_records(path, kind, file, largest_bytes)
            yield Archive(path, kind, file)
    except _BROKEN as error:
        raise FormatError(path, f"is damaged or no {kind} ({type(error).__name__}: {error})") from error


def _check_records(path: Path, kind: str, file: zipfile.ZipFile, largest_bytes: int) -> None:
    records = file.infolist()
    if len(records) > _MOST_RECORDS:
        raise FormatError(path, f"is no {kind}: it holds {len(records)} records, expected {_MOST_RECORDS} at most")
    names = [record.filename for record in records]
    if len(set(names)) != len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise FormatError(path, f"is damaged or no {kind}: it names a record twice", twice)
    for record in records:
        if record.compress_type not in _METHODS or record.flag_bits & _ENCRYPTED:
            raise FormatError(path, "is encrypted, or packed by a method that is not read", record.filename)
    total = sum(record.file_size for record in records)
    if total > largest_bytes:
        raise FormatError(path, f"unpacks to {total:,} bytes, expected {largest_bytes:,} at most for a {kind}")
