from __future__ import annotations

import io
import zipfile
from pathlib import Path

import pytest

from tdcr_planner.archive import open_archive
from tdcr_planner.errors import FormatError


def zip_of(records: dict[str, bytes], method: int = zipfile.ZIP_STORED) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", method) as archive:
        for name, content in records.items():
            archive.writestr(name, content)
    return buffer.getvalue()


def test_records_are_read(tmp_path: Path) -> None:
    (tmp_path / "a.zip").write_bytes(zip_of({"one": b"1", "two": b"22"}, zipfile.ZIP_DEFLATED))
    with open_archive(tmp_path / "a.zip", "thing", 10) as archive:
        archive.check_all()
        assert archive.names == ["one", "two"]
        assert archive.size("two") == 2
        assert archive.read("two") == b"22"


def test_an_archive_in_an_archive_is_read_from_its_bytes() -> None:
    with open_archive("outer.zip", "thing", 10, zip_of({"one": b"1"})) as archive:
        assert archive.read("one") == b"1"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", ["damaged or no thing"]),
        (b"text " * 100, ["damaged or no thing"]),
        (zip_of({"one": b"1"})[:-5], ["damaged or no thing"]),
        (zip_of({"one": b"12345678901"}), ["11 bytes", "10 at most"]),
        # A thousand times as large as its file.
        (zip_of({"bomb": bytes(10_000_000)}, zipfile.ZIP_DEFLATED), ["10,000,000 bytes", "10 at most"]),
        (zip_of({"one": b"1"}, zipfile.ZIP_LZMA), ["method that is not read", "one"]),
        (zip_of({"one": b"1"}, zipfile.ZIP_BZIP2), ["method that is not read", "one"]),
    ],
)
def test_what_is_no_archive_or_too_large_is_refused(content: bytes, words: list[str]) -> None:
    with pytest.raises(FormatError) as caught, open_archive("a.zip", "thing", 10, content) as archive:
        archive.check_all()
    for word in ["a.zip", *words]:
        assert word in str(caught.value)


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_a_record_named_twice_is_refused() -> None:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("one", b"1")
        archive.writestr("one", b"2")
    with (
        pytest.raises(FormatError, match=r"one: .* twice"),
        open_archive("a.zip", "thing", 10, buffer.getvalue()),
    ):
        pass


def test_a_changed_record_is_refused_by_its_checksum() -> None:
    content = zip_of({"one": b"abcdefgh"}).replace(b"abcdefgh", b"abcdXfgh")
    with pytest.raises(FormatError, match="damaged"), open_archive("a.zip", "thing", 10, content) as archive:
        archive.read("one")
    with pytest.raises(FormatError, match="checksum"), open_archive("a.zip", "thing", 10, content) as archive:
        archive.check_all()


def test_missing_files_and_folders_are_named(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="no such file"), open_archive(tmp_path / "none.zip", "thing", 10):
        pass
    with pytest.raises(FormatError, match="is a folder"), open_archive(tmp_path, "thing", 10):
        pass
