"""Writing a file whole or not at all."""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
from pathlib import Path

from trigpoint.errors import FileFormatError


def write_atomically(path: str | Path, content: str | bytes) -> None:
    """Write ``content`` (text as UTF-8) to a temporary file in the same folder, then rename it to ``path``.

    A reader sees the old file or the new one, never a half; after a failure the temporary file is gone and the old
    file is as it was. A link is followed; a device or pipe is written directly.

    Raises:
        FileFormatError: the folder does not exist, ``path`` is a folder, or the system refuses.
    """
    try:
        data = content.encode("utf-8") if isinstance(content, str) else content
    except UnicodeEncodeError as error:
        raise FileFormatError(path, f"cannot be written: the text holds {error.object[error.start]!r}") from None
    target = Path(os.path.realpath(path))
    if target.is_dir():
        raise FileFormatError(path, "cannot be written: this is a folder; name a file in it")
    if not target.parent.is_dir():
        raise FileFormatError(path, f"cannot be written: there is no folder {str(target.parent)!r}; create it first")
    try:
        if target.exists() and not target.is_file():
            target.write_bytes(data)
        else:
            _replace(target, data)
    except OSError as error:
        raise FileFormatError(path, f"cannot be written ({error.strerror or error})") from error


def _replace(target: Path, data: bytes) -> None:
    temporary = target.with_name(f".trigpoint-{secrets.token_hex(8)}.tmp")
    try:
        # os.open and not mkstemp: the file gets the permissions that the user's umask gives to new files
        descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        if target.exists():
            shutil.copymode(target, temporary)
        os.replace(temporary, target)
    except BaseException:
        with contextlib.suppress(OSError):
            temporary.unlink()
        raise
