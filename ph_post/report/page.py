"""What all pages have in common: one file with its data, its style and its script, and no network."""

from __future__ import annotations

import html
import math
from collections.abc import Iterable
from importlib import resources
from typing import Any, Literal

import msgspec
import numpy as np

from ph_post.types import Array

Kind = Literal["motion", "diff", "diagnosis"]


def make_page(kind: Kind, title: str, data: dict[str, Any], lines: Iterable[str]) -> str:
    """Put a page together.

    Parameters
    ----------
    kind : str
        Whose script draws it: that of ``pages/KIND.js``, on top of what all share.
    title : str
        Of the window.
    data : dict
        What the script draws, without NaN and infinity.
    lines : iterable of str
        The same in words, for a reader without scripts.

    Returns
    -------
    str
        HTML that asks the network for nothing.
    """
    parts = {
        "title": html.escape(title),
        "style": _text("page.css"),
        "lines": html.escape("\n".join(lines)),
        "script": _text("page.js") + _text(f"{kind}.js"),
        # No "<" inside the script: a "</script" from a file would end it.
        "data": msgspec.json.encode(data).decode().replace("<", "\\u003c"),
    }
    pieces = _text("page.html").split("@@")
    # What stands in a part is never looked at again: nothing from a file is taken for the page's own.
    return "".join(parts[piece] if number % 2 else piece for number, piece in enumerate(pieces))


def numbers(values: Array, decimals: int) -> list[float | None]:
    """Return values (n,) rounded for a page, as short as can be; None where there is none.

    Examples
    --------
    >>> numbers(np.array([2.0, 0.123456, np.nan]), 4)
    [2, 0.1235, None]
    """
    rounded = np.round(values, decimals) + 0.0
    return [
        None if not math.isfinite(one) else int(one) if one == int(one) else one for one in rounded.tolist()
    ]


def _text(name: str) -> str:
    return resources.files(__package__).joinpath("pages", name).read_text(encoding="utf-8")
