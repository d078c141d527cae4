"""A digest of files, such as the source that results come from."""

import hashlib
from collections.abc import Iterable
from pathlib import Path

DIGEST_LENGTH = 16


def digest_files(files: Iterable[Path]) -> str:
    """Returns a digest of the contents of files, in this order."""
    digest = hashlib.sha256()
    for file in files:
        digest.update(file.read_bytes())
    return digest.hexdigest()[:DIGEST_LENGTH]
