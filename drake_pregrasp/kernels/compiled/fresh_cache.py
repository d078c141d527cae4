"""Throwing compiled code away when the source it was made of has changed.

Numba looks for changes in a function's own file only. What it keeps for a function holds the
functions that it calls and the constants it reads, whichever files these are in.
"""

import contextlib
import functools
import hashlib
import os
import uuid
from pathlib import Path

_SOURCES = Path(__file__).parent.parent
"""Where all is that compiled code is made of, but..."""

_CONSTANTS = _SOURCES.parent / "extreme_singular_values.py"
"""...for these constants."""

_STAMP = "drake_pregrasp_kernels.sha256"
"""The file beside compiled code that says of which source it is."""


@functools.cache
def discard_if_stale(folder: str | None) -> None:
    """Deletes this package's compiled code if it is not of the source as it is now.

    It is asked once a process for each folder, before anything is loaded from there. Processes may
    do so at the same time: to numba a file that is gone is a function to compile. Where the folder
    can't be written nothing happens.

    Args:
        folder: Where numba keeps compiled code, or nothing if it keeps none.
    """
    if folder is None:
        return
    stamp = Path(folder) / _STAMP
    with contextlib.suppress(OSError):
        digest = source_digest()
        if stamp.exists() and stamp.read_text(encoding="ascii") == digest:
            return
        for file in list(Path(folder).iterdir()):
            if _is_compiled_here(file):
                file.unlink(missing_ok=True)
        # Only now, so that whoever reads it finds nothing stale; at once, so that all of it is.
        fresh = stamp.with_name(f"{_STAMP}.{uuid.uuid4().hex}")
        fresh.write_text(digest, encoding="ascii")
        os.replace(fresh, stamp)


def source_digest() -> str:
    """Returns a digest of the source of all kernels."""
    digest = hashlib.sha256()
    for file in (*sorted(_SOURCES.rglob("*.py")), _CONSTANTS):
        content = file.read_bytes()
        name = os.path.relpath(file, _SOURCES)
        digest.update(f"{name} {len(content)} ".encode())
        digest.update(content)
    return digest.hexdigest()


def _is_compiled_here(file: Path) -> bool:
    """Returns whether a file is numba's, of a module beside this one."""
    module = file.name.split(".")[0]
    return file.suffix in (".nbi", ".nbc") and Path(__file__).with_name(f"{module}.py").exists()
