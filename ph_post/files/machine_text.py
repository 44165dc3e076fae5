"""Edits of the text of a machine file (TOML) that leave all else as a person wrote it, and the text of new files."""

from __future__ import annotations

import re
from collections.abc import Mapping, MutableMapping, Sequence
from typing import Any, Final, NamedTuple

import msgspec
import tomlkit
from tomlkit.items import AoT, Item, Table

from ph_post.types import EffectSetting

DIGITS: Final = 7
"""Significant digits of a number that is written."""

_MINE: Final = re.compile(r"^#\s*\+- [^;]*(?:;\s*)?")
"""The beginning of a comment that an earlier change has put behind a number."""

_WAS: Final = "was "
"""What the comment of a value that is no longer there begins with."""


class EffectChange(msgspec.Struct, frozen=True, kw_only=True):
    """A change of one effect of an axis.

    `place` is its number in the file, None for one that is added; `setting` is what it becomes, None where it
    is taken out. `comments` stand behind its parameters, by key, `above` are the lines above it.
    """

    place: int | None
    setting: EffectSetting | None
    comments: Mapping[str, str] = {}
    above: tuple[str, ...] = ()


class AxisChange(msgspec.Struct, frozen=True, kw_only=True):
    """Changes of one axis.

    `keys` are new values by key of ``[axes.AXIS]`` ("control.KEY" of the table below it), None where a key is
    taken out. `comments` stand behind them, by key; `above` are the lines above the first of them.
    """

    axis: str
    keys: Mapping[str, float | str | None] = {}
    comments: Mapping[str, str] = {}
    above: tuple[str, ...] = ()
    effects: tuple[EffectChange, ...] = ()


def edit_axes(original: str, changes: Sequence[AxisChange]) -> str:
    """Change axes of a machine file; comments, order and layout of all else stay.

    Parameters
    ----------
    original : str
        A machine file that can be read.
    changes : sequence of AxisChange

    Returns
    -------
    str
        Numbers are written with seven significant digits.
    """
    text = original.replace("\r\n", "\n")
    for change in changes:
        text = _with_keys(text, change)
        text = _with_effects(text, change)
    return text.replace("\n", "\r\n") if "\r\n" in original else text


def written(value: float | str) -> float | str:
    """Return a value as it is written.

    Examples
    --------
    >>> written(0.0123456789), written("contact")
    (0.01234568, 'contact')
    """
    return value if isinstance(value, str) else float(f"{value:.{DIGITS}g}")


class Row(NamedTuple):
    """A key of a machine file, its value, and the comment behind it; `assumed` if nobody measured or answered it."""

    key: str
    value: Any
    comment: str = ""
    assumed: bool = False

    def line(self, column: int = 0) -> str:
        """Return the row as TOML, its comment at `column`, or two blanks behind the value."""
        text = f"{self.key} = {_literal(self.value)}"
        return f"{text.ljust(column - 2)}  # {self.comment}\n" if self.comment else f"{text}\n"


def machine_document(
    head: Sequence[str],
    name: str,
    controller: Sequence[Row],
    axes: Mapping[str, Sequence[Row | str]],
    column: int = 0,
) -> str:
    """Return the text of a new machine file.

    Parameters
    ----------
    head : sequence of str
        Lines of the comment at its top.
    name : str
        Name of the machine.
    controller : sequence of Row
        Keys of ``[controller]``.
    axes : mapping of str to sequence of Row or str
        Keys of each ``[axes.AXIS]``; a str is a comment on a line of its own.
    column : int, optional
        Where comments behind a value begin; without it two blanks behind the value.
    """
    tables = {"controller": controller} | {f"axes.{axis}": rows for axis, rows in axes.items()}
    text = _lines(head) + Row("name", name).line()
    for title, rows in tables.items():
        lines = [_lines([row]) if isinstance(row, str) else row.line(column) for row in rows]
        text += f"\n[{title}]\n" + "".join(lines)
    return text


def _with_keys(text: str, change: AxisChange) -> str:
    """Set the keys that the file has where they stand, and add the others behind them."""
    document = tomlkit.parse(text)
    axis: Any = document["axes"][change.axis]
    above, added = change.above, {}
    for key, value in change.keys.items():
        table, last = _table_of(axis, key)
        if value is None:
            if table is not None:
                table.pop(last, None)
        elif table is None or last not in table:
            added[key] = value
        else:
            _set(table, last, value, change.comments.get(key, ""), above)
            above = ()
    text = tomlkit.dumps(document)
    for key, value in added.items():
        text = _with_new_key(text, change, key, value, above)
        above = ()
    return text


def _table_of(axis: Any, key: str) -> tuple[Any, str]:
    """Return the table that a key belongs to, None where there is none, and the key in it."""
    *tables, last = key.split(".")
    for name in tables:
        axis = axis.get(name) if axis is not None else None
    return axis, last


