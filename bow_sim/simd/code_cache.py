"""Where compiled code is stored, and a message on stderr while it is compiled.

Numba stores the code of a function in one directory, and raises an exception if it cannot write there. Here code is
read from several directories, first the one beside the sources, where an installation puts it; that one may belong to
another user or be read-only. New code is written to the first directory that can be written.
"""

from __future__ import annotations

import contextlib
import os
import stat
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from llvmlite.binding import parse_assembly
from numba.core import config, event
from numba.core.caching import CompileResultCacheImpl, FunctionCache, InTreeCacheLocator, NullCache
from numba.core.runtime import rtsys

REPORT_AFTER_S = 2.0
"""A compilation that takes longer is reported."""

REPORT_EVERY_S = 15.0

_PRIVATE = f"bow-compiled-{os.geteuid()}"
"""Name of our directory among temporary files."""


def beside(source: str) -> str:
    """Return the directory beside a source file, where an installation stores the compiled code."""
    return str(Path(source).parent / "__pycache__")


def candidates(source: str) -> Iterator[str]:
    """Yield the directories in which code of a source file may be stored, in the order in which writing is tried."""
    folder = InTreeCacheLocator.get_suitable_cache_subpath(source)
    if config.CACHE_DIR:  # NUMBA_CACHE_DIR
        yield str(Path(config.CACHE_DIR).absolute() / folder)
    yield beside(source)
    cache, home = Path(os.environ.get("XDG_CACHE_HOME") or "."), Path(os.environ.get("HOME") or ".")
    if cache.is_absolute():
        yield str(cache / "bow" / folder)
    elif home.is_absolute() and home.is_dir():
        yield str(home / ".cache" / "bow" / folder)
    with contextlib.suppress(OSError):  # there is no directory for temporary files
        yield str(Path(tempfile.gettempdir()) / _PRIVATE / folder)


def _is_ours(place: Path) -> bool:
    """Return whether only this user can write into a directory: code that is read from there is executed."""
    try:
        found = place.lstat()
    except OSError:
        return False
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.geteuid() and not found.st_mode & 0o022


def _is_trusted(directory: str) -> bool:
    """Return whether code may be read from one of the candidates."""
    place = Path(directory).parent
    return place.name != _PRIVATE or _is_ours(place)


class _Locator(InTreeCacheLocator):
    """Tells Numba the directory of a function's code; the directory need not exist."""

    directory = ""

    def get_cache_path(self) -> str:
        return self.directory

    def ensure_cache_path(self) -> None:
        place = Path(self.directory).parent
        if place.name == _PRIVATE:
            with contextlib.suppress(FileExistsError):
                place.mkdir(mode=0o700)
            if not _is_ours(place):
                raise PermissionError(f"{place}: others can write into it")
        super().ensure_cache_path()

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> Any:
        return cls(py_func, py_file)


class _Storage(CompileResultCacheImpl):
    """What is stored of a compiled version: its machine code, without what LLVM made that from.

    Only to compile a function that calls this one would that be needed, and to read it took a third of the loading.
    """

    def reduce(self, data: Any) -> Any:
        (name, kind, (code, _)), *rest = super().reduce(data)
        entry = parse_assembly(f'@"{data.fndesc.llvm_cpython_wrapper_name}" = global i8 0')  # Numba asks for the name
        return ((name, kind, (code, entry.as_bitcode())), *rest)


def _cache_in(directory: str, function: Any) -> Any:
    """Return Numba's cache of a function, in a directory."""
    locator = type("Locator", (_Locator,), {"directory": directory})
    implementation = type("Implementation", (_Storage,), {"_locator_classes": [locator]})
    return type("Cache", (FunctionCache,), {"_impl_class": implementation})(function)


