"""Run a command beside the function of ``ph_post`` that it calls."""

import json
from typing import Any

from ph_post.cli.main import main


def printed(capsys: Any, *arguments: object, status: int = 0) -> Any:
    """Return what a command prints with ``--json``."""
    assert main([*map(str, arguments), "--json"]) == status
    return json.loads(capsys.readouterr().out)