def _set(
    table: MutableMapping[str, Any], key: str, value: float | str, comment: str, above: Sequence[str] = ()
) -> None:
    """Set a key, keep what a person wrote behind the value that was there, and put lines above it."""
    item, before = tomlkit.item(written(value)), table[key]
    if isinstance(before, Item):
        # What stands around the old one goes over to the new one as it takes its place.
        kept = _MINE.sub("", before.trivia.comment).lstrip("# ")
        if kept and not kept.startswith(_WAS) and item.as_string() != before.as_string():
            kept = f"{_WAS}{before.as_string()}: {kept}"
        words = "; ".join(part for part in (comment, kept) if part)
        if words:
            item.trivia.comment_ws = before.trivia.comment_ws or "  "
            item.trivia.comment = f"# {words}"
        if above and "\n" in before.trivia.trail:
            before.trivia.indent = _lines(above, before.trivia.indent) + before.trivia.indent
    table[key] = item


def _with_new_key(text: str, change: AxisChange, key: str, value: float | str, above: Sequence[str]) -> str:
    """Add a key behind the last one of its table."""
    *tables, last = key.split(".")
    own = _section(text, ("axes", change.axis, *tables))
    end, name = own or _section(text, ("axes", change.axis)), last if own else key
    if end is None:  # an inline table, or dotted keys
        document = tomlkit.parse(text)
        table: Any = document["axes"][change.axis]
        for part in tables:
            table = table.setdefault(part, tomlkit.inline_table())
        table[last] = written(value)
        return tomlkit.dumps(document)
    comment = change.comments.get(key, "")
    return _inserted(text, end, _lines(above) + Row(name, value, comment).line())


def _with_effects(text: str, change: AxisChange) -> str:
    """Change and take out effects where they stand, then add the others behind the axis' last line."""
    document = tomlkit.parse(text)
    axis: Any = document["axes"][change.axis]
    effects = axis.get("effects")
    gone = []
    for one in change.effects:
        if one.place is not None and one.setting is not None:
            _reset(effects[one.place], one)
        elif one.place is not None:
            gone.append(one.place)
    for place in sorted(gone, reverse=True):
        del effects[place]
    if gone and not effects:
        del axis["effects"]
        effects = None
    added = [one for one in change.effects if one.place is None and one.setting is not None]
    inline = (effects is not None and not isinstance(effects, AoT)) or _end(text, change.axis) is None
    if added and inline:
        _append_inline(axis, added)
        return tomlkit.dumps(document)
    text = tomlkit.dumps(document)
    for one in added:
        text = _inserted(text, _end(text, change.axis) or 0, _effect_lines(change.axis, one))
    return text


def _reset(table: Any, change: EffectChange) -> None:
    """Give an effect that stands in the file other parameters."""
    assert change.setting is not None
    parameters = change.setting.parameters
    for key in [key for key in table if key != "name" and key not in parameters]:
        del table[key]
    for key, value in parameters.items():
        if key not in table:
            table[key] = value if isinstance(value, list) else written(value)
        elif table[key] != value:
            _set(table, key, value, change.comments.get(key, ""))
    if isinstance(table, Table):
        table.trivia.indent = _lines(change.above, table.trivia.indent) + table.trivia.indent


def _append_inline(axis: Any, added: Sequence[EffectChange]) -> None:
    if "effects" not in axis:
        axis["effects"] = tomlkit.array()
    for one in added:
        assert one.setting is not None
        table = tomlkit.inline_table()
        table["name"] = one.setting.name
        for key, value in one.setting.parameters.items():
            table[key] = value if isinstance(value, list) else written(value)
        axis["effects"].append(table)


def _effect_lines(axis: str, change: EffectChange) -> str:
    assert change.setting is not None
    rows = [Row("name", change.setting.name)]
    rows += [Row(key, value, change.comments.get(key, "")) for key, value in change.setting.parameters.items()]
    lines = (row.line() for row in rows)
    return "\n" + _lines(change.above) + f"[[axes.{axis}.effects]]\n" + "".join(lines)


def _literal(value: Any) -> str:
    return tomlkit.item(value if isinstance(value, list) else written(value)).as_string()


def _lines(comments: Sequence[str], indent: str = "") -> str:
    margin = indent.rpartition("\n")[2] if not indent.strip() else ""
    return "".join(f"{margin}# {line}\n" for line in comments)


def _header(path: Sequence[str], *, below: bool) -> re.Pattern[str]:
    """Match the header of a table, or of one below it."""
    keys = r"\s*\.\s*".join(rf"(?:{key}|\"{key}\"|'{key}')" for key in path)
    end = r"[.\]]" if below else r"\]"
    return re.compile(rf"\s*\[\[?\s*{keys}\s*{end}")


def _section(text: str, path: Sequence[str], *, below: bool = False) -> int | None:
    """Return the line behind the last key of a table that has a header, None where there is no header.

    What comes after that key, blank lines and comments, belongs to the next table.
    """
    pattern, inside, end = _header(path, below=below), False, None
    for number, line in enumerate(text.split("\n")):
        if line.lstrip().startswith("["):
            inside = pattern.match(line) is not None
        if inside and line.strip() and not line.lstrip().startswith("#"):
            end = number + 1
    return end


def _end(text: str, axis: str) -> int | None:
    """Return the line behind the last key of an axis, the tables below it included."""
    return _section(text, ("axes", axis), below=True)


def _inserted(text: str, line: int, what: str) -> str:
    lines = text.split("\n")
    before = "\n".join(lines[:line]) + "\n"
    return before + what + "\n".join(lines[line:])
