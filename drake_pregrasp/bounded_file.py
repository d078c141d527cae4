"""Reading files that somebody else wrote: regular ones, up to a size."""

from pathlib import Path

from drake_pregrasp.errors import InvalidArgumentError

_MEGABYTE = 1_000_000


def read_bounded(path: Path, most: int) -> bytes:
    """Returns what a file holds.

    Args:
        path: The file. A pipe or a device, which may never end, is none.
        most: Bytes that it may have.

    Raises:
        InvalidArgumentError: If it is no regular file, can't be read, or is larger.
    """
    try:
        if path.exists() and not path.is_file():
            raise InvalidArgumentError(f"{path}: can't be read: it is no regular file")
        with path.open("rb") as file:
            data = file.read(most + 1)
    except (OSError, ValueError) as error:
        if isinstance(error, InvalidArgumentError):
            raise
        why = getattr(error, "strerror", None) or str(error)
        raise InvalidArgumentError(f"{path}: can't be read: {why}") from error
    if len(data) > most:
        raise InvalidArgumentError(
            f"{path}: can't be read: it has more than {most / _MEGABYTE:g} MB; make it smaller"
        )
    return data


def read_bounded_text(path: Path, most: int) -> str:
    """Returns what a file of UTF-8 holds, without a byte order mark.

    Args:
        path: As for `read_bounded`.
        most: As for `read_bounded`.

    Raises:
        InvalidArgumentError: As for `read_bounded`, or if it is no UTF-8.
    """
    try:
        return read_bounded(path, most).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InvalidArgumentError(f"{path}: can't be read: {error}") from error
