"""The settings of a study, so that rows of different ones aren't mixed."""

import fcntl
import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

from drake_pregrasp.errors import OutputError
from drake_pregrasp.simulation.output import reading_back

_ANOTHER = "choose another folder with --out"


def text_keys(data: Any) -> Any:
    """Returns data with texts for keys, as JSON has them: those of one mapping can be sorted."""
    if isinstance(data, Mapping):
        return {str(key): text_keys(value) for key, value in data.items()}
    return [text_keys(value) for value in data] if isinstance(data, list | tuple) else data


def digest(settings: Mapping[str, Any]) -> str:
    """Returns a digest of settings, whatever the order of their keys."""
    return hashlib.sha256(_canonical(settings).encode()).hexdigest()[:16]


def claim(path: Path, settings: Mapping[str, Any]) -> IO[str]:
    """Makes the file of a study's settings, or checks the one that is there.

    Args:
        path: Of the file.
        settings: What JSON can say of them.

    Returns:
        The open file: nobody else can claim it until it is closed.

    Raises:
        OutputError: If it is of other settings, or another process works on it.
    """
    file = path.open("a+", encoding="utf-8")
    try:
        _check(file, path, settings)
    except BaseException:
        file.close()
        raise
    return file


def _check(file: IO[str], path: Path, settings: Mapping[str, Any]) -> None:
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise OutputError(f"{path}: another process works on this study; {_ANOTHER}") from error
    file.seek(0)
    with reading_back(path):
        text = file.read()
    if not text:
        content = {"digest": digest(settings), "settings": json.loads(_canonical(settings))}
        file.write(json.dumps(content, indent=1, sort_keys=True) + "\n")
        file.flush()
        return
    try:
        found = json.loads(text)
        theirs, same = found["settings"], found["digest"] == digest(settings)
    except (ValueError, KeyError, TypeError) as error:
        raise OutputError(f"{path}: can't be read as a study's settings; {_ANOTHER}") from error
    if not same:
        names = ", ".join(_differences(theirs, json.loads(_canonical(settings)))) or "digest"
        raise OutputError(f"{path}: is of a study with other settings ({names}); {_ANOTHER}")


def _canonical(settings: Mapping[str, Any]) -> str:
    return json.dumps(text_keys(settings), sort_keys=True, separators=(",", ":"))


def _differences(theirs: Any, ours: Any, path: str = "") -> list[str]:
    """Returns the dotted paths of the keys that differ."""
    if not (isinstance(theirs, dict) and isinstance(ours, dict)):
        return [] if theirs == ours else [path]
    return [
        name
        for key in sorted({*theirs, *ours})
        for name in _differences(theirs.get(key), ours.get(key), f"{path}.{key}".lstrip("."))
    ]
