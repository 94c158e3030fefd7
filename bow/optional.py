"""Libraries that not every installation has."""

from __future__ import annotations

from importlib import import_module
from typing import Any


class MissingLibrary(ImportError):
    """A library is not installed; the message says what needs it, and how to install it."""


def library(name: str, what: str) -> Any:
    """Return a module.

    Parameters
    ----------
    name
        Of the module.
    what
        What needs it, as the beginning of a sentence.

    Raises
    ------
    MissingLibrary
        Where it is not installed.
    """
    try:
        return import_module(name)
    except ImportError as error:
        library_name = name.partition(".")[0]
        if error.name is not None and error.name.partition(".")[0] != library_name:
            raise  # it is there, and lacks something itself
        right = f"pip install 'bow[data]', or pip install {library_name}"
        raise MissingLibrary(f"{what} needs {library_name}, which is not installed here; {right}") from None
