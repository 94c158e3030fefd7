"""A page of docs/ of which a script writes the part between two marks; the text around them stays."""

from __future__ import annotations

from pathlib import Path

BEGIN, END = "<!-- begin: written by {} -->", "<!-- end: written by {} -->"


def put(text: str, path: Path, script: str) -> None:
    """Put the text between the marks of `script`; a page without them gets both at its end."""
    begin, end = BEGIN.format(script), END.format(script)
    old = path.read_text(encoding="utf-8") if path.exists() else ""
    before, _, rest = old.partition(begin)
    after = rest.partition(end)[2] or "\n"
    head = before.rstrip("\n") + "\n\n" if before.strip() else ""
    path.write_text(f"{head}{begin}\n\n{text.strip()}\n\n{end}{after}", encoding="utf-8")
