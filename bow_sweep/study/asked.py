"""The file in a directory of runs that says what was asked for, so that it can be resumed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import yaml

from bow_sim.atomic_files import replacing
from bow_sweep.run.directory import RunError

Asked = TypeVar("Asked")


def write_asked(path: Path, content: Mapping[str, Any]) -> None:
    """Write what is asked for."""
    with replacing(path) as file:
        file.write(yaml.safe_dump(dict(content), sort_keys=False, allow_unicode=True).encode())


def read_asked(path: Path, what: str, key: str, version: int, build: Callable[[Any], Asked]) -> Asked:
    """Read what was asked for.

    Parameters
    ----------
    what
        Its name for the user, "study" or "search".
    key, version
        Entry that has the version of the file, and the latest that this program reads.
    build
        Makes of the content what is returned; may raise KeyError, TypeError and ValueError.

    Raises
    ------
    RunError
        Where there is no such file, or it cannot be read, or is of a later version.
    """
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise RunError(f"{path.parent}: no {what} was begun here; it would have a file {path.name}") from None
    except (OSError, ValueError, yaml.YAMLError, RecursionError) as error:
        raise RunError(f"{path}: cannot be read: {' '.join(str(error).split())}") from None
    try:
        found = content[key]
        if isinstance(found, int) and found > version:
            raise RunError(f"{path}: format {found}, of a later bow; this one reads {version}: update it")
        return build(content)
    except (KeyError, TypeError, ValueError) as error:
        why = f"it has no {error}" if isinstance(error, KeyError) else error
        raise RunError(f"{path}: does not say which {what} this is: {why}") from None
