"""Reads examples/compose.yaml as `docker compose` does, which is not here: variables first, then YAML."""

from __future__ import annotations

import re
from typing import Any

import yaml
from checkout import ROOT

_VARIABLE = re.compile(r"\$(?:(\$)|\{([A-Z_]+):-([^}]*)\})")


def compose_services(**variables: str) -> dict[str, dict[str, Any]]:
    """Return the services by their names, for values of variables."""

    def value(match: re.Match[str]) -> str:
        return "$" if match[1] else variables.get(match[2], match[3])

    text = (ROOT / "examples" / "compose.yaml").read_text()
    services: dict[str, dict[str, Any]] = yaml.safe_load(_VARIABLE.sub(value, text))["services"]
    return services
