"""A file is there as a whole, or as it was."""

from __future__ import annotations

import pytest

from monitor.adapters.files import replacing, write_bytes, write_text


def test_whole(tmp_path):
    """Text and bytes as they are, in place of what was there."""
    write_text(tmp_path / "a", "µ\n")
    assert (tmp_path / "a").read_bytes() == "µ\n".encode()
    write_bytes(tmp_path / "a", memoryview(b"\x00\r\n"))
    assert (tmp_path / "a").read_bytes() == b"\x00\r\n"
    assert [p.name for p in tmp_path.iterdir()] == ["a"]


@pytest.mark.parametrize("before", [b"old", None])
def test_not_at_all(tmp_path, monkeypatch, before):
    """A writer that fails, a disk that is full: what was there stays, and nothing lies beside it."""
    path = tmp_path / "a"
    if before is not None:
        path.write_bytes(before)

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    with pytest.raises(TypeError), replacing(path) as file:
        file.write("half")
    monkeypatch.setattr("monitor.adapters.files.os.fsync", full)
    with pytest.raises(OSError, match="No space"):
        write_bytes(path, b"new")
    left = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    assert left == ({} if before is None else {"a": before})


def test_a_folder_that_is_not_there(tmp_path):
    """The system's own error."""
    with pytest.raises(FileNotFoundError):
        write_text(tmp_path / "x" / "a", "")