class CodeCache(NullCache):
    """The compiled versions of one function, in all directories. No compiled function may call it.

    Parameters
    ----------
    function
        The Python function.
    """

    def __init__(self, function: Any) -> None:
        self._function = function
        source = function.__code__.co_filename
        self._to_write = [_cache_in(directory, function) for directory in candidates(source)]
        trusted = [cache for cache in self._to_write if _is_trusted(cache.cache_path)]
        self._to_read = sorted(trusted, key=lambda cache: cache.cache_path != beside(source))

    @property
    def cache_path(self) -> str | None:
        """The directory that a new version is written to; None if no directory can be written."""
        for cache in self._to_write:
            with contextlib.suppress(OSError):
                cache._impl.locator.ensure_cache_path()
                return str(cache.cache_path)
        return None

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the version for a signature; None if there is none that can be read.

        Numba would first load all that it can compile, 0.15 s and SciPy's linear algebra with it. To run machine code
        takes only the functions that count references; whatever is compiled later loads the rest.
        """
        rtsys.initialize(target_context)
        for cache in self._to_read:
            try:
                found = cache._load_overload(sig, target_context)
            except Exception:  # no permission, or an incomplete file: pickle may raise any exception
                continue
            if found is not None:
                return found
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store a version in the first directory that can be written; without one, only this process has it."""
        for cache in self._to_write:
            try:
                _save(cache, sig, data)
            except OSError:
                continue
            return


def _save(cache: Any, sig: Any, data: Any) -> None:
    try:
        cache.save_overload(sig, data)
    except OSError:
        raise
    except Exception:  # the index is damaged: start a new one
        cache.flush()
        cache.save_overload(sig, data)


class Announcer(event.Listener):
    """Reports a compilation that takes long; without it, a program would print nothing for up to a minute.

    Parameters
    ----------
    print_line
        Called with each line of text.
    """

    def __init__(self, print_line: Callable[[str], None]) -> None:
        self._print = print_line
        self._reported: set[str] = set()
        self._depth = 0  # compiling a function compiles those that it calls
        self._over = threading.Event()
        self._reporter: threading.Thread | None = None

    def on_start(self, event: Any) -> None:
        """Start a thread that reports the compilation if it takes long."""
        self._depth += 1
        if self._depth > 1:
            return
        dispatcher = event.data["dispatcher"]
        package = str(dispatcher.py_func.__module__).partition(".")[0]
        self._over = threading.Event()
        arguments = (package, dispatcher._cache, self._over)
        self._reporter = threading.Thread(target=self._report, args=arguments, daemon=True)
        self._reporter.start()

    def on_end(self, event: Any) -> None:
        """End that thread: this process may be forked later, and a fork copies only the calling thread."""
        self._depth -= 1
        if self._depth == 0 and self._reporter is not None:
            self._over.set()
            self._reporter.join()
            self._reporter = None

    def _report(self, package: str, cache: Any, over: threading.Event) -> None:
        began = time.monotonic()
        if over.wait(REPORT_AFTER_S):
            return
        what, usually = _COMPILED.get(package, (package, "some seconds"))
        if what not in self._reported:
            self._reported.add(what)
            directory = cache.cache_path
            where = f"stored in {directory}" if directory else "not stored, as no directory for it can be written"
            self._print(
                f"compiling {what} for this machine, usually {usually} in all; the code is {where} "
                "(NUMBA_CACHE_DIR=DIR stores it in another directory)"
            )
        while not over.wait(REPORT_EVERY_S):
            self._print(f"compiling {what}: {time.monotonic() - began:.0f} s so far")


_COMPILED = {
    "bow_sim": ("the simulator", "5 to 15 s"),
    "bow_classifier": ("the classifier", "10 to 15 s"),
}
"""Package -> what is compiled, and how long that usually takes."""


def _print_line(text: str) -> None:
    with contextlib.suppress(OSError, ValueError, AttributeError):  # there may be no stderr
        print(f"bow: {text}", file=sys.stderr, flush=True)


event.register("numba:compile", Announcer(_print_line))
