"""Text files of numbers that other programs write: spreadsheets, NumPy, MATLAB, Fortran, with points or commas.

Nothing is guessed: a line with two possible meanings raises an error.
"""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterator
from pathlib import Path

from bow_sim.physics.errors import ParameterError

COMMENTS = re.compile("[#%].*")

_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eEdD][+-]?[0-9]+)?|[+-]?(nan|inf|infinity)", re.IGNORECASE)
_DECIMAL_COMMA = re.compile(r"[+-]?[0-9]*,[0-9]+([eEdD][+-]?[0-9]+)?")


def read_text(path: str | Path) -> str:
    """Return the text of a file: UTF-8, UTF-16 with a byte-order mark, or an 8-bit code. Line ends become newlines.

    Raises
    ------
    OSError
        If it cannot be read.
    ValueError
        If it is not text.
    """
    content = Path(path).read_bytes()
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):  # Notepad, Excel's "Unicode text"
        text = content.decode("utf-16")
    else:
        try:
            text = content.decode("utf-8-sig")
        except UnicodeDecodeError:  # numbers are ASCII, whatever the comments are
            text = content.decode("latin-1")
    if "\0" in text:
        raise ValueError("is not text")
    return re.sub(r"\r\n?", "\n", text)


def read_file(path: str | Path) -> str:
    """Return the text of a file that a user names, as :func:`read_text`.

    Raises
    ------
    ParameterError
        If it cannot be read, or is not text.
    """
    try:
        return read_text(path)
    except (OSError, ValueError) as error:
        raise ParameterError(f"{path}: cannot be read: {error}") from None


def table(path: str | Path, text: str, columns: int, what: str) -> str:
    """Return the rows of a table as entries of settings: columns joined by "/", rows by commas.

    Parameters
    ----------
    path
        Of the file, for messages.
    text
        What it holds.
    columns
        Numbers in each row.
    what
        What they are: "must be WHAT" is said of another row.

    Raises
    ------
    ParameterError
        Where a row has another number of columns, a comma two possible meanings, or there is no row.
    """
    try:
        found = list(rows(text))
    except ValueError as error:
        raise ParameterError(f"{path}, {error}") from None
    for line, words in found:
        if len(words) != columns:
            raise ParameterError(f"{path}, line {line}: {' '.join(words)!r}: must be {what}")
    if not found:
        raise ParameterError(f"{path}: must have lines of {what}")
    return ", ".join("/".join(words) for _, words in found)


def number(word: str) -> float:
    """Return the number that a column holds; NaN and infinities are numbers.

    Raises
    ------
    ValueError
        If it is not a number.
    """
    word = word.replace("\N{MINUS SIGN}", "-")
    if not _NUMBER.fullmatch(word):
        raise ValueError(f"{word!r} is no number")
    return float(word.upper().replace("D", "E") if word[-1].isdigit() else word)


def rows(text: str) -> Iterator[tuple[int, list[str]]]:
    """Yield (line number, texts of its columns), with points as decimal points.

    Columns are separated by white space, commas, semicolons or tabs. Comments begin with ``#`` or ``%``; empty lines,
    and one line of headings before the first numbers, are skipped.

    Raises
    ------
    ValueError
        If it is not clear whether a comma is a decimal point; the message names the line.
    """
    points = ""
    first = True
    for line_number, line in enumerate(text.split("\n"), 1):
        words = [word.strip().strip("\"'").strip() for word in _columns(COMMENTS.sub("", line).strip())]
        while words and not words[-1]:
            words.pop()
        if not words:
            continue
        if first and len(words) > 1 and not any(map(_is_number, words)):
            first = False
            continue
        first = False
        for word in words:
            mark = "," if _DECIMAL_COMMA.fullmatch(word) else "." if "." in word and _is_number(word) else ""
            if mark and points and mark != points:
                raise ValueError(
                    f"line {line_number}: {line.strip()!r}: is the comma a decimal point? Lines before use another; "
                    "should be the same everywhere: points within numbers, and commas, semicolons or tabs between"
                )
            points = mark or points
        yield line_number, [word.replace(",", ".") if _DECIMAL_COMMA.fullmatch(word) else word for word in words]


def _columns(line: str) -> list[str]:
    """Return the columns of a line; commas that remain in them are decimal points."""
    for separator in (";", "\t"):
        if separator in line:
            return [word.strip().rstrip(",") for word in line.split(separator)]
    words = line.split()
    if len(words) == 2 and "," not in words[0].rstrip(","):  # a lag and 0,5, or a lag, and 0.5
        return [words[0].rstrip(","), words[1].rstrip(",")]
    return re.split(r"\s*,\s*|\s+", line)


def _is_number(word: str) -> bool:
    try:
        number(word)
    except ValueError:
        return bool(_DECIMAL_COMMA.fullmatch(word))
    return True
