"""Options of programs that are written out, where none is: they would do nothing, and are refused in one line."""

from __future__ import annotations

import pytest
from support.streams import without_progress

import ph_post as ph
from ph_post.cli.main import main
from ph_post.errors import InputError

UNUSED = "is for programs that are written out first; add --expand, or leave it out"


@pytest.mark.parametrize(
    ("option", "value"),
    [
        *(
            ("--parameters", "old.var"),
            ("--tool-table", "tool.tbl"),
            ("--subprograms", "."),
            ("--peck-clearance", "0.5"),
        ),
        ("--controller-version", "2.9.4"),
    ],
)
@pytest.mark.parametrize("command", ["convert", "batch"])
def test_without_expand_nothing_is_written(command, option, value, capsys, tmp_path):
    part, out = tmp_path / "in" / "part.ngc", tmp_path / "out"
    part.parent.mkdir()
    part.write_text("G21 G90\nG1 X10 F600\nY10\nM2\n")
    job = part if command == "convert" else part.parent
    assert main([command, str(job), "-m", "router", "-o", str(out), option, value]) == 2
    assert without_progress(capsys.readouterr().err).startswith(f"ph-post: {option} {UNUSED}")
    assert not out.exists()


def test_python_refuses_them_too():
    with pytest.raises(InputError, match=f"--tool-table {UNUSED}"):
        ph.compensate("pocket", "router", tool_table="tool.tbl")
